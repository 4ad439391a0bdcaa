# SPDX-License-Identifier: Apache-2.0
"""Lobes drawn on a latlong picture: an outline at one standard deviation, a cross, a number.

The outline is where the exponent of the lobe is 1/2: `sx x^2 + sy y^2 = 1/2`, or for the sg form
`s (1 - z) = 1/2`. Where a lobe is too broad to get there within its hemisphere the outline is left
open: such a lobe has no edge that could be shown. Axes are expected to have data coordinates u, v
in [0, 1] from the top left corner.
"""

import colorsys
import math

import torch
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from torch import Tensor

from asglight.lobes import Form, Lobes
from asglight.lobes.asg import flux, per_variance
from asglight.sphere import latlong

_POINTS = 361
_DARK_SHARE = 0.002
"""Of the flux of the frame: lobes below it light nothing that could be seen, and are not drawn."""

_GOLDEN_RATIO = (math.sqrt(5) - 1) / 2


def colour(index: int) -> tuple[float, float, float]:
    """Return the colour of a lobe, the same in every frame; neighbours differ strongly."""
    hue = (0.09 + index * _GOLDEN_RATIO) % 1
    return colorsys.hls_to_rgb(hue, (0.72, 0.6, 0.82)[index % 3], 0.95)


def outline(axes: Tensor, sharpness: Tensor, form: Form) -> Tensor:
    """Return directions along the outline of one lobe; the last is the first.

    Half of the points are even in the angle of the ellipse, which serves its tips, half in the
    angle around the axis, which serves the sides of a long one.

    Args:
        axes: Rows axis_x, axis_y, axis_z.  [3, 3]
        sharpness: (sx, sy).  [2]
        form: The lobe function.

    Returns:
        Unit directions; NaN where the lobe has no edge within its hemisphere.  [722, 3]
    """
    turn = torch.linspace(0, 2 * math.pi, _POINTS, dtype=torch.float32)
    if form is Form.SG:
        z = (1 - 0.5 / sharpness[0]).expand_as(turn)
        radius = (1 - z * z).clamp(min=0).sqrt()
        local = torch.stack([radius * torch.cos(turn), radius * torch.sin(turn), z], dim=-1)
        return torch.where(z[:, None] >= 0, local, math.nan) @ axes
    x, y = torch.cos(turn) * sharpness[0].sqrt(), torch.sin(turn) * sharpness[1].sqrt()
    even = torch.atan2(y, x) % (2 * math.pi)
    even[-1] = 2 * math.pi
    turn = torch.cat([turn, even]).sort().values
    deviation = (per_variance(form) * sharpness).rsqrt()
    x, y = torch.cos(turn) * deviation[0], torch.sin(turn) * deviation[1]
    z2 = 1 - x * x - y * y
    local = torch.stack([x, y, z2.clamp(min=0).sqrt()], dim=-1)
    return torch.where(z2[:, None] >= 0, local, math.nan) @ axes


def segments(directions: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Return a curve as pieces in (u, v) that do not jump across the seam of the map.

    A piece that meets the seam is continued past the edge of the picture, which clips it.

    Args:
        directions: Along the curve; NaN where it is interrupted.  [P, 3]

    Returns:
        Pairs of u [.] and v [.].
    """
    u, v = latlong.uv_from_direction(directions)
    ends = [*(u.diff().abs() > 0.5).nonzero().flatten().tolist(), len(u) - 1]
    starts = [0, *(end + 1 for end in ends[:-1])]
    pieces = []
    for start, end in zip(starts, ends, strict=True):
        piece = torch.arange(max(start - 1, 0), min(end + 2, len(u)))  # with a neighbour each side
        steps = u[piece].diff()
        along = torch.cat([steps.new_zeros(1), (steps - steps.round()).cumsum(0)])
        unwrapped = along + u[start] - along[int(start > 0)]  # the piece's own start is in place
        pieces.append((unwrapped, v[piece]))
    return pieces


def draw_lobes(axes: Axes, lobes: Lobes, *, numbered: bool = True) -> None:
    """Draw the lobes of one frame; width and opacity grow with their share of the flux.

    Args:
        axes: With a latlong picture in it.
        lobes: N lobes.  [N, .]
        numbered: Whether their numbers are written, by which they are found in other frames.
    """
    power = flux(lobes).sum(-1)
    share = power / power.sum().clamp(min=1e-30)  # all dark: nothing is drawn
    signs = (1, -1) if lobes.form is Form.BINGHAM else (1,)
    for index in share.argsort().tolist():
        if float(share[index]) < _DARK_SHARE:
            continue
        strength = min(1.0, 4 * float(share[index])) ** 0.5
        style = {"color": colour(index), "alpha": 0.35 + 0.65 * strength}
        shadow = [withStroke(linewidth=1.7 + 1.8 * strength, foreground="#000000", alpha=0.4)]
        curve = outline(lobes.axes[index], lobes.sharpness[index], lobes.form)
        for sign in signs:
            for u, v in segments(sign * curve):
                width = 0.7 + 1.5 * strength
                axes.plot(u, v, linewidth=width, path_effects=shadow, **style)
        _mark(axes, lobes.axis_z[index], index if numbered else None, style, shadow)
    axes.set_xlim(0, 1)
    axes.set_ylim(1, 0)


def _mark(axes: Axes, axis: Tensor, index: int | None, style: dict, shadow: list) -> None:
    """Draw a cross at the lobe's axis and its number beside it, on the side that has room."""
    u, v = (float(value) for value in latlong.uv_from_direction(axis))
    axes.plot([u], [v], "+", markersize=8, markeredgewidth=1.4, path_effects=shadow, **style)
    if index is None:
        return
    right, low = u < 0.94, v < 0.1
    axes.annotate(
        f"{index}",
        (u, v),
        xytext=(5 if right else -5, -5 if low else 5),
        textcoords="offset points",
        ha="left" if right else "right",
        va="top" if low else "bottom",
        fontsize=10,
        color=style["color"],
        path_effects=[withStroke(linewidth=2.5, foreground="#000000", alpha=0.7)],
    )
