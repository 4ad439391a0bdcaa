# SPDX-License-Identifier: Apache-2.0
"""How much of a lobe's light something stands in the way of: soft shadows in closed form.

What is in the way is a patch of the sphere of directions, an ellipse. On the disc of a sheet
(sheets.py), where its light is a Gaussian, the patch is an ellipse as well. In coordinates in which
that ellipse is the unit circle, the light it blocks is the probability that a normal variable X,
neither centred nor round, has |X|^2 < 1. |X|^2 is a quadratic form of normal variables, and a power
of it is nearly normal [Jensen and Solomon 1972, "A Gaussian Approximation to the Distribution of a
Definite Quadratic Form"]: with mean mu and covariance S

    theta_1 = tr S   + mu.mu
    theta_2 = tr S^2 + 2 mu.S mu
    theta_3 = tr S^3 + 3 mu.S^2 mu,         h = 1 - 2 theta_1 theta_3 / (3 theta_2^2)
    P = Phi( ((theta_1^-h - 1) / h - theta_2 (h - 1) / theta_1^2) theta_1 / sqrt(2 theta_2) ).

For S = 0 it is the step of a hard shadow.
A long light, whose deviations are s_1 > s_2 along its axes, is summed over three places across it
instead, of what is between the ends of the circle's chord there (Gauss and Hermite; the places lie
where light and circle both are). Between the ratios RATIO_LOW and RATIO_HIGH it is a mix. A light
much wider than the circle both ways is even across it, and the nearly normal power, which goes to
Phi(-8/3) and not to 0, is not for it: the circle is taken as a bell of the same variance, 1/4.

docs/method/shading.md has the errors. The twin is shaders/lib/occlusion.glsl.

Symbols: M sheets, P points.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.shading import rectified
from asglight.shading.sheets import Sheets, Window

RATIO_LOW, RATIO_HIGH = 1.5, 2.5
"""Of deviations: at the low one the nearly normal power is within 0.02 of the share and three
places within 0.2, at the high one within 0.05 and 0.1, beyond within 0.17 and 0.05."""

WIDE_LOW, WIDE_HIGH = 0.5, 1.0
"""Of the smaller variance of a light: at the low one a bell for the circle is within 0.035 of the
share of a round light and the nearly normal power within 0.016, at the high one the bell within
0.007; beyond it comes nearer and nearer."""

CIRCLE_VARIANCE = 0.15
"""Of the bell that stands for the circle when places are chosen; 0.1 to 0.5 differ little."""

POWER_MIN = 1e-3
"""Below it (theta^-h - 1) / h is -log theta to a float's digits."""

DISC_VARIANCE_MAX = 16.0
"""Of a sheet: a broader one is as even over its disc, whose radius is 1 or 2, to 3 % at its rim."""

AREA_MIN = 1e-5
"""Of an ellipse on a disc, in products of half axes: a patch seen from its edge blocks nothing."""

BROAD_VARIANCE = 0.1
"""Of a sheet of the sg form, above which its own disc is taken. Below, its light is as Gaussian on
the disc of the asg form, where a circle of directions is an ellipse however large it is."""

EDGE_Z_MIN = 0.2
"""Of a patch on the edge of a sheet of the bingham form, within which z, and 1 / z, change."""

LIGHT_MIN = 1e-12
"""Irradiance below which a surface is dark and there is nothing to block."""

SEEN_MIN = 1e-4
"""Of light above the horizon, below which its mean cosine has no digits left."""

SQUARE_ELLIPSE = 2 / math.sqrt(math.pi)
"""Half axes of the ellipse that stands for a rectangle, over half its sides: the same area."""


class Patch(NamedTuple):
    """An ellipse of directions in front of each point.

    Attributes:
        centre: Of the ellipse; as long as its plane is away, 1 at most.  [P, 3]
        half_x: Half an axis.  [P, 3]
        half_y: The other, at right angles.  [P, 3]
    """

    centre: Tensor
    half_x: Tensor
    half_y: Tensor


