# SPDX-License-Identifier: Apache-2.0
"""The public names of the package, as a script uses them."""

import subprocess
import sys
from pathlib import Path

import pytest
import sky_files
import torch

import asglight


def test_importing_asglight_loads_neither_torch_nor_usd_nor_a_window() -> None:
    heavy = "{'torch', 'pxr', 'moderngl', 'imgui_bundle', 'matplotlib', 'OpenEXR'}"
    code = f"import asglight, sys; dir(asglight); print(*{heavy} & set(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == ""


def test_every_public_name_is_there_and_documented() -> None:
    assert set(asglight.__all__) <= set(dir(asglight))
    for name in asglight.__all__:
        assert getattr(asglight, name).__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'asglight' has no attribute 'polish'"):
        _ = asglight.polish


def test_fit_write_and_read_from_python(tmp_path: Path) -> None:
    source = sky_files.write_sequence(tmp_path / "in")
    tracks = asglight.fit_sequence(source, lobes=2, frames="1001-1003")
    asglight.write_usd(tracks, tmp_path / "sky.usda")
    again = asglight.read_usd(tmp_path / "sky.usda")
    assert again.frames == (1001, 1002, 1003)
    # a sample left out of the stage is reproduced to 1e-6 of the attribute's range
    torch.testing.assert_close(again.lobes.amplitude, tracks.lobes.amplitude, rtol=1e-5, atol=1e-5)
