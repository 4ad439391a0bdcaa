# SPDX-License-Identifier: Apache-2.0
"""The images that a command judges by: found with the options of `add_input_options`, and lit."""

import argparse
from typing import TYPE_CHECKING

from asglight.cli.options.reading import read_options
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT

if TYPE_CHECKING:
    from torch import Tensor

    from asglight.images import Sequence


def open_input(source: str, arguments: argparse.Namespace, height: int = FIT_HEIGHT) -> "Sequence":
    """Find the frames of an input that the options choose; read none of them.

    Args:
        source: Image file, folder or pattern.
        arguments: With what `add_input_options` adds.
        height: Rows that larger images are reduced to.

    Raises:
        InputError: They cannot be found, or an option asks for what there is not.
    """
    from asglight.images import open_sequence

    return open_sequence(
        source,
        frames=arguments.frames,
        height=height,
        reading=read_options(arguments),
    )


def lit(sequence: "Sequence", frame: int) -> "Tensor":
    """Read a frame.  [H, W, 3].

    Raises:
        InputError: It cannot be read, or it is black, so that nothing can be relative to its light.
    """
    from asglight.images.message import shown

    radiance = sequence.read(frame).radiance
    if float(radiance.sum()) > 0:
        return radiance
    raise InputError(
        f"{shown(sequence.path(frame))}: has no light in it; expected some, by which errors are "
        "counted. Choose other frames with --frames."
    )
