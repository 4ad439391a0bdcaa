# SPDX-License-Identifier: Apache-2.0
"""Keys and rest of a map as a method of the comparison: an image and a few lights.

It keeps to no budget: its rest has as many numbers as the map. Its size is that of its files.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from asglight.images import write_exr
from asglight.keys import following, texture
from asglight.keys.cut import Wanted, frame_cut, light_of, parts
from asglight.keys.rectangles import Card
from asglight.keys.sighting import sightings
from asglight.lobes.rectangles import Rectangles
from asglight.sphere import latlong

FLOATS = 10
"""Of a key: place 2, frame 3, size 2, RGB 3."""

POINTS = 1024
"""On a card, each way, that its light is gathered from: a hundred across a texel of a card of seven
degrees, more of a smaller card."""


@dataclass(frozen=True)
class KeyLight:
    """A key.

    Attributes:
        card: Its rectangle.
        flux: Radiance times solid angle.  [3]
        image: What it shows, of mean 1; None where it is even.  [M, N, 3]
    """

    card: Card
    flux: Tensor
    image: Tensor | None


@dataclass(frozen=True)
class Keyed:
    """A map as keys and rest.

    Attributes:
        keys: The keys.
        rest: The map without them.  [H, W, 3]
        bytes: Of the images that a stage would have, and four a number of each key.
    """

    keys: tuple[KeyLight, ...]
    rest: Tensor
    bytes: int

    @property
    def floats(self) -> int:
        """Numbers that it takes to store this."""
        images = [self.rest, *(key.image for key in self.keys if key.image is not None)]
        return FLOATS * len(self.keys) + sum(image.numel() for image in images)

    def texel_means(self, height: int, width: int) -> Tensor:
        """Return the mean radiance over each texel of a latlong grid.  [H, W, 3]."""
        found = latlong.reduce(self.rest, height, width).clone()
        for key in self.keys:
            found += gathered(key.card.rectangle, key.flux, key.image, height, width)
        return found


def cut(radiance: Tensor, *, textured: bool) -> Keyed:
    """Cut a map into keys, as many as `asglight keys` finds, and rest.

    Args:
        radiance: Repaired.  [H, W, 3]
        textured: Whether keys carry the pixels of their lamps.
    """
    seen = sightings(radiance)
    lamps = [track.seen[0] for track in following.keys([seen])]

    def masks(of: Sequence[following.Sighting]) -> list[np.ndarray]:
        found = np.zeros((len(of), radiance[..., 0].numel()), dtype=bool)
        for mask, one in zip(found, of, strict=True):
            mask[one.place] = True
        return [mask.reshape(radiance.shape[:2]) for mask in found]

    wanted = [Wanted(mask, 1.0) for mask in masks(lamps)]
    others = masks([one for one in seen if all(one is not lamp for lamp in lamps)])
    found = frame_cut(radiance, wanted, others, whole=textured)
    divided = parts(found, radiance)
    keys = []
    for index, (key, flux) in enumerate(zip(found.keys, divided.flux, strict=True)):
        if key is not None:
            image = None
            if textured:
                rows, light = light_of(found, index, radiance)
                shape = texture.size(key.card, len(radiance))
                image = texture.rectified(key.card, shape, light, rows.start)
            keys.append(KeyLight(key.card, flux, image))
    return Keyed(tuple(keys), divided.rest, _bytes(divided.rest, keys))


def gathered(
    card: Rectangles, flux: Tensor, image: Tensor | None, height: int, width: int
) -> Tensor:
    """Return the mean radiance over each texel that a card shows.

    Args:
        card: One rectangle.
        flux: Radiance times solid angle.  [3]
        image: What it shows, of mean 1; None where it is even.  [M, N, 3]
        height: Rows of the map.
        width: Its columns.

    Returns:
        [H, W, 3]
    """
    step = 1 - 2 * (torch.arange(POINTS, dtype=torch.float64) + 0.5) / POINTS
    y, x = torch.meshgrid(step, step, indexing="ij")
    seen = card.points(x.flatten(), y.flatten()).view(POINTS, POINTS, 3)
    u, v = latlong.uv_from_direction(seen)
    place = (v * height).long().clamp(max=height - 1) * width + (u * width).long() % width
    light = (seen.norm(dim=-1, keepdim=True) ** -3).expand(-1, -1, 3)
    if image is not None:
        rows, columns = image.shape[:2]
        row = torch.arange(POINTS) * rows // POINTS
        column = torch.arange(POINTS) * columns // POINTS
        light = light * image[row[:, None], column].double()
    light = light * (flux / light.sum((0, 1)))
    found = torch.zeros(height * width, 3, dtype=torch.float64)
    found.index_add_(0, place.flatten(), light.reshape(-1, 3))
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    return (found.view(height, width, 3) / solid_angle[..., None]).float()


def _bytes(rest: Tensor, keys: Sequence[KeyLight]) -> int:
    images = [rest, *(key.image for key in keys if key.image is not None)]
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        path = Path(folder) / "image.exr"
        size = 4 * FLOATS * len(keys)
        for image in images:
            write_exr(path, image)
            size += path.stat().st_size
    return size
