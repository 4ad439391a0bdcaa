# SPDX-License-Identifier: Apache-2.0
"""The real window, driven by the Dear ImGui test engine on GLFW's null platform: no display."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import OpenImageIO
import pytest
from imgui_bundle import imgui
from imgui_bundle.immapp import testing

# After imgui_bundle, as in asglight.viewer.window.
import glfw  # isort: skip

from asglight.lobes import LobeTracks
from asglight.viewer import window
from asglight.viewer.state import ToneCurve, ViewerState

Drive = Callable[[ViewerState, Callable[[Any], None]], None]


@pytest.fixture
def drive(opengl: moderngl.Context) -> Iterator[Drive]:
    """Open a window on a state, let a function of the test engine's context drive it, close it."""
    if not sys.platform.startswith("linux"):
        pytest.skip("GLFW's null platform needs EGL, which Linux has")
    glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
    assert glfw.init()
    glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)

    def driven(state: ViewerState, script: Callable[[Any], None]) -> None:
        params = window.runner_params(window.Window(state, (512, 256)), "test", (512, 256))
        params.ini_disable = True
        testing.run(test_function=script, runner_params=params)

    yield driven
    opengl.__enter__()  # so that the errors looked for afterwards are those of this context


def test_frame_slider_and_arrow_keys_change_the_frame(drive: Drive, two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)

    def script(test: Any) -> None:
        test.item_input_value("**/frame", 1004)
        assert state.frame == 1004
        test.key_press(int(imgui.Key.left_arrow))
        assert state.frame == 1002
        test.key_press(int(imgui.Key.right_arrow))
        assert state.frame == 1004

    drive(state, script)


def test_exposure_slider_and_keys_change_the_exposure(drive: Drive, two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)

    def script(test: Any) -> None:
        test.item_input_value("**/exposure (EV)", 2.0)
        assert state.display.exposure_ev == 2.0
        test.key_press(int(imgui.Key.e))
        assert state.display.exposure_ev == 2.5
        test.key_press(int(imgui.Key.mod_shift) | int(imgui.Key.e), 2)
        assert state.display.exposure_ev == 1.5
        test.key_press(int(imgui.Key.t))
        assert state.display.tone_curve is ToneCurve.REINHARD

    drive(state, script)


OLD_OPENGL = """
from imgui_bundle import imgui
import glfw
import torch
from asglight.errors import InputError
from asglight.lobes import Lobes, LobeTracks
from asglight.viewer import window
from asglight.viewer.state import ViewerState

glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
assert glfw.init()
glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)
lobes = Lobes(torch.eye(3)[None, None], torch.ones(1, 1, 2), torch.ones(1, 1, 3))
try:
    window.show(ViewerState(LobeTracks((1,), 24.0, lobes)), "test", (64, 32))
except InputError as error:
    print(error)
"""


def test_window_on_an_old_opengl_is_explained(opengl: moderngl.Context) -> None:
    if "Mesa" not in opengl.info["GL_VERSION"]:
        pytest.skip("only Mesa can be told to offer an older OpenGL")
    result = subprocess.run(
        [sys.executable, "-c", OLD_OPENGL],
        capture_output=True,
        text=True,
        env={**os.environ, "MESA_GL_VERSION_OVERRIDE": "3.3"},
        timeout=60,
        check=True,
    )
    assert result.stdout == (
        "window: cannot be opened; expected OpenGL 4.1 or later. "
        "Update the graphics driver; --check says what it has.\n"
    )


def centroid(channel: np.ndarray) -> np.ndarray:
    """Return row and column of the centre of what is brighter than half, [H, W] in 0 to 1."""
    return np.argwhere(channel > 0.5).mean(axis=0)


def test_picture_is_upright_and_follows_the_frame(
    drive: Drive, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    state = ViewerState(two_lamps)

    def script(test: Any) -> None:
        testing.capture(test, str(tmp_path / "first.png"))
        state.go_to(1004)
        testing.capture(test, str(tmp_path / "last.png"))

    drive(state, script)
    lamps = []
    for name in ("first.png", "last.png"):
        pixels = OpenImageIO.ImageBuf(str(tmp_path / name)).get_pixels(OpenImageIO.FLOAT)
        assert pixels is not None
        red, green, blue = np.moveaxis(pixels[..., :3], -1, 0)
        lamps.append((centroid(green - red - blue), centroid(red - green - blue)))
    (green, red), (green_later, red_later) = lamps
    height = red[0] - green[0]  # half a map; row 0 is at the top
    assert height > 60
    np.testing.assert_allclose(red[1] - green[1], 2 * height, atol=2)
    np.testing.assert_allclose(green_later - green, [0, height], atol=2)
    np.testing.assert_allclose(red_later, red, atol=0.5)


@pytest.mark.parametrize(
    ("room", "size"),
    [
        ((640, 400), (640, 320)),
        ((640, 100), (200, 100)),
        ((641, 999), (640, 320)),
        ((0, 0), (2, 1)),
    ],
)
def test_picture_fills_the_room_at_two_to_one(room: tuple[int, int], size: tuple[int, int]) -> None:
    assert window.latlong_size(*room) == size
