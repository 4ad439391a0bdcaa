# SPDX-License-Identifier: Apache-2.0
"""All that is measured on a GPU, by one command: `python -m benchmarks.gpu`."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from bench_scripts import BENCHMARKS, float32_here, module

from asglight.images import write_exr

command = module("gpu.__main__")
data, plan, rows, running, tables, marked = (
    module(f"gpu.{name}") for name in ("data", "plan", "rows", "running", "table", "marked_tests")
)

ROOT = BENCHMARKS.parent


def given(**others: Any) -> Any:
    """Return what a short measure on the processor is given."""
    there = {"device": "cpu", "short": True, "seconds": 60.0}
    paths = {"maps": Path("none"), "sequence": Path("none")}
    return rows.Given(**{**there, **paths, **others})


TRIED = ("tests", "first frame")
"""Measures that the trial takes, the first of them in a process of its own."""


def taken(measure: Any, own: Any, left: float) -> dict[str, Any]:
    """Take a measure; none but the first in a process that loads torch anew."""
    if measure.name == TRIED[0]:
        return running.taken(measure, own, left)
    found = module(f"gpu.{measure.module}").measure(own)
    rows_found = [row.as_json() for row in found]
    return {"state": "done", "seconds": 0.0, "rows": rows_found, "why": ""}


def test_a_trial_on_the_processor_takes_its_measures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "taken", taken)
    nowhere = str(tmp_path / "none")
    words = ["-o", str(tmp_path), "--device", "cpu", "--short", "--maps", nowhere]
    words += ["--sequence", nowhere, "--measures", *TRIED]
    # a busy machine may take longer than a GPU's
    assert command.main([*words, "--deadline", "4000"]) == 0
    document = json.loads((tmp_path / "gpu.json").read_text())
    assert document["device"] == "cpu"
    assert tuple(document["measures"]) == TRIED
    for name, measure in document["measures"].items():
        assert measure["state"] == "done", f"{name}: {measure['why']}"
        assert measure["rows"], name
        assert not any(row["missed"] for row in measure["rows"]), name
    text = (tmp_path / "gpu.md").read_text()
    assert text == capsys.readouterr().out
    lines = text.splitlines()
    assert lines[0].startswith("cpu, torch ")
    assert lines[2] == "| measure | what | found | goal |"
    found = {line.split(" | ")[0].strip("| ") for line in lines[4:]}
    assert found == set(document["measures"])
    assert len(lines) == 4 + sum(len(each["rows"]) for each in document["measures"].values())
    assert all(line.count("|") == 5 for line in lines[4:])


@pytest.mark.parametrize(
    "measure",
    [each for each in plan.MEASURES if each.name not in TRIED],
    ids=lambda each: each.name,
)
def test_a_short_measure_has_rows_that_meet_their_goals(
    measure: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    float32_here(monkeypatch)
    own = given(choice=measure.choice, seconds=measure.seconds)
    found = list(module(f"gpu.{measure.module}").measure(own))
    assert found
    assert not any(row.as_json()["missed"] for row in found)


def test_all_measures_fit_into_the_deadline() -> None:
    assert sum(measure.seconds for measure in plan.MEASURES) < plan.DEADLINE == 480


def test_a_measure_that_fails_is_told_and_so_are_its_rows() -> None:
    found = running.taken(plan.Measure("none", "plan", 60.0), given(), 60.0)
    assert found["state"] == "failed"
    assert found["why"].splitlines()[-1].startswith("AttributeError: module 'benchmarks.gpu.plan'")
    assert found["rows"] == []


def test_a_measure_that_takes_too_long_is_ended_and_one_without_time_not_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measure = plan.Measure("first frame", "first_frame", 0.05)
    assert running.taken(measure, given(), 60.0)["state"] == "not begun"
    monkeypatch.setattr(running, "LEAST", 0.0)
    found = running.taken(measure, given(), 60.0)
    assert (found["state"], found["why"]) == ("over time", "ended after 0 s")
    assert running.taken(measure._replace(seconds=9.0), given(), -1.0)["state"] == "not begun"


def _document(**states: str) -> dict[str, Any]:
    row = rows.Row("a | b", {"s": 12.0, "name": "x"}, {"s": 10.0}).as_json()
    good = rows.Row("c", {"s": 8.0}, {"s": 10.0}).as_json()
    measures = {
        name: {"state": state, "rows": [row if name == "slow" else good], "why": "first\nlast|"}
        for name, state in states.items()
    }
    machine = {"torch": "2", "processor": "p", "cores": 3}
    return {"device": "X", "short": False, "machine": machine, "measures": measures}


def test_the_table_shows_goals_that_were_missed_and_what_failed() -> None:
    text = tables.table(_document(slow="done", broken="failed"))
    assert text.startswith("X, torch 2, p, 3 cores\n\n| measure |")
    assert r"| slow | a \| b | s 12, name x | **missed**: s ≤ 10 |" in text
    assert "| broken | c | s 8 | s ≤ 10 |\n| broken | **failed**: last\\| |  |  |" in text


def test_what_is_no_number_misses_its_goal_and_can_be_written() -> None:
    row = rows.Row("a", {"J": float("nan"), "s": 1.0}, {"J": 1e-4}).as_json()
    assert row["missed"]
    assert json.loads(json.dumps(row, allow_nan=False))["found"] == {"J": "nan", "s": 1.0}


@pytest.mark.parametrize(
    ("states", "status"),
    [
        ({"quick": "done"}, 0),
        ({"slow": "done"}, 3),
        ({"slow": "done", "other": "over time"}, 1),
        ({"quick": "not begun"}, 1),
    ],
)
def test_the_exit_status_says_what_failed(states: dict[str, str], status: int) -> None:
    assert command.status_of(_document(**states)) == status


def test_no_gpu_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SystemExit) as end:
        command.main([])
    assert end.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("python -m benchmarks.gpu: error: --device cuda: torch ")
    assert said.endswith(
        "finds no CUDA device here; install a torch built for CUDA and its driver, "
        "or try --device cpu --short."
    )


def test_maps_and_shots_are_read_where_they_are_and_made_up_elsewhere(tmp_path: Path) -> None:
    for frame in (1, 2, 3):
        write_exr(tmp_path / f"sky.{frame:04d}.exr", torch.full((16, 32, 3), float(frame)))
    own = given(short=False, maps=tmp_path, sequence=tmp_path)
    assert list(data.maps(own)) == ["sky.0001", "sky.0002", "sky.0003"]
    frames = data.shot(own, 6)
    assert [float(frame.mean()) for frame in frames] == [1.0, 2.0, 3.0, 2.0, 1.0, 2.0]
    assert len(data.maps(given())) == data.MADE_UP
    moved = data.shot(given(), 2)
    assert not torch.equal(moved[0], moved[1])
    assert float(moved[0].min()) > 0


def test_no_two_stills_are_alike() -> None:
    found = data.stills(given(), 20)
    assert len(found) == 20
    assert all(
        not torch.equal(one, other) for k, one in enumerate(found) for other in found[k + 1 :]
    )


def test_tests_that_need_a_gpu_are_found() -> None:
    files = [path for path in (ROOT / "tests").rglob("*.py") if marked.is_marked(path)]
    names = {path.name for path in files}
    assert {"test_fitting_captured.py", "test_fitting_stills.py"} <= names
    assert "test_bench_parts.py" not in names


def test_wheels_that_are_nowhere_are_refused() -> None:
    told = {**os.environ, "WHEELS": "/no/wheels", "PYTHON": sys.executable}
    done = subprocess.run(
        ["sh", ".ci/gpu"], cwd=ROOT, env=told, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "gpu: WHEELS: /no/wheels: is no folder; expected one of wheels" in done.stderr


def test_what_is_installed_is_what_the_project_states() -> None:
    done = subprocess.run(
        [sys.executable, ".ci/gpu-needs"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    stated = (ROOT / "pyproject.toml").read_text()
    needs = done.stdout.split()
    assert {"numpy", "torch", "moderngl", "pytest"} <= {each.partition(">")[0] for each in needs}
    assert all(f'"{each}"' in stated for each in needs)
