# SPDX-License-Identifier: Apache-2.0
"""The window as a PNG file, drawn off screen: neither a display nor a GPU is needed."""

import sys
import time
import warnings

import numpy as np
from imgui_bundle import hello_imgui

# After imgui_bundle: the first of the two to be imported decides whose GLFW both use.
import glfw  # isort: skip

from asglight.errors import InputError
from asglight.viewer.gl.context import no_opengl
from asglight.viewer.running import run
from asglight.viewer.state.session import Session
from asglight.viewer.window import Window

PICTURES_MIN = 4
"""Pictures until docked panels have found their sizes."""

PATIENCE_S = 60.0
"""A slow machine gets a noisier reference rather than none."""


def window_picture(session: Session, size: tuple[int, int], *, is_bare: bool = False) -> np.ndarray:
    """Draw the window of a session off screen.

    Args:
        session: What to show.
        size: Columns and rows, (W, H).
        is_bare: Whether to leave the panels out: the balls alone.

    Returns:
        sRGB, 8 bits, row 0 at the top.  [H, W, 3]

    Raises:
        InputError: There is no OpenGL that is new enough.
    """
    use_no_display()
    window = _Photographed(session)
    run(window, size, is_bare=is_bare, is_hidden=True)
    pixels = hello_imgui.final_app_window_screenshot()
    return np.ascontiguousarray(pixels[..., :3])


class _Photographed(Window):
    """A window that closes itself when its picture is complete."""

    def __init__(self, session: Session) -> None:
        super().__init__(session, lambda _path: None)
        self._pictures = 0
        self._began = time.monotonic()

    def before_picture(self) -> None:
        """Count pictures."""
        super().before_picture()
        self._pictures += 1
        is_late = time.monotonic() - self._began > PATIENCE_S
        is_drawn = self._pictures > PICTURES_MIN and self.renderer.reference_progress >= 1
        hello_imgui.get_runner_params().app_shall_exit = is_drawn or is_late


def use_no_display() -> None:
    """Let GLFW make windows that exist only in memory; elsewhere than on Linux they are hidden.

    Raises:
        InputError: GLFW cannot start.
    """
    if not sys.platform.startswith("linux"):
        return
    glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glfw.GLFWError)  # said in the InputError instead
        if not glfw.init():
            raise InputError(no_opengl("GLFW cannot start"))
    glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)
