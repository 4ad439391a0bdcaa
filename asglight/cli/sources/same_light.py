# SPDX-License-Identifier: Apache-2.0
"""Whether images are those that a stage was fitted to: their light is that of its lobes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from asglight.cli.commands.info import RESAMPLED
from asglight.errors import InputError
from asglight.images import LatlongImage
from asglight.images.message import shown
from asglight.lobes import LobeTracks, asg
from asglight.shots.events import Notice, OnProgress
from asglight.sphere.overlaps import row_solid_angles

if TYPE_CHECKING:
    from asglight.usd import Reading

LIGHT_OFF = 0.01
"""Of a map's light, that each channel of the lobes may be off. The fit holds it to rounding, less
than 1e-4 in every preset but `paper`, whose stages say by how much they are off. What lies between
is room for maps that were stored anew, in half floats or with compression that loses."""


class SameLight:
    """Compares the light of images with that of the lobes, frame by frame.

    Images of another light are refused. Where lobes need not have that of their images, because
    somebody has edited them, a line tells of the first frame that differs: the stage stays of use.
    """

    def __init__(
        self, stage: str, reading: "Reading", reference: str, on_progress: OnProgress
    ) -> None:
        """Take the light of every frame.

        Args:
            stage: What the stage is called.
            reading: What it holds.
            reference: What the images are called.
            on_progress: Called with a `Notice`.
        """
        tracks = reading.tracks
        self._stage, self._reference, self._on_progress = stage, reference, on_progress
        self._frames, self._flux = tracks.frames, flux_of(tracks)
        rows = [{"frames": tracks.frames, **tracks.metadata}, *tracks.metadata.get("parts", [])]
        self._stated = _stated(rows)
        repairs = [row["repairs"] for row in rows if "repairs" in row]
        self._filled = {frame for one in repairs for frame in one["frames_filled"]}
        self._free = _free(tracks.metadata, reading.changes)
        self._has_told = False

    def __call__(self, frame: int, image: LatlongImage) -> None:
        """Compare a frame; one that others stand in for is not what was fitted to, so it passes.

        Raises:
            InputError: The images are not those of the stage.
        """
        if image.repair.filled_from or self._has_told:
            return
        lobes = self._flux[self._frames.index(frame)]
        off = light_off(lobes, _flux_of_map(image.radiance), self._stated.get(frame, 0.0))
        if off <= LIGHT_OFF:
            return
        finding = (
            f"{shown(self._reference)}: its light at frame {frame} is {100 * off:.3g} % off that "
            f"of the lobes of {shown(self._stage)}"
        )
        why = "which were filled in there" if frame in self._filled else self._free
        if not why:
            raise InputError(
                f"{finding}; expected the images that these were fitted to, {100 * LIGHT_OFF:g} % "
                "off at most. Check --reference and how it is read, or fit these images."
            )
        self._has_told = True
        self._on_progress(Notice(f"{finding}, {why}; are these its images?"))


def flux_of(tracks: LobeTracks) -> Tensor:
    """Return the flux of all lobes together, radiance times solid angle.  [F, 3]."""
    lobes = tracks.lobes.to("cpu", torch.float64)
    return (lobes.amplitude * asg.moments(lobes).zeroth[..., None]).sum(1)


def light_off(lobes: Tensor, image: Tensor, stated: float) -> float:
    """Return how far the flux of lobes is off that of their map, of the mean of its channels.

    Where the fit itself was farther off than `LIGHT_OFF`, it states the sum of the channels only.

    Args:
        lobes: [3]
        image: [3]
        stated: Flux of the lobes over that of the map, minus 1, as the fit left it.
    """
    if abs(stated) > LIGHT_OFF:
        lobes, image = lobes.sum(0, keepdim=True), (1 + stated) * image.sum(0, keepdim=True)
    most, mean = float((lobes - image).abs().max()), float(image.mean())
    return most / mean if mean > 0 else float("inf") if most > 0 else 0.0


def _flux_of_map(radiance: Tensor) -> Tensor:
    """Return the flux of a map.  [H, W, 3] -> [3]."""
    solid_angle = torch.from_numpy(row_solid_angles(*radiance.shape[:2]))  # of a texel of each row
    return solid_angle @ radiance.sum(1, dtype=torch.float64)


def _stated(rows: Sequence[Mapping[str, Any]]) -> dict[int, float]:
    """Return how far off the flux of each frame was left, where a shot or its parts say it."""
    return {
        frame: error
        for row in rows
        for frame, error in zip(row["frames"], row.get("flux_error", ()), strict=False)
        if error is not None
    }


def _free(metadata: Mapping[str, Any], changes: tuple[str, ...]) -> str:
    """Say why lobes need not have the light of their images; empty where they have to."""
    if changes:
        return "which were edited"
    if RESAMPLED in metadata:
        return "which were resampled"
    if "preset" not in metadata:  # those of an array, or of a program that uses asglight
        return "which were not fitted by asglight fit"
    return ""
