# SPDX-License-Identifier: Apache-2.0
"""Lobe frames: orthonormal axes, quaternions, canonical order and continuity over time.

A lobe is unchanged when its frame turns by 180 degrees about axis_z, and when it turns by 90
degrees while the two sharpnesses change places; in the bingham form also when axis_z is reversed.
The frame to use among the equals is a convention: within a frame the larger sharpness comes first
(`canonical`), over time each frame is the equal nearest to the one before (`continuous`).

Quaternions are (w, x, y, z), unit, and rotate the local frame to the lobe's: +X to axis_x.
"""

from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes.data import Form, Lobes, stack
from asglight.lobes.rectangles import turned_slant

SINE_MIN = 1e-12
"""Of the angle between two directions, above float64 rounding: below it their cross product has no
direction of its own."""


def axes_around(axis_z: Tensor) -> Tensor:
    """Complete unit z axes to right-handed orthonormal frames, x chosen without a preference.

    The helper axis is the coordinate axis least aligned with z, so the cross product is never
    shorter than sqrt(2/3).

    Args:
        axis_z: Unit directions.  [..., 3]

    Returns:
        Rows axis_x, axis_y, axis_z.  [..., 3, 3]
    """
    helper = torch.nn.functional.one_hot(axis_z.abs().argmin(-1), 3).to(axis_z)
    axis_x = torch.nn.functional.normalize(torch.linalg.cross(helper, axis_z), dim=-1)
    return torch.stack([axis_x, torch.linalg.cross(axis_z, axis_x), axis_z], dim=-2)


def orthonormal(axes: Tensor) -> Tensor:
    """Make nearly orthonormal frames exactly so, keeping axis_z's direction.  [..., 3, 3]."""
    axis_z = torch.nn.functional.normalize(axes[..., 2, :], dim=-1)
    along = (axes[..., 0, :] * axis_z).sum(-1, keepdim=True)
    axis_x = torch.nn.functional.normalize(axes[..., 0, :] - along * axis_z, dim=-1)
    return torch.stack([axis_x, torch.linalg.cross(axis_z, axis_x), axis_z], dim=-2)


def canonical(lobes: Lobes) -> Lobes:
    """Order the axes so that sharpness_x >= sharpness_y, the frame staying right-handed."""
    return _quarter_turned(lobes, _to_canonical(lobes))


def continuous(lobes: Lobes, *, keeps_first: bool = False) -> Lobes:
    """Choose among equal frames so that each lobe turns least from frame to frame.  [F, N, .].

    Args:
        lobes: Over time.
        keeps_first: Whether the first frame stays as it is, so that a user's width remains the
            width; else it is put in canonical order. Every other follows the one before.
    """
    start = _to_canonical(lobes[0])
    if keeps_first:
        start = torch.zeros_like(start)
    if lobes.form in (Form.SG, Form.BINGHAM):
        found = [_quarter_turned(lobes[0], start)]
        for index in range(1, lobes.axes.shape[0]):
            found.append(align(lobes[index], found[-1]))
        return stack(found)
    # quarters add up: the angle of two frames that are both turned by one stays as it is
    quarters = torch.cat([start[None], _quarters(lobes[1:], lobes[:-1])])
    return _quarter_turned(lobes, quarters.cumsum(0) % 4)


def align(lobes: Lobes, previous: Lobes) -> Lobes:
    """Turn each lobe's frame to the equal one nearest to the lobe's frame in `previous`.

    Nearest is the smallest rotation angle, the largest trace of the relative rotation (bingham
    beyond 90 degrees: after the reversal that brings axis_z nearest). The sg form
    has no preferred x axis: its frame is the previous one turned the shortest way.
    """
    if lobes.form is Form.SG:
        return replace(lobes, axes=parallel_transport(previous.axes, lobes.axis_z))
    if lobes.form is Form.BINGHAM:
        flip = (lobes.axis_z * previous.axis_z).sum(-1) < 0
        turned = torch.stack([lobes.axis_x, -lobes.axis_y, -lobes.axis_z], dim=-2)
        lobes = replace(lobes, axes=torch.where(flip[..., None, None], turned, lobes.axes))
    return _quarter_turned(lobes, _quarters(lobes, previous))


