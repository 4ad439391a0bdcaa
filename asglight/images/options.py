# SPDX-License-Identifier: Apache-2.0
"""What a user says of images: which of them, in which colours, and how much may be lost."""

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

from asglight.errors import InputError, check_number
from asglight.images.message import shown

Eye = Literal["left", "right"]

LOST_MAX = 0.1
"""Share of a frame's light or texels that may be lost. Renderers leave a few NaN in a million
texels and filters a percent of negative light; a frame that lost a tenth was not finished."""


@dataclass(frozen=True)
class ReadOptions:
    """How images are read.

    Attributes:
        layer: Layer or part of an OpenEXR file; None for the beauty.
        eye: Eye of a stereo image; None for an image that is not stereo, or the file's own view.
        colorspace: Space of the colours, by a name that OpenColorIO knows, whatever the files
            state; None for what they state, else linear Rec.709.
        repair: Share of a frame's light or texels, 0 to 1, that may be lost to values that are no
            light.
    """

    layer: str | None = None
    eye: Eye | None = None
    colorspace: str | None = None
    repair: float = LOST_MAX

    def check(self) -> None:
        """Refuse what no image can be read with.

        Raises:
            InputError: The space is unknown, there is no such eye, or the share is none.
        """
        if self.eye is not None and self.eye not in get_args(Eye):
            raise InputError(f"eye: {shown(self.eye)}; expected left or right.")
        check_number("repair", self.repair)
        if not (math.isfinite(self.repair) and 0 <= self.repair <= 1):
            raise InputError(
                f"repair: {self.repair:g}; expected a share from 0 to 1, such as 0.1: what a frame "
                "may lose of its light or texels."
            )
        if self.colorspace is not None:
            from asglight.images import ocio  # slow to load, and seldom wanted

            ocio.input_space(self.colorspace)

    def as_json(self) -> dict[str, Any]:
        """Return the options that the pixels depend on, by the names of the command line."""
        return {
            "layer": self.layer,
            "eye": self.eye,
            "input_colorspace": self.colorspace,
            "repair": self.repair,
        }
