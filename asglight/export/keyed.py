# SPDX-License-Identifier: Apache-2.0
"""Keys and rest as numbers for engines: rectangles of one radiance, and spherical harmonics.

The irradiance of the rest is a polynomial of the normal (x, y, z),

    c0 + c1 y + c2 z + c3 x + c4 x y + c5 y z + c6 (3 z^2 - 1) + c7 x z + c8 (x^2 - y^2),

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
        half_sizes: Tangents of the cards' half angles.  [F, K, 2]
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


def facing_irradiance(half_sizes: Tensor) -> Tensor:
    """Return the irradiance of cards of radiance 1 on a surface that faces them.

    Four times that of a rectangle with a corner above the surface [Howell, "A Catalog of Radiation
    Heat Transfer Configuration Factors", B-4], of the tangents p and q:

        2 (p / sqrt(1 + p^2) atan(q / sqrt(1 + p^2)) + q / sqrt(1 + q^2) atan(p / sqrt(1 + q^2)))

    Args:
        half_sizes: Tangents of half angles.  [..., 2]

    Returns:
        [...]
    """
    p, q = half_sizes.unbind(-1)
    of_p, of_q = (1 + p * p).sqrt(), (1 + q * q).sqrt()
    return 2 * (p / of_p * torch.atan(q / of_p) + q / of_q * torch.atan(p / of_q))


def key_rows(light: KeyedLight) -> Iterable[tuple[str, dict[str, Tensor]]]:
    """Yield the name of each key, and its values at every frame."""
    if light.keys is None:
        return
    lobes = light.keys.lobes.to("cpu", torch.float64)
    p, q = light.half_sizes.unbind(-1)
    solid_angle = 4 * torch.atan(p * q / (1 + p * p + q * q).sqrt())
    radiance = asg.flux(lobes) / solid_angle[..., None]
    facing = facing_irradiance(light.half_sizes)[..., None] * radiance
    for index, name in enumerate(light.keys.names):
        yield (
            name,
            {
                "center": lobes.axis_z[:, index],
                "axis_x": lobes.axes[:, index, 0],
                "axis_y": lobes.axes[:, index, 1],
                "half_size": light.half_sizes[:, index],
                "radiance": radiance[:, index],
                "irradiance": facing[:, index],
            },
        )


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
