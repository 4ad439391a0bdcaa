# SPDX-License-Identifier: Apache-2.0
"""Rigs that shots refer to."""

from pathlib import Path

import pytest
from rigs_in_shots import FRAMES
from usd_tracks import of_every_kind, write_every
from written_stages import calm


@pytest.fixture(scope="session")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a rig for each up axis, moving and still."""
    folder = tmp_path_factory.mktemp("rigs")
    for axis in "YZ":
        path = folder / f"rig_{axis.lower()}.usda"
        write_every(calm(of_every_kind, FRAMES), path, up_axis=axis, dome_height=32)
    return folder


@pytest.fixture
def folder(rigs: Path, tmp_path: Path) -> Path:
    for entry in rigs.iterdir():
        (tmp_path / entry.name).symlink_to(entry) if entry.is_dir() else None
        if entry.is_file():
            (tmp_path / entry.name).write_bytes(entry.read_bytes())
    return tmp_path
