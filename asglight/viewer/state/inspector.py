# SPDX-License-Identifier: Apache-2.0
"""What lies under the pointer: radiance, stops, direction, and the lobes that send the light."""

import math

import numpy as np
import torch

from asglight.lobes import asg
from asglight.luminance import LUMINANCE, luminance
from asglight.sphere import latlong
from asglight.viewer.gl.arrangement import Hit
from asglight.viewer.state import picking
from asglight.viewer.state.display import MIDDLE_GREY, Subject
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Inspected
from asglight.viewer.uniforms import key_cards

SHARE_MIN = 0.01
"""Lobes that send less than a hundredth of the light are not named."""


def inspect_map(state: ViewerState, u: float, v: float) -> Inspected:
    """Return what the map holds at a place, from the numbers themselves.

    Args:
        state: The session.
        u: Share of the map's width from the left.
        v: Share of its height from the top.
    """
    direction = latlong.direction_from_uv(torch.tensor(u), torch.tensor(v))
    gain = 2.0**state.environment.intensity_ev
    image = state.reference_image
    reference = None if image is None else _texel(image, u, v) * gain
    if state.against is not None and state.subject is Subject.AGAINST:
        reference = state.against.radiance(state.playback.time, direction).numpy() * gain
    if state.keyed is None:
        fit = asg.evaluate(state.lit_lobes, direction[None])[0].numpy() * gain
    else:
        fit = _keyed(state, u, v) * gain
    return Inspected("map", direction.numpy(), fit, reference, shares(state, direction.numpy()))


def _texel(image: np.ndarray, u: float, v: float) -> np.ndarray:
    height, width = image.shape[:2]
    return image[min(int(v * height), height - 1), min(int(u * width), width - 1)]


def _keyed(state: ViewerState, u: float, v: float) -> np.ndarray:
    """Return what keys and rest show at a place.  [3]."""
    rest = state.rest_image
    radiance = np.zeros(3, np.float32) if rest is None else _texel(rest, u, v)
    direction = latlong.direction_from_uv(torch.tensor(u), torch.tensor(v))
    return radiance + key_cards.radiance(state.lit_lobes, direction).numpy()


def inspect_ball(
    state: ViewerState,
    name: str,
    hit: Hit,
    fit: np.ndarray | None,
    reference: np.ndarray | None,
) -> Inspected:
    """Return what a ball shows, whose radiance the passes have drawn.

    Args:
        state: The session.
        name: The ball's.
        hit: The point of the ball.
        fit: Radiance there without the environment's intensity.  [3]
        reference: The same of the reference.  [3]
    """
    direction = state.camera.from_environment().T @ hit.mirrored
    gain = 2.0**state.environment.intensity_ev
    return Inspected(
        name,
        direction,
        None if fit is None else fit * gain,
        None if reference is None else reference * gain,
        shares(state, direction),
    )


def shares(state: ViewerState, direction: np.ndarray) -> list[tuple[int, float]]:
    """Return the lit lobes that send light from a direction, with their share of its luminance."""
    radiance = picking.contributions(state.lit_lobes, direction.tolist())
    share = luminance(radiance)
    share = share / share.sum().clamp(min=torch.finfo(share.dtype).tiny)  # no light: shares of 0
    order = picking.brightest_first(radiance)
    return [(state.lit[i], float(share[i])) for i in order if share[i] >= SHARE_MIN]


def as_text(inspected: Inspected, names: tuple[str, ...]) -> str:
    """Return what is read at the probe as lines to paste elsewhere: numbers apart by tabs.

    Args:
        inspected: What is read.
        names: Of the lobes.
    """
    azimuth, elevation = angles_deg(inspected.direction)
    lines = [
        f"place\t{inspected.place}",
        f"azimuth, elevation (deg)\t{azimuth:.3f}\t{elevation:.3f}",
        "direction\t" + "\t".join(f"{value:.6f}" for value in inspected.direction),
    ]
    for name, radiance in (("fit", inspected.fit), ("reference", inspected.reference)):
        if radiance is not None:
            lines.append(f"{name} (RGB)\t" + "\t".join(f"{value:.7g}" for value in radiance))
    lines += [f"{names[lobe]}\t{share:.4f}" for lobe, share in inspected.shares]
    return "\n".join(lines)


def stops(radiance: np.ndarray) -> float:
    """Return the luminance of a radiance in stops from middle grey; -inf for black."""
    level = float(radiance @ LUMINANCE)
    return math.log2(level / MIDDLE_GREY) if level > 0 else -math.inf


def angles_deg(direction: np.ndarray) -> tuple[float, float]:
    """Return azimuth (0 at +Z, 90 at +X) and elevation of a direction, in degrees."""
    x, y, z = direction
    return math.degrees(math.atan2(x, z)), math.degrees(math.atan2(y, math.hypot(x, z)))
