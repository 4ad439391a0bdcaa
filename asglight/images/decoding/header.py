# SPDX-License-Identifier: Apache-2.0
"""What is known of an image before it is decoded, and the error of one that cannot be.

Nothing that decodes is loaded for it: a process that has images decoded in others needs no more.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.colour import Chromaticities, ColourSpace
from asglight.images.decoding.layers import Layer
from asglight.images.message import shown

SLOTS = 2
"""Of the memory in which rows come back from another process: while one is read, one is filled."""

SLOT_BYTES = 2**24
"""Of a slot, at most: a frame of 1024 x 512 float32 texels at once, and one of the fit's 512 x 256
four times over, so that the process that fits is asked once a frame."""


class DamagedError(InputError):
    """A file that cannot be decoded: cut off, damaged, of no known kind, or gone.

    Attributes:
        finding: What is wrong with it, as a clause.
        frame: The frame that it is, where it is one of a sequence.
    """

    def __init__(self, path: Path, finding: str, hint: str) -> None:
        """Make the message of the path, the finding, and what was expected with what to do."""
        super().__init__(f"{shown(path)}: {finding}; {hint}")
        self.finding = finding
        self.frame: int | None = None


def unreadable(path: Path, said: str) -> InputError:
    """Return the error of a file whose decoder says why it fails."""
    return DamagedError(
        path,
        f"cannot be decoded ({said})",
        "expected a complete image. Was its copy or its rendering interrupted?",
    )


@dataclass(frozen=True)
class Header:
    """What a file says of its image before the pixels are decoded, and what is made of it.

    Attributes:
        path: The file.
        kind: Name of its format, as OpenImageIO has it.
        height: Rows of the image.
        width: Columns of it.
        corner: Column and row of its corner within the upright display window; not (0, 0) for one
            half of a stereo image.
        layer: The channels to read.
        axes: How the pixels are stored, the slow axis first, as Radiance writes it; `-Y`, `+X` is
            upright: down the rows, then along the columns.
        colour: What the numbers mean.
        luminance_of: Primaries and white of the R, G, B that the luminance of a luminance-chroma
            image is of; None for Rec.709.
        gamma: Exponent that makes the numbers linear.
        multiplier: What linear red, green and blue have been multiplied with.
        white_luminance: Nits of (1, 1, 1), as the file states it; None where it does not.
        eye: The eye that it is of; empty where it is not stereo.
        notes: What a user has to know of how it is read, one clause each.
        warnings: Those of them that may make wrong light.
        stored_bytes: Size of the pixels with all channels of the part, as float32.
    """

    path: Path
    kind: str
    height: int
    width: int
    corner: tuple[int, int]
    layer: Layer
    axes: tuple[str, str]
    colour: ColourSpace
    luminance_of: Chromaticities | None
    gamma: float
    multiplier: tuple[float, float, float]
    white_luminance: float | None
    eye: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    stored_bytes: int


def to_json(header: Header) -> dict[str, Any]:
    """Return a header as JSON values."""
    return dataclasses.asdict(header) | {"path": str(header.path)}


def from_json(values: dict[str, Any]) -> Header:
    """Return the header that `to_json` made JSON values of."""
    plain = {name: _frozen(value) for name, value in values.items()}
    layer = {name: _frozen(value) for name, value in values["layer"].items()}
    space = {name: _frozen(value) for name, value in values["colour"].items()}
    return Header(
        **plain
        | {
            "path": Path(values["path"]),
            "layer": Layer(**layer),
            "colour": ColourSpace(**space),
        }
    )


def _frozen(value: Any) -> Any:
    """Return a list as the tuple that it was."""
    return tuple(value) if isinstance(value, list) else value


def slot_rows(height: int) -> int:
    """Return how many rows of a result a slot takes."""
    return min(height, max(1, SLOT_BYTES // row_bytes(height)))


def row_bytes(height: int) -> int:
    """Return the size of a row of a result: 2 * height texels of three float32."""
    return 2 * height * 3 * 4
