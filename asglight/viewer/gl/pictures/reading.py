# SPDX-License-Identifier: Apache-2.0
"""Pictures read back: radiance before any view. All of it waits for the GPU."""

import moderngl
import numpy as np

from asglight.viewer.gl.passes import Picture
from asglight.viewer.state.display import Comparison


def texel(
    context: moderngl.Context, texture: moderngl.Texture, x: float, y: float
) -> np.ndarray | None:
    """Read the radiance at a place of a picture alone; None where nothing is.  [3]."""
    width, height = texture.size
    place = min(int(x * width), width - 1), min(int(y * height), height - 1)
    target = context.framebuffer([texture])
    texel = np.frombuffer(target.read((*place, 1, 1), components=4, dtype="f4"), np.float32)
    return texel[:3] / texel[3] if texel[3] > 0 else None


def compared(shown: Comparison, fit: np.ndarray, reference: np.ndarray, wipe: float) -> np.ndarray:
    """Return the radiance of one picture of two.  [H, W, 3]."""
    at = round(wipe * fit.shape[1])
    if shown is Comparison.WIPE:
        return np.concatenate([fit[:, :at], reference[:, at:]], axis=1)
    if shown is Comparison.DIFFERENCE:
        return fit - reference
    if shown is Comparison.RATIO:
        with np.errstate(over="ignore"):  # over black it is infinite
            return fit / np.maximum(reference, np.finfo(np.float32).tiny)
    return fit if shown is Comparison.FIT else reference


def composed(picture: Picture) -> np.ndarray:
    """Return balls over their background, if there is one, row 0 at the top.  [H, W, 3]."""
    front = pixels(picture.front)
    radiance = front[..., :3]
    if picture.background is None:
        return radiance
    return radiance + (1 - front[..., 3:]) * pixels(picture.background)[..., :3]


def pixels(texture: moderngl.Texture) -> np.ndarray:
    """Return radiance times coverage, and coverage, row 0 at the top.  [H, W, 4]."""
    width, height = texture.size
    return np.frombuffer(texture.read(), np.float32).reshape(height, width, 4)
