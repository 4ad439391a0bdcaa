# SPDX-License-Identifier: Apache-2.0
"""A window on a stage that stands alone in a folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import windows
import written_stages
from windows import Drive, Driven

from asglight.lobes import LobeTracks
from asglight.usd import read_usd
from asglight.viewer.io import native


@pytest.fixture
def stage(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    """Write two lamps as `shot.usda`, alone in a folder."""
    path = tmp_path / "shot" / "shot.usda"
    path.parent.mkdir()
    written_stages.put(two_lamps, path, dome_height=2)
    return path


@pytest.fixture
def drive_stage(drive: Drive, stage: Path) -> Callable[..., None]:
    """Open a window on that stage, on a system without dialogs of its own."""

    def _drive(script: Callable[[Any, Driven], None], **options: Any) -> None:
        windows.drive(read_usd(stage), script, stage=stage, **options)

    return _drive


@pytest.fixture
def no_system_dialog(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "has_dialog", lambda: False)
