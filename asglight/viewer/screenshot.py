# SPDX-License-Identifier: Apache-2.0
"""The viewer's picture as a PNG file, drawn off screen: no display is needed."""

import contextlib
import os
import secrets
from pathlib import Path

import numpy as np
from PIL import Image

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.viewer.context import standalone_context
from asglight.viewer.renderer import Renderer
from asglight.viewer.state import ViewerState


def picture(state: ViewerState, size: tuple[int, int]) -> np.ndarray:
    """Draw a state off screen.

    Args:
        state: What to show.
        size: Columns and rows, (W, H).

    Returns:
        sRGB, 8 bits, row 0 = +Y.  [H, W, 3]
    """
    context = standalone_context()
    try:
        target = Renderer(context, size).draw(state)
        pixels = np.frombuffer(target.read(components=3, alignment=1), np.uint8)
        return pixels.reshape(size[1], size[0], 3)
    finally:
        context.release()


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Write a PNG file beside its target and rename it, so a failure leaves the target as it was.

    Args:
        path: The target; its folder must exist.
        pixels: sRGB, 8 bits.  [H, W, 3]

    Raises:
        InputError: The file cannot be written there.
    """
    # A name of its own, so that two writers of one target do not meet; hidden from folder scans.
    temporary = path.parent / f".asglight-{secrets.token_hex(4)}.png"
    try:
        Image.fromarray(pixels).save(temporary, format="PNG")
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({error.strerror or error}); expected a folder "
            "with room and the permission to write. Check the output path."
        ) from error
    finally:
        # Nothing to remove after success or in a folder that is none; the error above says more.
        with contextlib.suppress(OSError):
            temporary.unlink()
