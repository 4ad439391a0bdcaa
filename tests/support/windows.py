# SPDX-License-Identifier: Apache-2.0
"""A window without a display, driven by a script of the Dear ImGui test engine."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from imgui_bundle import immapp
from imgui_bundle.immapp import testing

from asglight.lobes import LobeTracks
from asglight.viewer import running, screenshot, window
from asglight.viewer.reference import Reference
from asglight.viewer.session import Session
from asglight.viewer.source import FixedSource
from asglight.viewer.state import ViewerState

SIZE = (1200, 800)


class Driven:
    """What a script sees.

    Attributes:
        window: The window.
        seconds: What the clock of its state says.
    """

    def __init__(self, tracks: LobeTracks, opener: window.Opener, reference: Reference | None):
        self.seconds = 0.0
        state = ViewerState(tracks, reference, clock=lambda: self.seconds)
        self.window = window.Window(Session(state, FixedSource(tracks), "test"), opener)

    @property
    def state(self) -> ViewerState:
        return self.window.state


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
    driven = Driven(tracks, options.pop("opener", lambda path: None), reference)
    screenshot.use_no_display()
    params = running.runner_params(driven.window, SIZE)
    params.ini_disable = True
    try:
        testing.run(
            test_function=lambda test: script(test, driven),
            runner_params=params,
            add_ons_params=immapp.AddOnsParams(with_implot=True),
        )
    finally:
        driven.window.raise_failure()  # the script fails as well, but this is why
