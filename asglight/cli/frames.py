# SPDX-License-Identifier: Apache-2.0
"""Which frames of a stage a command is for."""

from asglight.errors import InputError
from asglight.images.frame_files import frame_set, ranges
from asglight.images.message import shown
from asglight.lobes import LobeTracks


def chosen_frames(tracks: LobeTracks, frames: str | None, stage: str) -> tuple[int, ...]:
    """Return the frames that were asked for; all without a choice.

    Raises:
        InputError: A frame was asked for that the stage does not have.
    """
    if frames is None:
        return tracks.frames
    wanted = frame_set(frames, "frames")
    absent = sorted(set(wanted) - set(tracks.frames))
    if absent:
        raise InputError(
            f"frames: {ranges(absent)} not in {shown(stage)}; expected some of "
            f"{ranges(tracks.frames)}. Change --frames."
        )
    return wanted
