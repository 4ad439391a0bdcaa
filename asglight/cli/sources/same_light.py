# SPDX-License-Identifier: Apache-2.0
"""Whether images are those that a stage was fitted to: their light is that of its lobes."""

import math

import torch
from torch import Tensor

from asglight.images import LatlongImage
from asglight.images.message import shown
from asglight.lobes import LobeTracks, asg
from asglight.shots.events import Notice, OnProgress
from asglight.sphere.overlaps import row_solid_angles

LIGHT_OFF = 0.01
"""Of a map's light, that each channel of the lobes may be off without a word. Every preset but
`paper` holds it to less than 1e-4. What lies between is room for maps that were stored anew, in
half floats or with compression that loses."""


class SameLight:
    """Tells of the first frame whose light is not that of the lobes: it may be of another shot.

    Nothing is refused: lobes that somebody has edited, or that the paper's recipe has fitted, need
    not have the light of their images.
    """

    def __init__(
        self, tracks: LobeTracks, stage: str, reference: str, on_progress: OnProgress
    ) -> None:
        """Take the light of every frame.

        Args:
            tracks: The lobes.
            stage: What the stage is called.
            reference: What the images are called.
            on_progress: Called with a `Notice`.
        """
        self._stage, self._reference, self._on_progress = stage, reference, on_progress
        self._frames, self._flux = tracks.frames, asg.flux(tracks.lobes.to("cpu", torch.float64))
        self._has_told = False

    def __call__(self, frame: int, image: LatlongImage) -> None:
        """Compare a frame; one that others stand in for is not what was fitted to."""
        if self._has_told or image.repair.filled_from:
            return
        lobes = self._flux[self._frames.index(frame)].sum(0)
        off = light_off(lobes, _flux_of_map(image.radiance))
        if off > LIGHT_OFF:
            self._has_told = True
            self._on_progress(
                Notice(
                    f"{shown(self._reference)}: its light at frame {frame} is {_words(off)} that "
                    f"of the lobes of {shown(self._stage)}; are these the images that it was "
                    "fitted to?"
                )
            )


def light_off(lobes: Tensor, image: Tensor) -> float:
    """Return how far the flux of lobes is off that of a map, over the mean of its channels.

    Args:
        lobes: [3]
        image: [3]
    """
    most, mean = float((lobes - image).abs().max()), float(image.mean())
    return most / mean if mean > 0 else float("inf") if most > 0 else 0.0


def _words(off: float) -> str:
    """Return in words how far light is off; of a black map there is no share."""
    return f"{100 * off:.3g} % off" if math.isfinite(off) else "none, unlike"


def _flux_of_map(radiance: Tensor) -> Tensor:
    """Return the flux of a map.  [H, W, 3] -> [3]."""
    solid_angle = torch.from_numpy(row_solid_angles(*radiance.shape[:2]))  # of a texel of each row
    return solid_angle @ radiance.sum(1, dtype=torch.float64)
