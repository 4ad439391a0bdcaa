# SPDX-License-Identifier: Apache-2.0
"""The Python of docs/guides/python.md, run from its first line to its last."""

import re
from pathlib import Path

import numpy as np
import pytest
import sky_files
from places import ROOT

import asglight

PAGE = ROOT / "docs" / "guides" / "python.md"


def test_the_page_runs_and_gives_the_shapes_that_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("sky.npy", np.stack([sky_files.sky(n, 16) for n in range(1, 5)]))
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(block, names)
    assert names["tracks"].frames == (1001, 1002, 1003, 1004)
    assert names["up"].shape == (3,)
    assert names["sky"].shape == (3, 64, 128, 3)
    assert names["pictures"].shape[0] == 3
    assert "<LobeTracks: " in capsys.readouterr().out
    assert names["follower"].frames == 4
    assert asglight.read_usd("sky.usda").frames == names["tracks"].frames


def test_the_page_names_all_that_is_public() -> None:
    text = PAGE.read_text()
    for name in asglight.__all__:
        assert name in text or name in ("InputError", "__version__"), name