def ball_patch(points: Tensor, centre: Tensor, radius: float) -> Patch:
    """Return where a ball stands, from points outside of it: exactly a circle.

    Args:
        points: [P, 3]
        centre: [3]
        radius: Of the ball.
    """
    towards = centre - points
    distance = towards.norm(dim=-1, keepdim=True)
    axis = towards / distance
    sine = (radius / distance).clamp(max=1)
    across, along = _across(axis)
    return Patch(axis * (1 - sine * sine).sqrt(), across * sine, along * sine)


def post_patch(points: Tensor, foot: Tensor, radius: float, height: float) -> Patch:
    """Return where an upright post stands, from points on the ground: an ellipse for a rectangle.

    Args:
        points: On the plane of the foot.  [P, 3]
        foot: [3]
        radius: Of the post.
        height: Of the post, along +Y.
    """
    away = foot - points
    level = away.norm(dim=-1, keepdim=True).clamp(min=radius)
    elevation = torch.atan2(torch.full_like(level, height), level)
    up = torch.tensor([0.0, 1.0, 0.0]).to(points)
    forward = away / away.norm(dim=-1, keepdim=True).clamp(min=1e-9)  # 1e-9: at the very foot
    middle = 0.5 * elevation
    centre = forward * torch.cos(middle) + up * torch.sin(middle)
    side = torch.linalg.cross(up.expand_as(forward), forward)
    lift = up * torch.cos(middle) - forward * torch.sin(middle)
    # the strip is as wide in angles of azimuth at every height
    wide = (radius / level).clamp(max=1) * torch.cos(middle)
    return Patch(centre, side * (SQUARE_ELLIPSE * wide), lift * (SQUARE_ELLIPSE * middle))


def blocked(sheets: Sheets, patch: Patch) -> Tensor:
    """Return the share of each sheet's light that comes through a patch.

    Args:
        sheets: M sheets.  [M, .]
        patch: In front of P points.

    Returns:
        0 to 1 for a patch before the sheet.  [M, P]
    """
    centre, half_x, half_y = (part @ sheets.axes.mT for part in patch)  # [M, P, 3]
    reach = (half_x[..., 2].square() + half_y[..., 2].square()).sqrt().clamp(min=1e-9)
    front = (1 + centre[..., 2] / reach).clamp(0, 1)  # of a patch behind the disc
    vx, vy = (v[:, None] for v in disc_variance(sheets).unbind(-1))
    if sheets.window is Window.NONE:
        is_broad = vx > BROAD_VARIANCE
        moved = _on_disc_of_areas(centre, half_x, half_y)
        kept = centre, half_x, half_y
        centre, half_x, half_y = (
            torch.where(is_broad[..., None], on_areas, flat)
            for on_areas, flat in zip(moved, kept, strict=True)
        )
        front = torch.where(is_broad, torch.ones_like(front), front)
    inside = _probability(centre, half_x, half_y, vx, vy) * front
    gaussian = 2 * math.pi * (vx * vy).sqrt()
    if sheets.window is Window.STEP:  # dw = dx dy / z
        gaussian = gaussian / centre[..., 2].abs().clamp(min=EDGE_Z_MIN)
    return (inside * gaussian / sheets.integral[:, None]).clamp(0, 1)


def disc_variance(sheets: Sheets) -> Tensor:
    """Return the variances on the disc, within what a float can tell apart.  [M, 2]."""
    return sheets.disc_variance.clamp(max=DISC_VARIANCE_MAX)


