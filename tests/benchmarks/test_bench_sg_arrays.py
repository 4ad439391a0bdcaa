# SPDX-License-Identifier: Apache-2.0
"""`benchmarks/stages/sg_arrays.py`: round lobes lose nothing in an array, narrow ones in NeRD's."""

from pathlib import Path

import pytest
import torch

from asglight.images import write_exr
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around
from benchmarks.stages import sg_arrays


def lamp(sharpness: float) -> Lobes:
    axis = torch.tensor([[0.6, 0.0, 0.8]])
    return Lobes(axes_around(axis), torch.full((1, 2), sharpness), torch.ones(1, 3), Form.SG)


@pytest.mark.parametrize(("sharpness", "is_kept"), [(20.0, True), (400.0, False)])
def test_nerd_holds_what_is_broad_enough(sharpness: float, is_kept: bool) -> None:
    lobes = lamp(sharpness)
    found = dict(sg_arrays.rows(lobes, texels.texel_means(lobes, 32, 64)))
    assert list(found) == ["the fit", "PhySG's array", "NeRD's array"]
    assert float(found["the fit"][0]) < 1e-3
    assert float(found["PhySG's array"][0]) < 1e-3
    assert (float(found["NeRD's array"][0]) < 1e-3) == is_kept


def test_a_map_gives_six_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_exr(tmp_path / "lamp.exr", texels.texel_means(lamp(20.0), 16, 32) + 0.01)
    assert sg_arrays.main([str(tmp_path / "lamp.exr"), "--lobes", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| map | fitted as | shown by | env | irr | r0.5 | r0.25 |"
    assert [line.split(" | ")[1] for line in lines[2:]] == ["asg"] * 3 + ["sg"] * 3
