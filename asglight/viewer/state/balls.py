# SPDX-License-Identifier: Apache-2.0
"""The balls of the row: what each is made of. Plain data that every pass takes."""

from dataclasses import dataclass, replace
from enum import StrEnum

from asglight.shading.balls import ROUGHNESS

Rgb = tuple[float, float, float]


class Material(StrEnum):
    """What the row is made of."""

    METAL = "metal"
    """Reflects with F0 = the base colour; no diffuse light."""
    DIELECTRIC = "dielectric"
    """Reflects with F0 = 0.04, that of glass and plastic, over diffuse light."""


@dataclass(frozen=True)
class Ball:
    """One ball: GGX with Schlick's Fresnel term over a Lambertian base.

    The radiance towards the camera is that of the GGX layer plus `albedo / pi` times the irradiance
    times what the layer lets through, `1 - (f0 A + B)`, where A and B are the two parts of the
    layer's directional albedo.

    Attributes:
        roughness: Perceptual; alpha is its square. None: no layer, a Lambertian ball.
        f0: Reflectance of the layer seen along the normal, RGB.
        albedo: Diffuse reflectance of the base, RGB.
    """

    roughness: float | None
    f0: Rgb = (1.0, 1.0, 1.0)
    albedo: Rgb = (0.0, 0.0, 0.0)

    @property
    def name(self) -> str:
        """What the ball is called."""
        return "Lambert" if self.roughness is None else f"roughness {self.roughness:g}"


WHITE: Rgb = (1.0, 1.0, 1.0)
F0_DIELECTRIC: Rgb = (0.04, 0.04, 0.04)


def ball_row(material: Material = Material.METAL, base_colour: Rgb = WHITE) -> tuple[Ball, ...]:
    """Return the row from mirror to matte, and a Lambertian ball last."""
    metal = Ball(ROUGHNESS[0], f0=base_colour)
    dielectric = Ball(ROUGHNESS[0], f0=F0_DIELECTRIC, albedo=base_colour)
    first = metal if material is Material.METAL else dielectric
    layered = [replace(first, roughness=roughness) for roughness in ROUGHNESS]
    return (*layered, Ball(None, albedo=base_colour))
