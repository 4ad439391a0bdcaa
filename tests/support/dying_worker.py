# SPDX-License-Identifier: Apache-2.0
"""A worker of a cluster that dies some frames into its part, once in a run."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

from asglight.shots.events import Event, FrameDone
from asglight.shots.parts import farm
from asglight.shots.parts.chunks import Part, fit_part
from asglight.shots.parts.preroll import Followed

FRAMES = 4
"""Of the part that are fitted before: the other worker finds a checkpoint."""

PATIENCE = 120.0
"""Seconds that the worker waits for `told`; a busy machine takes seconds."""


def fit(part: Part, name: str, topic: str, known: Followed | None) -> None:
    """Fit a part as `farm._fit` does; the first process that comes to `FRAMES` ends there.

    The kernel ends it: no Python of it runs any more. It waits until the client knows that it had
    the part, for what it says last is lost with it.
    """
    folder = Path(part.done).parent

    def fit_and_die(
        part: Part, known: Followed | None, on_progress: Callable[[Event], None]
    ) -> None:
        def pass_on(event: Event) -> None:
            on_progress(event)
            if isinstance(event, FrameDone) and event.position >= FRAMES and _first(folder):
                _wait_for(folder / f"{name}.told")
                os.kill(os.getpid(), signal.SIGKILL)

        fit_part(part, known, pass_on)

    with mock.patch.object(farm, "fit_part", fit_and_die):
        _FIT(part, name, topic, known)


def told(folder: Path, news: dict[str, Any]) -> None:
    """Say that the client has news of a part; `folder` is that of the parts."""
    (folder / f"{news['part']}.told").touch()


_FIT = farm._fit  # which a test replaces by `fit`


def _first(folder: Path) -> bool:
    """Return whether nobody came here before."""
    try:
        (folder / "dying").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _wait_for(file: Path) -> None:
    end = time.monotonic() + PATIENCE
    while not file.exists() and time.monotonic() < end:
        time.sleep(0.01)