def parallel_transport(axes: Tensor, axis_z: Tensor) -> Tensor:
    """Turn frames the shortest way so that their z becomes `axis_z`.

    Args:
        axes: Frames.  [..., 3, 3]
        axis_z: Unit directions.  [..., 3]
    """
    source = axes[..., 2, :]
    cosine = (source * axis_z).sum(-1)[..., None, None]
    cross = torch.linalg.cross(source, axis_z)[..., None, :]
    # Rodrigues' formula; at 180 degrees any half turn does, so the divisor is kept off 0
    along = (axes * cross).sum(-1, keepdim=True) / (1 + cosine).clamp(min=1e-6)
    turned = axes * cosine + torch.linalg.cross(cross.expand_as(axes), axes) + cross * along
    opposite = cosine < -1 + 1e-6
    half_turn = axes * axes.new_tensor([1.0, -1.0, -1.0])[:, None]
    turned = torch.where(opposite, half_turn, turned)
    return orthonormal(torch.cat([turned[..., :2, :], axis_z[..., None, :]], dim=-2))


def transported(axes: Tensor) -> Tensor:
    """Return frames that turn no more than their directions do.  [T, ..., 3, 3]."""
    found = [axes[0]]
    for axis_z in axes[1:, ..., 2, :]:
        found.append(parallel_transport(found[-1], axis_z))
    return torch.stack(found)


def quaternion_from_axes(axes: Tensor) -> Tensor:
    """Convert frames to unit quaternions (w, x, y, z) with w >= 0.  [..., 3, 3] -> [..., 4].

    Of the four ways to write the quaternion, the one with the largest divisor is used, so no
    rotation loses digits [Shepperd 1978, "Quaternion from rotation matrix"].
    """
    m = axes.mT  # columns are the images of +X, +Y, +Z
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    yz, zx, xy = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    yz_, zx_, xy_ = (
        m[..., 2, 1] + m[..., 1, 2],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 0] + m[..., 0, 1],
    )
    candidates = torch.stack(
        [
            torch.stack([1 + xx + yy + zz, yz, zx, xy], dim=-1),
            torch.stack([yz, 1 + xx - yy - zz, xy_, zx_], dim=-1),
            torch.stack([zx, xy_, 1 - xx + yy - zz, yz_], dim=-1),
            torch.stack([xy, zx_, yz_, 1 - xx - yy + zz], dim=-1),
        ],
        dim=-2,
    )  # [..., 4, 4]: row k is 4 q_k (w, x, y, z)
    best = torch.diagonal(candidates, dim1=-2, dim2=-1).argmax(-1)
    chosen = torch.take_along_dim(candidates, best[..., None, None], dim=-2).squeeze(-2)
    quaternion = torch.nn.functional.normalize(chosen, dim=-1)
    return torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def axes_from_quaternion(quaternion: Tensor) -> Tensor:
    """Convert quaternions (w, x, y, z) of any positive length to frames.  [..., 4] -> [..., 3, 3].

    Rows are axis_x, axis_y, axis_z.
    """
    w, x, y, z = torch.nn.functional.normalize(quaternion, dim=-1).unbind(-1)
    axis_x = torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], -1)
    axis_y = torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], -1)
    axis_z = torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], -1)
    return torch.stack([axis_x, axis_y, axis_z], dim=-2)


