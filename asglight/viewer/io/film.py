# SPDX-License-Identifier: Apache-2.0
"""An MP4 that is written picture by picture, by the ffmpeg that imageio-ffmpeg brings along."""

import contextlib
import re
import subprocess
import tempfile
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.images.output import written_beside

QUALITY = "16"
"""Constant rate factor of x264: a grey ball shows no bands; 18 is called visually lossless."""

_COLOURS = (
    *("-vf", "scale=out_color_matrix=bt709:out_range=tv"),
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1"),
)
"""Rec. 709 with the curve of sRGB: what the pictures are."""

_FRONT = ("-movflags", "+faststart")
"""The index comes before the pictures: players begin before they have all of the file."""

_PART = re.compile(r"^\[[^]]*\] *")
"""What ffmpeg begins a line with: which part of it speaks, and where that is in memory."""

_APART = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0) | getattr(
    subprocess, "CREATE_NO_WINDOW", 0
)
"""On Windows what a session of its own is elsewhere: Ctrl-C does not end ffmpeg before us."""


class Film:
    """An MP4 file, there when it is whole or not at all."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        """Begin the file.

        Args:
            path: The target.
            size: Columns and rows, both even.
            fps: Pictures a second.

        Raises:
            InputError: There is no such folder, or nothing can be written there.
        """
        if not path.parent.is_dir():
            raise InputError(
                f"{shown(path)}: cannot be written (no folder {shown(path.parent)}); expected a "
                "folder that is there. Check the output path."
            )
        self._name = path.name
        columns, rows = size
        raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}")
        coded = ("-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", QUALITY, *_COLOURS)
        program = (imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error")
        with contextlib.ExitStack() as held:
            self._place = held.enter_context(written_beside(path))
            self._place.touch()  # what forbids that is told in a word here, and not by ffmpeg
            self._said = held.enter_context(tempfile.TemporaryFile())
            self._process = subprocess.Popen(
                [*program, *raw, "-r", f"{fps:.6g}", "-i", "-", *coded, *_FRONT, str(self._place)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._said,
                start_new_session=True,
                creationflags=_APART,
            )
            self._held = held.pop_all()
        self._has_ended = False

    def add(self, pixels: np.ndarray) -> None:
        """Add a picture: sRGB, 8 bits.  [H, W, 3].

        Raises:
            InputError: The file cannot be written.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(pixels).data)
        except OSError as error:  # nobody reads any more
            self._end(error)

    def close(self, *, is_whole: bool) -> None:
        """End the file: keep it if it is whole, else remove it. More than once does no harm.

        Raises:
            InputError: It cannot be written.
        """
        if not self._has_ended:
            self._end(None if is_whole else GeneratorExit())

    def _end(self, error: BaseException | None) -> None:
        """Let ffmpeg end, and keep its file where neither it nor anybody before it has failed."""
        self._has_ended = True
        if isinstance(error, GeneratorExit):
            self._process.kill()
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # of what it did not take; its status tells
            self._process.stdin.close()
        try:
            status = self._process.wait()
        except BaseException:  # Ctrl-C
            self._process.kill()
            raise
        if isinstance(error, OSError) or (error is None and status != 0):
            self._said.seek(0)
            said = self._said.read().decode(errors="replace").strip().split("\n")[0]
            said = _PART.sub("", said).replace(str(self._place), self._name)
            error = OSError(f"ffmpeg: {shown(said or f'ended with status {status}')}")
        if error is None:
            self._held.close()
        else:
            self._held.__exit__(type(error), error, None)
