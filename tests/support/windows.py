# SPDX-License-Identifier: Apache-2.0
"""A window without a display, driven by a script of the Dear ImGui test engine."""

import faulthandler
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol
from unittest import mock

import moderngl
import numpy as np
import OpenImageIO
from imgui_bundle import ImVec2, immapp
from imgui_bundle.immapp import testing
from light_edits import scale_amplitude

from asglight.lobes import LobeTracks
from asglight.viewer import running, window
from asglight.viewer.gl.reference import reference_pass
from asglight.viewer.io import screenshot
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

SIZE = (960, 800)
"""Of a window that is to be any: narrow, for its balls are most of what is drawn. The controls and
the list of lobes are in view at this height."""

SAMPLES = 64
"""Of a pixel that is integrated, where the user's windows take 1024. Noise is looked at where the
integral is tested, without a window."""

CALLER = "imgui_bundle._patch_runners_add_save_screenshot_param._get_caller_filename"
"""What reads all sources of the call stack, to learn whether a tutorial of the bundle opens the
window; that takes as long as opening it."""

STDERR = 2

WATCHDOG_S = 1000.0
"""For the whole of a script, on a machine that has other work."""

WAIT_PICTURES = 600
"""Pictures to wait for a thread at most: they take milliseconds, the thread less than a second."""

KEPT = "[!.]*.json"
"""Kept edits, and not the hidden files that are being written beside them."""


class Driven:
    """What a script sees.

    Attributes:
        window: The window.
        seconds: What the clock of its state says.
        has_left: Whether the window would have closed.
        paints: Whether what Dear ImGui draws becomes pixels, which takes the most of a picture and
            is wanted where a script looks at them (`captured`). The balls and the map are drawn
            into textures of their own in any case.
    """

    def __init__(
        self,
        tracks: LobeTracks,
        opener: window.Opener,
        reference: Reference | None,
        stage: Path | None = None,
        autosaves: Path | None = None,
    ):
        self.seconds = 0.0
        self.paints = False
        state = ViewerState(tracks, reference, clock=lambda: self.seconds)
        title = "test" if stage is None else stage.name
        session = Session(state, FixedSource(tracks), title, stage)
        self.window = window.Window(session, opener, autosaves)
        self.has_left = False
        self.window.leave = self._left
        before_picture, drawn = self.window.before_picture, self.window.drawn
        self.window.before_picture = lambda: self._before_picture(before_picture)
        self.window.drawn = lambda: self._drawn(drawn)

    def _left(self) -> None:
        self.has_left = True  # the script goes on

    def _before_picture(self, prepare: Callable[[], None]) -> None:
        self.window.context.disable(moderngl.RASTERIZER_DISCARD)
        prepare()

    def _drawn(self, draw_screens: Callable[[], None]) -> None:
        draw_screens()
        if not self.paints:
            self.window.context.enable(moderngl.RASTERIZER_DISCARD)

    @property
    def state(self) -> ViewerState:
        return self.window.state


def wait_for(
    test: Any, driven: Driven, message: str, until: Callable[[], bool] | None = None
) -> None:
    """Let pictures go by until the status line says something, or something else is true."""
    for _ in range(WAIT_PICTURES):
        if driven.state.message.startswith(message) and (until is None or until()):
            return
        test.yield_()
    raise AssertionError(driven.state.message)


def map_point(test: Any, u: float, v: float) -> ImVec2:
    """Return the point of the map panel at latlong coordinates."""
    box = test.item_info("Map/##map").rect_full
    return ImVec2(box.min.x + u * (box.max.x - box.min.x), box.min.y + v * (box.max.y - box.min.y))


def bar_point(test: Any, share: float) -> ImVec2:
    """Return a point of the timeline's bar."""
    box = test.item_info("Timeline/##bar").rect_full
    return ImVec2(box.min.x + share * (box.max.x - box.min.x), (box.min.y + box.max.y) / 2)


def captured(test: Any, driven: Driven, path: Path) -> np.ndarray:
    """Return the window as it is seen, in 0 to 1, through a file.  [H, W, 3]."""
    paints, driven.paints = driven.paints, True
    testing.capture(test, str(path))
    driven.paints = paints
    pixels = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
    assert pixels is not None
    return np.asarray(pixels)[..., :3]


def rendered(test: Any, driven: Driven, path: Path) -> np.ndarray:
    """Return the balls of the shown frame as radiance, through a file of the window's own.

    A script runs in a thread without OpenGL, so it cannot read the picture itself.

    Args:
        test: The test engine.
        driven: The window.
        path: An EXR file to be written.
    """
    playback = driven.state.playback
    playback.mark_in()
    playback.mark_out()
    driven.window.save(Request.RENDER, path)
    wait_for(test, driven, "Rendered 1 picture", lambda: path.exists())
    driven.state.message = ""
    playback.clear_marks()
    image = OpenImageIO.ImageBuf(str(path))
    return np.asarray(image.get_pixels(OpenImageIO.FLOAT))[..., :3]


class Drive(Protocol):
    """Opens a window, lets a script drive it, and closes it."""

    def __call__(
        self,
        script: Callable[[Any, Driven], None],
        *,
        with_reference: bool = False,
        opener: window.Opener = lambda path: None,
    ) -> None: ...


def grey(tracks: LobeTracks) -> Reference:
    """Return a reference that is grey everywhere, in every frame."""
    return Reference("grey", tracks.frames, lambda frame: np.full((16, 32, 3), 0.5, np.float32))


def drive(tracks: LobeTracks, script: Callable[[Any, Driven], None], **options: Any) -> None:
    """Open a window on tracks and run a script in it."""
    reference = grey(tracks) if options.pop("with_reference", False) else None
    opener = options.pop("opener", lambda path: None)
    size, scale = options.pop("size", SIZE), options.pop("scale", 1.0)
    driven = Driven(tracks, opener, reference, **options)
    screenshot.use_no_display()
    params = running.runner_params(driven.window, size)
    params.ini_disable = True
    params.fps_idling.fps_max = 0.0  # a script waits for nobody
    params.dpi_aware_params.dpi_window_size_factor = scale

    def watched(test: Any) -> None:
        test.engine_io.config_watchdog_warning = WATCHDOG_S
        test.engine_io.config_watchdog_kill_test = WATCHDOG_S
        script(test, driven)

    try:
        with (
            mock.patch.object(reference_pass, "TARGET_SAMPLES", SAMPLES),
            mock.patch(CALLER, return_value=""),
        ):
            testing.run(
                test_function=watched,
                runner_params=params,
                add_ons_params=immapp.AddOnsParams(with_implot=True),
            )
    finally:
        take_signals_back()
        driven.window.raise_failure()  # the script fails as well, but this is why


def take_signals_back() -> None:
    """Undo the crash handlers that the test engine leaves behind.

    They ask for the window's context, which is gone. One of them is for SIGPIPE, which Python
    ignores: with it a later test that writes to a process that has ended would crash instead of
    having a BrokenPipeError.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    faulthandler.disable()
    faulthandler.enable(STDERR)


def brighten(driven: Driven, lobe: int = 0) -> None:
    """Double the light of a lobe."""
    driven.state.history.add(scale_amplitude(lobe, None, 1.0))


def press(test: Any, *labels: str) -> None:
    """Click what is in the question or dialog that has the focus."""
    for label in labels:
        test.item_click(f"//$FOCUSED/{label}")
        test.yield_(2)
