# SPDX-License-Identifier: Apache-2.0
"""What is rendered: white balls seen from two sides. Shared by the renderers and their judge.

Directions are asglight's: right-handed, +Y up, distances never matter. A picture is S pixels
square, orthographic, its ball fills it. Pixels are points: every renderer is asked for the radiance
at pixel centres, not for means over pixels, so that the judge knows the normal of each exactly.
NumPy only, because the interpreters of the renderers have nothing else.
"""

import numpy as np
from numpy.typing import NDArray

MATERIALS: dict[str, float | None] = {"matte": None, "r0.5": 0.5, "r0.25": 0.25}
"""Lambertian of albedo 1; GGX of Fresnel reflectance 1 and this roughness, alpha its square."""

VIEWS = {"front": (0.0, 0.0, 1.0), "back": (0.0, 0.0, -1.0)}
"""From the ball to the camera, so that together they see every normal."""

COS_EDGE = 0.3
"""Least n.v of a pixel that is judged. Beyond, which is 9 % of the ball's image, one pixel of 32
spans twelve degrees, and the polygons of which renderers make balls are seen edge-on."""


def camera_frame(view: str) -> NDArray[np.float64]:
    """Return rows right, up, towards the camera.  [3, 3]."""
    towards = np.array(VIEWS[view])
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(up, towards), up, towards])


def pixel_places(size: int) -> NDArray[np.float64]:
    """Return (right, up) of the pixel centres; the ball has radius 1.  [size, size, 2]."""
    centre = (2 * np.arange(size) + 1) / size - 1
    right, up = np.meshgrid(centre, -centre)
    return np.stack([right, up], axis=-1)


def judged(size: int) -> NDArray[np.bool_]:
    """Tell which pixels are judged.  [size, size]."""
    return (pixel_places(size) ** 2).sum(-1) <= 1 - COS_EDGE**2


def normals(size: int, view: str) -> NDArray[np.float64]:
    """Return the ball's normals at the judged pixels, row by row.  [P, 3]."""
    places = pixel_places(size)[judged(size)]
    depth = np.sqrt(1 - (places**2).sum(-1, keepdims=True))
    return np.concatenate([places, depth], axis=-1) @ camera_frame(view)
