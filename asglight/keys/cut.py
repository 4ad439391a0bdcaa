# SPDX-License-Identifier: Apache-2.0
"""A frame cut into keys and rest, whose sum is the map.

Cuts are found on a map of `ROWS` rows at most and made on a map of any size: what is found are the
background and, for each key, which share of the light above it the key takes.

Symbols: h, w rows and columns of the map that cuts are found on; H, W of the map that is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from asglight.keys import cutting, levels
from asglight.keys.levels import FILLED, KeyCut, Seen
from asglight.keys.rectangles import Card, Patch
from asglight.keys.spots import Grid, Mask
from asglight.sphere import latlong

ROWS = 256
"""Rows of the map that cuts are found on: texels of 0.7 degrees, a sun and its edge."""

MARGIN_TEXELS = 3
"""Around a matte, in which a card may show light too."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A key of a frame.

    Attributes:
        mask: Its lamp.  [h, w]
        weight: How far it is up, in [0, 1].
        start: The card of the frame before, moved with its lamp; None for a new one.
        floor: As of its cut in the frame before; None for a new one.
    """

    mask: Mask
    weight: float
    start: Card | None = None
    floor: float | None = None


@dataclass(frozen=True, eq=False)
class FrameCut:
    """How a frame is cut.

    Attributes:
        background: What fills the holes.  [h, w, 3] float32
        keys: In the order of what was wanted; None where there is no light to take.
        holes: Where mattes are.  [h, w]
    """

    background: Tensor
    keys: tuple[KeyCut | None, ...]
    holes: Mask


def frame_cut(
    radiance: Tensor, wanted: Sequence[Wanted], others: Sequence[Mask], *, whole: bool = False
) -> FrameCut:
    """Find how a frame is cut.

    Args:
        radiance: The map.  [h, w, 3]
        wanted: Its keys.
        others: Its other lamps, which are no background to what lies beside them.
        whole: Take all of the lamps' light, whatever a plain card can show: cards get a texture,
            and hold the lamps.
    """
    values = radiance.double().numpy()
    grid = Grid.of(*values.shape[:2])
    masks = [*(one.mask for one in wanted), *others]
    luminance = values.mean(-1)
    mattes = [cutting.matte(mask, luminance, grid) for mask in masks]
    shares = cutting.shares(masks, mattes, luminance, grid)
    closed = np.zeros(values.shape[:2], dtype=bool)
    holes = closed.copy()
    for index, matte in enumerate(mattes):
        closed |= matte > 0
        if index < len(wanted):
            holes |= shares[index] > 0
    background = cutting.filled(values, closed, grid)
    background = np.where(holes[..., None], background, values)
    difference = (values - background).mean(-1)
    above, below = np.maximum(difference, 0), np.maximum(-difference, 0)
    shares = [
        np.where(cutting.lights_beside(mask, matte, above, background.mean(-1)), 0, share)
        for mask, matte, share in zip(masks, mattes, shares, strict=True)
    ]
    total = float((values.mean(-1) * grid.solid_angle).sum())
    seen: list[Seen | None] = []
    for one, own in zip(wanted, shares, strict=False):
        near = grid.near(own > 0, MARGIN_TEXELS * grid.texel)
        place = np.flatnonzero(near)
        share = one.weight * own.ravel()[place]
        patch = Patch.of(place, grid)
        lamp = Seen(patch, above.ravel()[place], share, one.start, one.floor, below.ravel()[place])
        seen.append(lamp if lamp.flux > 0 else None)
    lit = [one for one in seen if one is not None]
    chosen = iter(levels.whole(lit) if whole else levels.shown(lit, total))
    return FrameCut(
        torch.from_numpy(background).float(),
        tuple(None if one is None else next(chosen) for one in seen),
        holes,
    )


@dataclass(frozen=True, eq=False)
class Parts:
    """A map in parts.

    Attributes:
        rest: The map without its keys, >= 0.  [H, W, 3]
        flux: Of each key, radiance times solid angle.  [K, 3]
    """

    rest: Tensor
    flux: Tensor


def parts(cut: FrameCut, radiance: Tensor) -> Parts:
    """Cut a map of any size.

    Args:
        cut: How.
        radiance: The map.  [H, W, 3]
    """
    height, width = radiance.shape[:2]
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    rest = radiance.clone()
    flux = torch.zeros(len(cut.keys), 3, dtype=torch.float64)
    for index in range(len(cut.keys)):
        rows, light = light_of(cut, index, radiance)
        flux[index] = (light.double() * solid_angle[rows][..., None]).sum((0, 1))
        rest[rows] -= light
    return Parts(rest.clamp(min=0), flux)


def light_of(cut: FrameCut, index: int, radiance: Tensor) -> tuple[slice, Tensor]:
    """Return what a key takes from a map; where the map is darker than the background, it gives.

    Filters that overshoot leave dark rims around lamps, which are filled so.

    Args:
        cut: How it is cut.
        index: Of the key.
        radiance: The map.  [H, W, 3]

    Returns:
        Rows of the map, and the radiance taken there.  [rows, W, 3]
    """
    key, shape = cut.keys[index], cut.background.shape[:2]
    if key is None:
        return slice(0, 0), radiance[:0]
    image = torch.zeros(shape[0] * shape[1], dtype=torch.float32)
    image[torch.from_numpy(key.place)] = torch.from_numpy(key.share).float()
    share = enlarged(image.view(*shape, 1), len(radiance))
    used = torch.nonzero(share.amax((1, 2)) > 0)[:, 0]
    rows = slice(int(used.min()), int(used.max()) + 1)
    above = radiance[rows] - enlarged(cut.background, len(radiance))[rows]
    mean = above.mean(-1, keepdim=True)
    part = (mean - key.low).clamp(0, key.high) / mean.clamp(min=1e-30)
    light = share[rows] * above * torch.where(mean > 0, part, 1.0)
    solid_angle = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)[rows]
    weight = solid_angle[..., None]
    given = (light.clamp(max=0) * weight).sum((0, 1))  # [3], below 0
    taken = (light.clamp(min=0) * weight).sum((0, 1))
    most = (FILLED * taken / (-given).clamp(min=1e-30)).clamp(max=1)
    return rows, torch.where(light < 0, light * most.to(light), light)


def enlarged(image: Tensor, height: int) -> Tensor:
    """Interpolate a map linearly between its texel centres; what has the size stays as it is.

    Beyond the outermost rows it is theirs, as renderers show it.

    Args:
        image: [h, w, C]
        height: H; W is 2 H.

    Returns:
        [H, W, C]
    """
    rows, columns = image.shape[:2]
    if rows == height:
        return image
    v = ((torch.arange(height, dtype=torch.float64) + 0.5) * rows / height - 0.5).clamp(0, rows - 1)
    u = (torch.arange(2 * height, dtype=torch.float64) + 0.5) * columns / (2 * height) - 0.5
    top, left = v.floor(), u.floor()
    above, below = top.long(), (top.long() + 1).clamp(max=rows - 1)
    image = torch.lerp(image[above], image[below], (v - top).to(image)[:, None, None])
    left_place = left.long() % columns
    part = (u - left).to(image)[:, None]
    return torch.lerp(image[:, left_place], image[:, (left_place + 1) % columns], part)
