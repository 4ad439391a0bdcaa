# SPDX-License-Identifier: Apache-2.0
"""What keys are, in numbers that a lighting artist reads: share, size, colour, stops, and the rim.

Symbols: K keys; h, w rows and columns of the map that cuts are found on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.keys.cut import FrameCut, Parts
from asglight.keys.following import Track
from asglight.keys.spots import Array, Grid, Mask
from asglight.sphere import latlong

RIM_TEXELS = 2.5
"""Width of the bands on both sides of a matte's rim whose gradients are compared."""

RIM_DARK = 0.05
"""Of the median around a matte, that is added to radiance before its logarithm: an eye that is used
to the surroundings tells nothing in what is far darker."""

RIM_STAYS = 0.1
"""Logarithm of the rest over the map without all of the lamps' light, above which it is lamp."""

RIM_BESIDE = 1.5
"""Texels: those that touch one, also by a corner."""

RIM_UNSEEN = 0.01
"""Logarithm of radiance from texel to texel that no eye sees, Weber's fraction: no gradient around
a matte counts as less."""


@dataclass(frozen=True)
class KeyFrame:
    """A key in a frame.

    Attributes:
        key: Which.
        share: Of the map's light that it has.
        color: Its light, the largest component 1.
        size_deg: Of its card as it is seen, the longer side first.
        carried: Share of its lamp's light that it has.
        apart: Share of its light that the card shows elsewhere than the map does, both ways.
        rim: As of `rim_gradients`.
    """

    key: int
    share: float
    color: tuple[float, float, float]
    size_deg: tuple[float, float]
    carried: float
    apart: float
    rim: float


def of_frame(
    radiance: Tensor, found: Parts, cut: FrameCut, chosen: Sequence[int]
) -> list[KeyFrame]:
    """Describe the keys of a frame.

    Args:
        radiance: The map.  [H, W, 3]
        found: Its parts.
        cut: How it was cut.
        chosen: Which of the shot's keys those of the cut are.
    """
    height, width = radiance.shape[:2]
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    total = float((radiance.double().mean(-1) * solid_angle).sum())
    shape = cut.background.shape[:2]
    rims = rim_gradients(latlong.reduce(radiance, *shape), latlong.reduce(found.rest, *shape), cut)
    described = []
    for index, key, flux, rim in zip(chosen, cut.keys, found.flux, rims, strict=True):
        if key is None or not float(flux.sum()) > 0:
            continue
        size = np.sort(np.degrees(2 * np.arctan(key.card.seen_extent)))[::-1]
        described.append(
            KeyFrame(
                index,
                float(flux.mean()) / total,
                tuple((flux / flux.max()).tolist()),
                (float(size[0]), float(size[1])),
                key.carried,
                key.apart,
                rim,
            )
        )
    return described


def rim_gradients(radiance: Tensor, rest: Tensor, cut: FrameCut) -> list[float]:
    """Compare the rest within the rim of each matte with the map just outside of it.

    Gradients are those of the logarithm of radiance: an eye sees ratios. What a key leaves of its
    lamp, because its card cannot show it, is no seam and does not count; nor do lights beside it.

    Args:
        radiance: The map.  [h, w, 3]
        rest: Without the keys.  [h, w, 3]
        cut: How it was cut.

    Returns:
        For each key the mean gradient within over the one outside: an edge would be above 1.
    """
    grid = Grid.of(*cut.holes.shape)
    before, after = (image.double().mean(-1).numpy() for image in (radiance, rest))
    plate = _plate(before, cut)
    found = []
    for key in cut.keys:
        if key is None:
            found.append(0.0)
            continue
        own = np.zeros(cut.holes.shape, dtype=bool)
        own.ravel()[key.place[key.share > 0]] = True
        around = grid.near(own, RIM_TEXELS * grid.texel) & ~cut.holes
        if not around.any():
            found.append(0.0)
            continue
        rim = own & grid.near(around, RIM_TEXELS * grid.texel)
        dark = max(RIM_DARK * float(np.median(before[around])), float(np.finfo(np.float32).tiny))
        stays = np.log((after + dark) / (plate + dark)) > RIM_STAYS
        other = stays | (cut.holes & ~own)
        if other.any():
            rim &= ~grid.near(other, RIM_BESIDE * grid.texel)
        within, outside = (_gradient(np.log(one + dark), grid) for one in (after, before))
        least = RIM_UNSEEN / grid.texel
        found.append(_mean(within, rim, grid) / max(_mean(outside, around, grid), least))
    return found


def _plate(luminance: Array, cut: FrameCut) -> Array:
    """Return the map with all light of the keys' lamps taken.  [h, w]."""
    share = np.zeros(luminance.size)
    for key in cut.keys:
        if key is not None:
            share[key.place] += key.share
    background = cut.background.double().mean(-1).numpy()
    return luminance + share.reshape(luminance.shape) * (background - luminance)


def _gradient(values: Array, grid: Grid) -> Array:
    """Return the length of the gradient, by differences to the next texels.  [h, w]."""
    latitude = np.arcsin(np.clip(grid.directions[:, :1, 1], -1, 1))
    down = np.diff(values, axis=0, append=values[-1:]) / grid.texel
    right = (np.roll(values, -1, axis=1) - values) / (grid.texel * np.cos(latitude))
    return np.hypot(down, right)


def _mean(values: Array, mask: Mask, grid: Grid) -> float:
    if not mask.any():
        return 0.0
    weight = grid.solid_angle[mask]
    return float((values[mask] * weight).sum() / weight.sum())


def document(
    frames: Sequence[Sequence[KeyFrame]],
    numbers: Sequence[int],
    names: Sequence[str],
    tracks: Sequence[Track],
) -> dict[str, Any]:
    """Return the keys of a shot as JSON values, the one with most light first.

    Args:
        frames: The keys of each frame.
        numbers: Of the frames.
        names: Of the keys.
        tracks: Their lamps.
    """
    rows = []
    for index, (name, track) in enumerate(zip(names, tracks, strict=True)):
        mine = [one for frame in frames for one in frame if one.key == index]
        weight = np.array([one.share for one in mine])
        mean = _Mean(mine, weight)
        rows.append(
            {
                "name": name,
                "share": float(weight.sum()) / len(frames),
                "share_max": float(weight.max(initial=0)),
                "size_deg": mean.of("size_deg"),
                "color": mean.of("color"),
                "stops": float(np.median([one.stops for one in track.seen.values()])),
                "carried": mean.of("carried"),
                "apart": mean.of("apart"),
                "rim": mean.of("rim"),
                "frames": [numbers[track.first], numbers[track.last]],
            }
        )
    keyed = [sum(one.share for one in frame) for frame in frames]
    return {
        "share": sum(keyed) / len(frames),
        "share_min": min(keyed),
        "share_max": max(keyed),
        "keys": rows,
    }


class _Mean:
    """Means over the frames of a key, weighted by its share."""

    def __init__(self, frames: Sequence[KeyFrame], weight: Array) -> None:
        self._frames, self._weight = frames, weight

    def of(self, name: str) -> Any:
        """Return the mean of an attribute; None for a key that never had light."""
        if not self._weight.sum() > 0:
            return None
        values = np.array([getattr(one, name) for one in self._frames])
        return (np.tensordot(self._weight, values, 1) / self._weight.sum()).tolist()