def continuous_quaternions(quaternions: Tensor) -> Tensor:
    """Flip signs so that neighbouring frames lie in one hemisphere.  [F, N, 4]."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(-1)  # [F - 1, N]
    signs = torch.where(dots < 0, -1.0, 1.0).to(quaternions).cumprod(0)
    return torch.cat([quaternions[:1], quaternions[1:] * signs[..., None]])


def between(start: Tensor, end: Tensor, part: Tensor) -> Tensor:
    """Turn frames evenly from one to another: axis_z along the great circle, and about axis_z.

    Swing and twist are kept apart. Slerp turns about one axis instead, by which a frame that also
    turns about its axis_z leaves the great circle; and how a nearly round lobe turns about itself
    is chance (docs/experiments/2026-11-29-what-moves-between-frames.md).

    Args:
        start: Frames.  [..., 3, 3]
        end: Frames.  [..., 3, 3]
        part: How far, from 0 to 1.  [...]

    Returns:
        Frames.  [..., 3, 3]
    """
    axis, swing, twist = swing_and_twist(start, end)
    return _rotated(_twisted(start, part * twist), axis, part * swing)


def swing_and_twist(start: Tensor, end: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return how frames turn to others.

    Args:
        start: Frames.  [..., 3, 3]
        end: Frames.  [..., 3, 3]

    Returns:
        The axis about which axis_z goes along the great circle, axis_x where the directions are
        opposite [..., 3]; the angle by which it does [...]; and that of the turn about axis_z
        itself [...]. In radians.
    """
    cross = torch.linalg.cross(start[..., 2, :], end[..., 2, :])
    sine = cross.norm(dim=-1)
    swing = torch.atan2(sine, (start[..., 2, :] * end[..., 2, :]).sum(-1))
    # below it the angle is 0 or 180 degrees to rounding: any axis will do that is across
    is_across = (sine > SINE_MIN)[..., None]
    axis = torch.where(is_across, cross / sine.clamp(min=SINE_MIN)[..., None], start[..., 0, :])
    swung = _rotated(start, axis, swing)
    across, along = ((end[..., 0, :] * swung[..., k, :]).sum(-1) for k in (1, 0))
    return axis, swing, torch.atan2(across, along)


def _rotated(axes: Tensor, axis: Tensor, angle: Tensor) -> Tensor:
    """Turn frames about unit axes, by Rodrigues' formula.  [..., 3, 3], [..., 3], [...]."""
    about, angle = axis[..., None, :], angle[..., None, None]
    along = (axes * about).sum(-1, keepdim=True) * about
    across = torch.linalg.cross(about.expand_as(axes), axes)
    return along + (axes - along) * angle.cos() + across * angle.sin()


def _twisted(axes: Tensor, angle: Tensor) -> Tensor:
    """Turn frames about their axis_z.  [..., 3, 3], [...]."""
    axis_x, axis_y, axis_z = axes.unbind(-2)
    cosine, sine = angle.cos()[..., None], angle.sin()[..., None]
    turned = [cosine * axis_x + sine * axis_y, cosine * axis_y - sine * axis_x, axis_z]
    return torch.stack(turned, dim=-2)


def _to_canonical(lobes: Lobes) -> Tensor:
    """Return how many quarters each frame is turned in canonical order: 0 or 1.  [..., N]."""
    return (lobes.sharpness[..., 1] > lobes.sharpness[..., 0]).long()


def _quarters(lobes: Lobes, previous: Lobes) -> Tensor:
    """Return how many quarters bring each frame nearest to the one in `previous`.  [..., N]."""
    along_x = (lobes.axis_x * previous.axis_x).sum(-1) + (lobes.axis_y * previous.axis_y).sum(-1)
    along_y = (lobes.axis_y * previous.axis_x).sum(-1) - (lobes.axis_x * previous.axis_y).sum(-1)
    is_odd = along_y.abs() > along_x.abs()
    return is_odd.long() + 2 * (torch.where(is_odd, along_y, along_x) < 0).long()


def _quarter_turned(lobes: Lobes, quarters: Tensor) -> Lobes:
    """Turn frames about z; with an odd number of quarters the sharpnesses change places.

    Args:
        lobes: [..., N, .]
        quarters: 0 to 3: with one, x becomes y and y becomes -x.  [..., N]
    """
    is_odd, is_half = quarters % 2 == 1, quarters >= 2
    odd = torch.stack([lobes.axis_y, -lobes.axis_x, lobes.axis_z], dim=-2)
    half = torch.ones_like(lobes.axes)
    half[..., :2, :] = torch.where(is_half, -1.0, 1.0).to(half)[..., None, None]
    slant = turned_slant(lobes.slant, is_odd, quarters=1)
    return replace(
        lobes,
        axes=torch.where(is_odd[..., None, None], odd, lobes.axes) * half,
        sharpness=torch.where(is_odd[..., None], lobes.sharpness.flip(-1), lobes.sharpness),
        slant=turned_slant(slant, is_half, quarters=2),
    )
