# SPDX-License-Identifier: Apache-2.0
"""Watching a shot that another process fits: its checkpoint while it runs, then its stage."""

import os
from pathlib import Path
from typing import Any, BinaryIO

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.lobes.growing import GrowingTracks
from asglight.shots.kept.checkpoint import FORMAT_VERSION, SUFFIX
from asglight.shots.kept.records import from_json, number, parse_line, whole


class ShotWatch:
    """Follows one shot from its first finished frame to its stage.

    Attributes:
        tracks: The frames found so far; None before the first.
        frames: Every frame there will be; none before the header was read.
        is_written: The stage is there and `tracks` are what it holds.
    """

    def __init__(self, stage: Path) -> None:
        """Take the path of the stage; neither it nor its checkpoint is read yet."""
        self.stage = stage
        self.tracks: LobeTracks | None = None
        self.frames: tuple[int, ...] = ()
        self.is_written = False
        self._checkpoint = stage.with_name(stage.name + SUFFIX)
        self._begin_again()

    def look(self) -> bool:
        """Read what is new and tell whether there was something.

        The last line may still be being written: a line that is not whole is left for later. A
        checkpoint that was started afresh is read afresh.

        Raises:
            InputError: The stage or the checkpoint cannot be used.
        """
        if self.stage.exists():
            from asglight.usd import read_usd  # loads pxr

            self.tracks = read_usd(self.stage)
            self.frames = self.tracks.frames
            self.is_written = True
            return True
        before = self.tracks
        try:
            with open(self._checkpoint, "rb") as stream:
                self._read(stream)
        except FileNotFoundError:  # not begun, or removed: then the stage is there at the next look
            return False
        except OSError as error:
            raise InputError(
                f"{shown(self._checkpoint)}: cannot be read ({error.strerror}); expected the "
                "checkpoint of a running fit. Check the permissions."
            ) from error
        return self.tracks is not before

    def _begin_again(self) -> None:
        self._offset = 0
        self._last_line = b""
        self._growing: GrowingTracks | None = None

    def _read(self, stream: BinaryIO) -> None:
        """Take the whole lines that follow the last one that was taken."""
        stream.seek(self._offset - len(self._last_line))
        content = stream.read()
        if not content.startswith(self._last_line):
            self._begin_again()
            stream.seek(0)
            content = stream.read()
        taken = 0
        for line in content[len(self._last_line) :].splitlines(keepends=True):
            record = parse_line(line)
            if record is None:
                break
            self._take(record)
            self._offset += len(line)
            self._last_line = line
            taken += 1
        if taken and self._growing is not None:
            self.tracks = self._growing.tracks() or self.tracks

    def _take(self, record: dict[str, Any]) -> None:
        """Take a header or a frame."""
        try:
            if self._growing is None:
                self._growing = self._header(record)
            else:
                self._growing.append(from_json(record).lobes)
        except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
            raise InputError(
                f"{shown(self._checkpoint)}: a line is no frame of this asglight; expected a "
                "checkpoint of the same version. Watch with the asglight that fits."
            ) from error

    def _header(self, header: dict[str, Any]) -> GrowingTracks:
        if header["format_version"] != FORMAT_VERSION:
            raise ValueError(header["format_version"])
        self.frames = tuple(map(whole, header["frames"]))
        metadata = {"source": os.path.basename(header["source"]), "preset": header["preset"]}
        return GrowingTracks(self.frames, number(header["fps"]), metadata)
