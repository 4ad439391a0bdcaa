# SPDX-License-Identifier: Apache-2.0
"""Starts and splits beside those of `fast`: `benchmarks/steps/starts.py`."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.fitting.first_frame.fit import FAST, FirstFrameSettings
from asglight.images import write_exr
from asglight.judging.metrics import frame_errors

starts = module("steps.starts")


def test_a_row_is_a_geometric_mean_over_the_first_settings() -> None:
    names = ("J", *starts.METRICS)
    ours = [
        dict.fromkeys(names, 2.0) | {"seconds": 1.0},
        dict.fromkeys(names, 1.0) | {"seconds": 2.0},
    ]
    theirs = [row | {"r0.5": 3 * row["r0.5"]} for row in ours]
    theirs[1] = theirs[1] | {"env": 4.0, "seconds": 4.0}
    head, rule, first, second = starts.table({"fast": ours, "other": theirs}).splitlines()
    assert head == "| settings | J | env | irr | irrMax | r0.5 | r0.25 | s |"
    assert len(rule.split("|")) == len(head.split("|"))
    assert first == "| fast | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 1.5 |"
    assert second == "| other | 1.00 | 2.00 | 1.00 | 1.00 | 3.00 | 1.00 | 2.5 |"


def test_the_first_settings_are_those_of_fast_and_each_other_differs() -> None:
    assert next(iter(starts.SETTINGS.values())) is FAST
    every = list(starts.SETTINGS.values())
    assert all(every.count(each) == 1 for each in every)


def test_a_fit_is_judged_as_the_judge_does() -> None:
    reference = sky_and_sun(30.0, 16)
    found = starts.measured(reference, replace(FAST, levels=FAST.levels[:1]))
    assert set(found) == {"J", "seconds", *starts.METRICS}
    black = frame_errors(starts.first_frame.dark_lobes(1, starts.Form.ASG, reference), reference)
    assert 0 < found["env"] < black.values["env"]
    assert found["seconds"] > 0


def test_maps_are_turned_by_texels_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given: list[torch.Tensor] = []

    def noted(reference: torch.Tensor, settings: FirstFrameSettings) -> dict[str, float]:
        given.append(reference)
        return dict.fromkeys(("J", "seconds", *starts.METRICS), 1.0)

    write_exr(tmp_path / "sky.exr", sky_and_sun(30.0, 16))
    monkeypatch.setattr(starts, "measured", noted)
    assert starts.main(["--maps", str(tmp_path)]) == 0
    assert len(given) == 3 * len(starts.SETTINGS)
    for turned in given[1:3]:
        assert not torch.equal(turned, given[0])
        assert any(torch.equal(turned, given[0].roll(by, dims=1)) for by in range(1, 32))
    assert capsys.readouterr().out.startswith("| settings |")


def test_an_empty_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        starts.main(["--maps", str(tmp_path)])
    assert "has no .exr; expected latlong OpenEXR files" in capsys.readouterr().err
