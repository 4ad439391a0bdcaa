# SPDX-License-Identifier: Apache-2.0
"""What the viewer shows: plain data, the single truth of a session. No OpenGL, no window."""

from bisect import bisect_left
from dataclasses import dataclass, field
from enum import StrEnum

from asglight.errors import InputError
from asglight.lobes import Lobes, LobeTracks

MAX_LOBES = 128
"""Lobes in a frame: 8 KiB of the 16 KiB that every OpenGL has for a uniform block."""

EXPOSURE_EV_MAX = 20.0
"""Stops up and down: 2^-20 brings a sun of a million into range."""

EXPOSURE_EV_STEP = 0.5
"""Stops for one press of a key."""


class ToneCurve(StrEnum):
    """How exposed radiance is brought into [0, 1] before the sRGB transfer."""

    CLIP = "clip"
    """Clipped at 1: below it, the picture is plain sRGB."""
    REINHARD = "reinhard"
    """`L / (1 + L)` per channel (Reinhard et al. 2002): every light keeps its shape."""


@dataclass
class Display:
    """How radiance is shown.

    Attributes:
        exposure_ev: Stops; radiance is multiplied by 2^exposure_ev.
        tone_curve: What happens above 1.
    """

    exposure_ev: float = 0.0
    tone_curve: ToneCurve = ToneCurve.CLIP

    def expose(self, stops: float) -> None:
        """Change the exposure, within +-EXPOSURE_EV_MAX."""
        wanted = self.exposure_ev + stops
        self.exposure_ev = max(-EXPOSURE_EV_MAX, min(EXPOSURE_EV_MAX, wanted))


@dataclass
class ViewerState:
    """A session of the viewer.

    Attributes:
        tracks: The document, with at least one frame.
        frame_index: Place of the shown frame in `tracks.frames`.
        display: How its radiance is shown.
    """

    tracks: LobeTracks
    frame_index: int = 0
    display: Display = field(default_factory=Display)

    def __post_init__(self) -> None:
        """Check that the lobes can be shown.

        Raises:
            InputError: There are more than MAX_LOBES.
        """
        if self.tracks.lobes.count > MAX_LOBES:
            raise InputError(
                f"tracks: {self.tracks.lobes.count} lobes; expected at most {MAX_LOBES}, which is "
                "what the viewer holds. Fit fewer with --lobes."
            )

    @property
    def frame(self) -> int:
        """The shown frame's number."""
        return self.tracks.frames[self.frame_index]

    @property
    def lobes(self) -> Lobes:
        """The shown lobes.  [N, .]."""
        return self.tracks.lobes[self.frame_index]

    def go_to(self, frame: int) -> None:
        """Show the frame nearest to a number; of two equally near ones, the earlier."""
        frames = self.tracks.frames
        after = bisect_left(frames, frame)
        candidates = range(max(after - 1, 0), min(after + 1, len(frames)))
        self.frame_index = min(candidates, key=lambda index: abs(frames[index] - frame))

    def step(self, frames: int) -> None:
        """Go forward or back by a number of frames that exist, stopping at the ends."""
        last = len(self.tracks.frames) - 1
        self.frame_index = max(0, min(last, self.frame_index + frames))
