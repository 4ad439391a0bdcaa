# SPDX-License-Identifier: Apache-2.0
"""Keys and rest as numbers for engines: rectangles of one radiance, and spherical harmonics.

The irradiance of the rest is a polynomial of the normal (x, y, z),

    c0 + c1 y + c2 z + c3 x + c4 x y + c5 y z + c6 (3 z^2 - 1) + c7 x z + c8 (x^2 - y^2),

and 0 where that is negative (shaders/export/rest.glsl),

all factors of the harmonics and of Lambert's cosine in its coefficients [Ramamoorthi and Hanrahan
2001, "An Efficient Representation for Irradiance Environment Maps", equation 7 and section 3.1]:
with A_l that of the cosine and N_k that of the harmonic, c_k = A_l N_k^2 times the integral of the
radiance times the k-th polynomial.

Symbols: F frames, K keys; H, W rows and columns of a map.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Lobes, LobeTracks, asg
from asglight.lobes.rectangles import Rectangles, rectangles
from asglight.sphere import latlong

TERMS = 9
"""Of the polynomial: harmonics up to degree 2."""

FACTORS = (1 / 4, 1 / 2, 1 / 2, 1 / 2, 15 / 16, 15 / 16, 5 / 64, 15 / 16, 15 / 64)
"""A_l N_k^2, with A = pi, 2 pi / 3, pi / 4 and N_k^2 = 1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4 over
4 pi."""


@dataclass(frozen=True)
class KeyedLight:
    """Keys and rest of a shot.

    Attributes:
        keys: The lobes of the keys' cards; None without keys.
        half_sizes: Tangents of the half angles of the cards, did they face the origin.  [F, K, 2]
        frames: Frame numbers.  F
        fps: Frames per second.
        images: Files of the rest, one a frame; those within a package as `a.usdz[b.exr]`.
        irradiance: Of the rest, coefficients.  [F, 9, 3]
    """

    keys: LobeTracks | None
    half_sizes: Tensor
    frames: tuple[int, ...]
    fps: float
    images: tuple[str, ...]
    irradiance: Tensor

    @property
    def lit_tracks(self) -> LobeTracks:
        """Return the keys, or a black lobe where there are none."""
        if self.keys is not None:
            return self.keys
        count = len(self.frames)
        axes = torch.eye(3).expand(count, 1, 3, 3)
        black = Lobes(axes, torch.ones(count, 1, 2), torch.zeros(count, 1, 3))
        return LobeTracks(self.frames, self.fps, black)

    def of_frames(self, places: Sequence[int], irradiance: Tensor) -> "KeyedLight":
        """Return the light of some frames.

        Args:
            places: Of the frames.
            irradiance: Of the rest in these frames.  [F', 9, 3]
        """
        chosen = list(places)
        frames = tuple(self.frames[place] for place in chosen)
        keys = self.keys
        if keys is not None:
            keys = replace(keys, frames=frames, lobes=keys.lobes[chosen])
        return KeyedLight(
            keys,
            self.half_sizes[chosen],
            frames,
            self.fps,
            tuple(self.images[place] for place in chosen),
            irradiance,
        )


def irradiance_terms(radiance: Tensor) -> Tensor:
    """Return the coefficients of a map's irradiance.

    Args:
        radiance: [H, W, 3]

    Returns:
        [9, 3] float64
    """
    height, width = radiance.shape[:2]
    directions = latlong.directions(height, width, dtype=torch.float64)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    values = polynomials(directions) * solid_angle[..., None]
    integrals = torch.einsum("hwk,hwc->kc", values, radiance.double())
    return torch.tensor(FACTORS, dtype=torch.float64)[:, None] * integrals


def polynomials(directions: Tensor) -> Tensor:
    """Return the nine polynomials.  [..., 3] -> [..., 9]."""
    x, y, z = directions.unbind(-1)
    terms = (torch.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y)
    return torch.stack(terms, dim=-1)


def key_rows(light: KeyedLight) -> Iterable[tuple[str, dict[str, Tensor]]]:
    """Yield the name of each key, and its values at every frame."""
    if light.keys is None:
        return
    found = rectangles_of(light.keys.lobes, light.half_sizes)
    flux = asg.flux(light.keys.lobes.to("cpu", torch.float64))
    radiance = flux / found.solid_angle()[..., None]
    facing = found.irradiance()[..., None] * radiance
    for index, name in enumerate(light.keys.names):
        yield (
            name,
            {
                "center": found.middle[:, index],
                "axis_x": found.axes[:, index, 0],
                "axis_y": found.axes[:, index, 1],
                "half_size": found.half[:, index],
                "radiance": radiance[:, index],
                "irradiance": facing[:, index],
            },
        )


def rectangles_of(keys: Lobes, half_sizes: Tensor) -> Rectangles:
    """Return the cards of keys where they stand, in float64.

    Args:
        keys: The keys.  [F, K, .]
        half_sizes: Tangents of the half angles of the cards that face the origin.  [F, K, 2]
    """
    lobes = keys.to("cpu", torch.float64)
    return rectangles(lobes.axes, half_sizes, lobes.slant)


def relative(images: Sequence[str], folder: Path) -> list[str]:
    """Return how a file in a folder names images, with slashes."""
    found = []
    for image in images:
        try:
            name = os.path.relpath(image, os.path.abspath(folder))
        except ValueError:  # another drive of Windows
            name = image
        found.append(Path(name).as_posix())
    return found


def rest_row(light: KeyedLight, folder: Path) -> dict[str, Any]:
    """Return the rest as JSON values."""
    numbers = np.asarray(light.irradiance.float())
    return {
        "images": relative(light.images, folder),
        "irradiance_sh": [[[float(str(v)) for v in row] for row in one] for one in numbers],
    }
