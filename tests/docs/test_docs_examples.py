# SPDX-License-Identifier: Apache-2.0
"""The examples of the public docstrings, and the Python of the pages that start a reader, run."""

import doctest
import re
from pathlib import Path

import numpy as np
import pytest
import sky_files
import torch

import asglight
from asglight.images import write_exr

ROOT = Path(__file__).resolve().parents[2]
NAMES = [name for name in asglight.__all__ if not name.startswith("__")]


@pytest.fixture(scope="module")
def tracks(tmp_path_factory: pytest.TempPathFactory) -> asglight.LobeTracks:
    frames = np.stack([sky_files.sky(n, 16) for n in (1, 2)])
    return asglight.fit(frames, lobes=2, first_frame=1001)


@pytest.fixture
def names(tracks: asglight.LobeTracks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict:
    """What an example may use: tracks of two frames, a camera, files of a sky."""
    monkeypatch.chdir(tmp_path)
    camera = [sky_files.sky(n, 16) for n in (1, 2)]
    for frame, radiance in zip((1001, 1002), camera, strict=True):
        write_exr(tmp_path / f"sky.{frame}.exr", torch.as_tensor(radiance))
    return {"asglight": asglight, "np": np, "tracks": tracks, "camera": camera}


@pytest.mark.parametrize("name", [*NAMES, "asglight"])
def test_the_example_of_a_public_name_runs(name: str, names: dict) -> None:
    thing = asglight if name == "asglight" else getattr(asglight, name)
    assert ">>> " in (thing.__doc__ or ""), f"{name} has no example"
    example = doctest.DocTestParser().get_doctest(thing.__doc__, names, name, None, None)
    said: list[str] = []
    result = doctest.DocTestRunner(verbose=False).run(example, out=said.append)
    assert result.failed == 0, "".join(said)


@pytest.mark.parametrize("page", ["start/researcher.md"])
def test_the_python_of_a_page_runs(page: str, names: dict) -> None:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    assert blocks
    for block in blocks:
        exec(block, names)
