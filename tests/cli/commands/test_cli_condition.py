# SPDX-License-Identifier: Apache-2.0
"""What `fit` and `info` say of lobes that stand in for each other."""

import json
from pathlib import Path

import pytest
import sky_files
from lobe_cases import lamps

import asglight
from asglight.cli.condition import condition_lines
from asglight.cli.main import main
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.shots.conditioning import condition_of, with_condition

UP, SIDE, DOWN = (0.0, 1.0, 0.1), (1.0, 0.0, 0.2), (0.0, -1.0, 0.0)


def _tracks() -> LobeTracks:
    """Return a shot in which two lobes meet in the last frame, and two more always lie together."""
    apart = lamps([UP, SIDE, DOWN, DOWN], [40.0, 60.0, 30.0, 30.0], [2.0, 3.0, 1.0, 1.0])
    met = lamps([UP, UP, DOWN, DOWN], [40.0, 60.0, 30.0, 30.0], [2.0, 3.0, 1.0, 1.0])
    return LobeTracks((1, 2, 3), 24.0, stack([apart, apart, met]))


def test_sets_are_told_once_with_the_frame_in_which_they_are_worst() -> None:
    found = condition_of(_tracks())
    assert sorted(tuple(one["lobes"]) for one in found) == [
        ("lobe_00", "lobe_01"),
        ("lobe_02", "lobe_03"),
    ]
    assert {one["frame"] for one in found if one["lobes"][0] == "lobe_00"} == {3}
    # lobes that are alike have no finite amplification
    assert all(one["amplification"] is None or one["amplification"] > 100 for one in found)


def test_the_line() -> None:
    one = {"lobes": ["lobe_02", "lobe_07", "sun"], "frame": 1003, "amplification": 250.0}
    other = {"lobes": ["lobe_01", "lobe_04"], "frame": 1001, "amplification": float("inf")}
    head = "of lobes whose light only together is certain"
    assert condition_lines([]) == []
    assert condition_lines([one]) == [
        f"ill-conditioned: 1 set {head}: lobe_02, lobe_07, sun (frame 1003)"
    ]
    assert condition_lines([one, other]) == [
        f"ill-conditioned: 2 sets {head}: lobe_02, lobe_07, sun (frame 1003); "
        "lobe_01, lobe_04 (frame 1001)"
    ]
    (many,) = condition_lines([one] * 3 + [other] * 2)
    assert many.startswith("ill-conditioned: 5 sets of lobes")
    assert many.endswith("lobe_02, lobe_07, sun (frame 1003); and 2 more (--json)")


def test_info_tells_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = tmp_path / "shot.usda"
    asglight.write_usd(with_condition(_tracks()), stage)
    assert main(["info", str(stage)]) == 0
    assert "ill-conditioned: 2 sets of lobes" in capsys.readouterr().out
    assert main(["info", str(stage), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["ill_conditioned"]
    assert {one["amplification"] is None or one["amplification"] > 100 for one in found} == {True}


def test_fit_tells_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = sky_files.write_sequence(tmp_path / "sky", range(1001, 1002))
    assert main(["fit", str(source), "-o", str(tmp_path / "x.usda"), "--lobes", "2", "--json"]) == 0
    assert isinstance(json.loads(capsys.readouterr().out)["ill_conditioned"], list)