def visible(sheets: Sheets, normal: Tensor, patches: list[Patch]) -> Tensor:
    """Return the share of each sheet's irradiance that patches leave.

    Args:
        sheets: M sheets.
        normal: Of the surface.  [3]
        patches: In front of P points; what two of them block together is taken as by chance.

    Returns:
        0 to 1.  [M, P]
    """
    mean, deviation = rectified.cosine(sheets.over_points(), normal[None])  # [M, 1]
    lit = rectified.rectified(mean, rectified.widened(deviation)).mean
    left = torch.ones(len(sheets.integral), len(patches[0].centre)).to(mean)
    for patch in patches:
        share = blocked(sheets, patch)
        length = patch.centre.norm(dim=-1).clamp(min=1e-9)
        height = (patch.centre @ normal) / length
        spread = ((patch.half_x @ normal).square() + (patch.half_y @ normal).square()) / 4
        # what both see is the product of two bells; a patch is above the horizon
        variance = deviation.square()
        both = (spread + variance).clamp(min=1e-12)
        middle = (mean * spread + height * variance) / both
        cut = rectified.rectified(middle, (spread * variance / both).sqrt())
        cosine = cut.mean / cut.probability.clamp(min=SEEN_MIN)
        left = left * (1 - share * cosine / lit.clamp(min=LIGHT_MIN)).clamp(0, 1)
    return left


def _probability(centre: Tensor, half_x: Tensor, half_y: Tensor, vx: Tensor, vy: Tensor) -> Tensor:
    """Return the share of a Gaussian on the disc that lies in an ellipse.  [M, P]."""
    a, b = half_x[..., 0], half_y[..., 0]
    c, d = half_x[..., 1], half_y[..., 1]
    area = a * d - b * c
    # the axes of a patch seen from its edge are shorter than any light is wide
    inverse = 1 / torch.where(area.abs() < AREA_MIN, torch.ones_like(area), area)
    mu_x = -(d * centre[..., 0] - b * centre[..., 1]) * inverse
    mu_y = -(a * centre[..., 1] - c * centre[..., 0]) * inverse
    s_xx = (d * d * vx + b * b * vy) * inverse * inverse
    s_yy = (c * c * vx + a * a * vy) * inverse * inverse
    s_xy = -(d * c * vx + b * a * vy) * inverse * inverse
    trace, determinant = s_xx + s_yy, vx * vy * inverse * inverse
    round_ = _by_power(mu_x, mu_y, s_xx, s_yy, s_xy, determinant)
    # axes of the light, the longer one first
    apart = (0.25 * (s_xx - s_yy).square() + s_xy.square()).sqrt()
    longer = 0.5 * trace + apart
    shorter = determinant / longer
    half = 0.5 * (s_xx - s_yy)
    x = torch.where(half > 0, half + apart, s_xy)
    y = torch.where(half > 0, s_xy, apart - half)
    size = torch.hypot(x, y).clamp(min=1e-30)  # 1e-30: a round light, whose axes are any
    along, across = (x * mu_x + y * mu_y) / size, (x * mu_y - y * mu_x) / size
    long = _by_places(along, across, longer, shorter)
    ratio = (longer / shorter).sqrt()
    part = ((ratio - RATIO_LOW) / (RATIO_HIGH - RATIO_LOW)).clamp(0, 1)
    # a sum of products: the power of a very long light is no number
    share = torch.where(part < 1, torch.lerp(round_, long, part), long)
    wide = ((shorter - WIDE_LOW) / (WIDE_HIGH - WIDE_LOW)).clamp(0, 1)
    bell = _by_bell(mu_x, mu_y, s_xx, s_yy, s_xy, determinant)
    share = torch.where(wide < 1, torch.lerp(share, bell, wide), bell)
    return torch.where(area.abs() < AREA_MIN, torch.zeros_like(share), share)


