# SPDX-License-Identifier: Apache-2.0
"""What a command is told of a stage that it reads, and which of its frames it is for."""

import sys
from typing import TYPE_CHECKING

from asglight.cli.options.parser import one_line
from asglight.cli.printing import summed_up
from asglight.errors import InputError
from asglight.images.frame_files import frame_set, ranges
from asglight.images.message import shown
from asglight.lobes import LobeTracks

if TYPE_CHECKING:
    from asglight.usd import Reading


def warn_of_unread(stage: str, reading: "Reading") -> None:
    """Say in one line on standard error what of a stage lobes cannot hold, if anything."""
    if reading.unread:
        line = summed_up("not read", reading.unread)
        print(f"asglight: {one_line(f'{shown(stage)}: {line}')}", file=sys.stderr)


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
