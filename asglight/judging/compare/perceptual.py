# SPDX-License-Identifier: Apache-2.0
"""How different two rows of balls look: PSNR on a screen, and HDR-FLIP.

HDR-FLIP [Andersson, Nilsson, Shirley and Akenine-Möller 2021, "Visualizing errors in rendered high
dynamic range images", Eurographics short papers] is computed by NVIDIA's own package
flip-evaluator, which `asglight[report]` installs; without it there is no such number.
"""

import importlib
import math

import numpy as np
from torch import Tensor

from asglight.judging.pictures.display import ball_exposure_stops, view_transform
from asglight.shading.balls import coverage


def psnr(balls: Tensor, reference: Tensor) -> float:
    """Return the peak signal-to-noise ratio of what a screen shows, in decibels.

    Both are seen at the exposure of the reference, in 8-bit sRGB as on every sheet; the peak is
    display white. Pixels beside the balls do not count. Equal pictures have an infinite ratio.

    Args:
        balls: Linear.  [R, S, S, 3]
        reference: The same under the reference.  [R, S, S, 3]
    """
    stops = ball_exposure_stops(reference[None])
    inside = (coverage(reference.shape[1]) > 0).numpy()
    shown, wanted = (view_transform(b, stops)[:, inside].astype(float) for b in (balls, reference))
    error = float(np.square(shown - wanted).mean())
    return 10 * math.log10(255**2 / error) if error > 0 else math.inf


def hdr_flip(balls: Tensor, reference: Tensor) -> float | None:
    """Return the mean HDR-FLIP error over the balls, 0 to 1; None where it is not installed.

    The balls stand side by side; exposures, tone mapper and 67 pixels a degree are the package's
    defaults. Negative radiance counts as 0.

    Args:
        balls: Linear.  [R, S, S, 3]
        reference: The same under the reference, with some light.  [R, S, S, 3]
    """
    try:
        package = importlib.import_module("flip_evaluator")
    except ModuleNotFoundError:
        return None
    shown, wanted = (
        np.ascontiguousarray(np.concatenate(list(b.clamp(min=0).float().numpy()), axis=1))
        for b in (balls, reference)
    )
    errors, _, _ = package.evaluate(wanted, shown, "HDR", applyMagma=False)
    inside = np.tile(coverage(reference.shape[1]).numpy() > 0, (1, len(balls)))
    return float(errors[..., 0][inside].mean())