def _by_power(
    mu_x: Tensor, mu_y: Tensor, s_xx: Tensor, s_yy: Tensor, s_xy: Tensor, determinant: Tensor
) -> Tensor:
    """Return P(|X|^2 < 1) by the power that is nearly normal."""
    trace = s_xx + s_yy
    mu2 = mu_x * mu_x + mu_y * mu_y
    mu_s_mu = s_xx * mu_x * mu_x + 2 * s_xy * mu_x * mu_y + s_yy * mu_y * mu_y
    first = trace + mu2
    second = trace * trace - 2 * determinant + 2 * mu_s_mu
    third = trace**3 - 3 * trace * determinant + 3 * (trace * mu_s_mu - determinant * mu2)
    power = 1 - 2 * first * third / (3 * second * second)
    power = torch.where(power.abs() < POWER_MIN, torch.full_like(power, POWER_MIN), power)
    raised = torch.expm1(-power * first.log()) / power
    z = (raised - second * (power - 1) / (first * first)) * first / (2 * second).sqrt()
    return torch.special.ndtr(z)


def _by_bell(
    mu_x: Tensor, mu_y: Tensor, s_xx: Tensor, s_yy: Tensor, s_xy: Tensor, determinant: Tensor
) -> Tensor:
    """Return P(|X|^2 < 1) for a light wider than the circle.

    The circle's area pi times the density of X blurred by the circle's variance, 1/4 each way.
    """
    blurred = determinant + 0.25 * (s_xx + s_yy) + 0.0625  # a sum of positive terms
    square = (s_yy + 0.25) * mu_x * mu_x - 2 * s_xy * mu_x * mu_y + (s_xx + 0.25) * mu_y * mu_y
    # rounding may bring the square of a very long light, which is not wide, below 0
    return 0.5 * blurred.rsqrt() * torch.exp(-0.5 * (square / blurred).clamp(min=0))


def _by_places(along: Tensor, across: Tensor, longer: Tensor, shorter: Tensor) -> Tensor:
    """Return P(|X|^2 < 1) by three places across a long light.

    Args:
        along: Mean along its longer axis.
        across: Mean across it.
        longer: Variance along the axis.
        shorter: Variance across it.
    """
    kept = CIRCLE_VARIANCE / (CIRCLE_VARIANCE + shorter)
    middle, step = across * kept, (3 * shorter * kept).sqrt()
    scale = kept.sqrt() * torch.exp(-0.5 * across * across / (CIRCLE_VARIANCE + shorter))
    inverse = longer.rsqrt()
    total = torch.zeros_like(along)
    for node, weight in ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6)):
        place = middle + node * step
        chord = (1 - place * place).clamp(min=0).sqrt()
        inside = torch.special.ndtr((chord - along) * inverse)
        inside = inside - torch.special.ndtr((-chord - along) * inverse)
        # beyond the circle, where there is no chord, the exponent would only overflow
        bell = torch.exp(0.5 * (place * place).clamp(max=1) / CIRCLE_VARIANCE)
        total = total + weight * bell * inside
    return (scale * total).clamp(0, 1)


def _on_disc_of_areas(
    centre: Tensor, half_x: Tensor, half_y: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Bring an ellipse to the disc of the sg form, exact for a small one; areas are kept."""
    length = centre.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    unit = centre / length
    # a circle of directions has the area of a flat one of radius 2 sin(angle / 2)
    flat = (2 / (1 + length)).sqrt()
    below = (1 + unit[..., 2:]).clamp(min=1e-3)  # 1e-3: straight behind, where nothing shines
    scale = (2 / below).sqrt()

    def moved(half: Tensor) -> Tensor:
        return flat * (half * scale - unit * (0.5 * scale / below) * half[..., 2:])

    return unit * scale, moved(half_x), moved(half_y)


def _across(axis: Tensor) -> tuple[Tensor, Tensor]:
    """Return two directions at right angles to axes and to each other.  [P, 3]."""
    helper = torch.nn.functional.one_hot(axis.abs().argmin(-1), 3).to(axis)
    across = torch.nn.functional.normalize(torch.linalg.cross(helper, axis), dim=-1)
    return across, torch.linalg.cross(axis, across)
