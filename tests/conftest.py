# SPDX-License-Identifier: Apache-2.0
"""One thread, and OpenGL for the tests of several rooms; neither a display nor a GPU is needed."""

import atexit
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from asglight.errors import InputError

if TYPE_CHECKING:
    import moderngl

# Before torch is imported: each core has a file of tests of its own, and OpenMP with threads hangs
# in a process forked off (soak/shot.py).
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    """Let a worker end at once: to take its 1.5 million objects apart takes four seconds."""
    if hasattr(config, "workerinput"):
        atexit.register(os._exit, 0)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let files with a slow test come first, so that no core waits long for the last file."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture
def torch_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all steps be those of torch, as on a GPU."""
    from asglight.fitting import compiled

    monkeypatch.setattr(compiled, "LIBRARY", None)


@pytest.fixture
def opengl() -> Iterator["moderngl.Context"]:
    """An off-screen context that has no error before or after the test."""
    from asglight.viewer.gl.context import standalone_context  # most rooms do without

    try:
        context = standalone_context()
    except InputError as error:
        # On a build machine a missing OpenGL must not pass unnoticed.
        (pytest.fail if os.environ.get("CI") else pytest.skip)(str(error))
    assert context.error == "GL_NO_ERROR"
    yield context
    assert context.error == "GL_NO_ERROR"
    context.release()
