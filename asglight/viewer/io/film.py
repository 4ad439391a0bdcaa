# SPDX-License-Identifier: Apache-2.0
"""An MP4 that is written picture by picture, by the ffmpeg that imageio-ffmpeg brings along."""

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


class Film:
    """An MP4 file, there when it is whole or not at all."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        """Begin the file.

        Args:
            path: The target.
            size: Columns and rows, both even.
            fps: Pictures a second.

        Raises:
            InputError: There is no such folder.
        """
        if not path.parent.is_dir():
            raise InputError(
                f"{shown(path)}: cannot be written (no folder {shown(path.parent)}); expected a "
                "folder that is there. Check the output path."
            )
        self._beside = written_beside(path)
        self._place = self._beside.__enter__()
        self._writer = imageio_ffmpeg.write_frames(
            str(self._place),
            size,
            fps=fps,  # pyright: ignore[reportArgumentType]  it takes any number
            input_params=["-r", f"{fps:.6g}"],  # which it would round to hundredths
            codec="libx264",
            macro_block_size=2,
            quality=None,  # pyright: ignore[reportArgumentType]  as its manual has it
            ffmpeg_log_level="error",
            output_params=["-crf", QUALITY, "-movflags", "+faststart", *_COLOURS],
        )
        self._writer.send(None)
        self._count, self._has_ended = 0, False

    def add(self, pixels: np.ndarray) -> None:
        """Add a picture: sRGB, 8 bits.  [H, W, 3].

        Raises:
            InputError: The file cannot be written.
        """
        try:
            self._writer.send(np.ascontiguousarray(pixels))
        except OSError:  # a pipe that nobody reads
            self._end(OSError(None, f"ffmpeg has ended after {self._count} pictures"))
        self._count += 1

    def close(self, *, is_whole: bool) -> None:
        """End the file: keep it if it is whole, else remove it. More than once does no harm.

        Raises:
            InputError: It cannot be written.
        """
        if self._has_ended:
            return
        self._writer.close()
        if not is_whole:
            self._end(GeneratorExit())
            return
        there = _pictures_in(self._place)  # whether ffmpeg ended well nobody else tells
        short = f"ffmpeg has written {there} of {self._count} pictures"
        self._end(None if there == self._count else OSError(None, short))

    def _end(self, error: BaseException | None) -> None:
        """Keep the file, or remove it; `written_beside` says what an OSError means."""
        self._has_ended = True
        self._beside.__exit__(None if error is None else type(error), error, None)


def _pictures_in(path: Path) -> int:
    """Return how many pictures a film has; none where it cannot be read."""
    try:
        return imageio_ffmpeg.count_frames_and_secs(str(path))[0] or 0
    except (OSError, RuntimeError):
        return 0
