# SPDX-License-Identifier: Apache-2.0
"""Which pictures to render, and how their files are called."""

import re
from dataclasses import dataclass
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown

SUFFIXES = (".png", ".exr", ".mp4")

TURNTABLE = 96
"""Pictures of one turn, where none are asked for: four seconds, at the usual rate."""

_PAD = re.compile(r"#+|%0?(\d*)d")


@dataclass(frozen=True)
class Wanted:
    """What to render.

    Attributes:
        path: A file, or a pattern such as `out.####.png`.
        size: Columns and rows.
        is_labelled: Whether names, frame and exposure are written into the pictures.
        turntable: Pictures of one whole turn of the environment at the shown frame; None renders
            the frames from the in to the out point.
    """

    path: Path
    size: tuple[int, int]
    is_labelled: bool = False
    turntable: int | None = None

    def check(self, count: int) -> None:
        """Refuse what cannot be written.

        Args:
            count: How many pictures there will be.

        Raises:
            InputError: The name or the size does not suit the kind of file.
        """
        suffix = self.path.suffix.lower()
        name = shown(self.path)
        if suffix not in SUFFIXES:
            raise InputError(
                f"{name}: is no picture; expected a name ending in .png, .exr or .mp4."
            )
        if suffix == ".mp4":
            if any(side % 2 for side in self.size):
                size = "x".join(map(str, self.size))
                raise InputError(f"{name}: {size} has an odd side; an MP4 needs even ones.")
        elif count > 1 and _PAD.search(self.path.name) is None:
            raise InputError(
                f"{name}: one name for {count} pictures; expected a pattern such as "
                f"{self.path.stem}.####{suffix}."
            )
        if suffix == ".exr" and self.is_labelled:
            raise InputError(f"{name}: labels have no radiance; expected .png or .mp4 for them.")

    def file(self, number: int) -> Path:
        """Return the file of one picture."""

        def _number(pad: re.Match[str]) -> str:
            width = len(pad[0]) if pad[0].startswith("#") else int(pad[1] or 1)
            return str(number).zfill(width)

        return self.path.with_name(_PAD.sub(_number, self.path.name))
