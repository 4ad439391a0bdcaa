# SPDX-License-Identifier: Apache-2.0
"""Whole commands as ratios, and their gate: `python -m benchmarks.command`."""

import contextlib
import io
import json
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from bench_scripts import module

from asglight.cli.main import main as asglight_main
from asglight.errors import InputError
from asglight.fitting.options import FitOptions
from asglight.images import read_latlong

command = module("command.__main__")
frames, gate, measures, parts, runs = (
    module(f"command.{name}") for name in ("frames", "gate", "measures", "parts", "runs")
)

NAMES = list(measures.RATIOS)
SIZES = measures.Sizes().as_json()

FEW = ("--lobes", "2")
"""In place of the fifteen that are fitted where none are asked for."""

RUN = runs.run


def baseline(path: Path, **changed: float) -> Path:
    """Write a baseline of ones, but for what is changed."""
    found = dict.fromkeys(NAMES, 1.0) | changed
    path.write_text(json.dumps(gate.as_baseline(found, SIZES)))
    return path


def _run(words: Sequence[str]) -> Any:
    """Run asglight and the parts in this process; what takes no more than torch, in its own."""
    begin, out = time.perf_counter(), io.StringIO()
    with contextlib.redirect_stdout(out):
        if tuple(words[:2]) == measures.ASGLIGHT:
            fewer = FEW if words[2] == "fit" and "--lobes" not in words else ()
            assert asglight_main([*words[2:], *fewer]) == 0
        elif words[:2] == ["-m", "benchmarks.command.parts"]:
            assert parts.main(words[2:]) == 0
        else:
            return RUN(words)
    return runs.Run(time.perf_counter() - begin, 0.0, 2_000_000, out.getvalue())


def test_a_trial_runs_every_command_and_renews_the_baseline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runs, "run", _run)
    monkeypatch.setattr(parts, "FitOptions", lambda count=2, **others: FitOptions(count, **others))
    target = tmp_path / "baseline.json"
    words = ["-o", str(tmp_path), "--short", "--baseline", str(target)]
    assert command.main([*words, "--bless"]) == 0
    document = json.loads((tmp_path / "command.json").read_text())
    assert list(document["ratios"]) == NAMES
    assert all(math.isfinite(value) and value > 0 for value in document["ratios"].values())
    for name, own in document["commands"].items():
        assert all(each["peak_bytes"] > 1e6 for each in own), name  # more than nothing at all
        assert all(each["wall_seconds"] > 0 for each in own), name
    found = gate.read(target, NAMES, measures.SHORT.as_json())
    assert found == {name: round(value, 3) for name, value in document["ratios"].items()}
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| ratio | now | baseline |"
    assert sum(line.startswith("| ") for line in lines) == 2 + len(NAMES) + len(
        document["commands"]
    )


def _measured(monkeypatch: pytest.MonkeyPatch, **changed: float) -> None:
    """Let every time be 1 s, but for those of some commands."""
    part = json.dumps({"fit": 1.0, "write": 1.0, "few": 1.0, "many": 1.0})
    names = {of.command for pair in measures.RATIOS.values() for of in pair}
    found = {name: [runs.Run(changed.get(name, 1.0), 0.5, 2_000_000, part)] for name in names}
    monkeypatch.setattr(command, "measured", lambda folder, sizes: found)


def test_a_ratio_that_got_worse_ends_with_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["-o", str(tmp_path), "--baseline", str(baseline(tmp_path / "b.json"))]
    _measured(monkeypatch, large=1.2)
    assert command.main(words) == 0
    assert "| 4k over 256 rows | 1.20 | 1.00 |" in capsys.readouterr().out
    _measured(monkeypatch, large=1.4)
    assert command.main(words) == 3
    out = capsys.readouterr().out
    assert out.splitlines()[-1] == "worse: 4k over 256 rows: 1.40, was 1.00; at most 1.30"
    assert "| large | 1.40 | 0.50 | 2 |" in out


def test_the_committed_baseline_is_of_the_ratios_that_are_measured() -> None:
    assert all(value > 0 for value in gate.read(command.BASELINE, NAMES, SIZES).values())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "No such file or directory; expected a baseline."),
        ("{", "is no JSON; expected a baseline."),
        ("[]", "is no baseline of this version; expected one."),
        (
            json.dumps(gate.as_baseline({"a": 1.0}, SIZES)),
            "has a; expected --help over import torch, ",
        ),
        (json.dumps(gate.as_baseline(dict.fromkeys(NAMES, 1.0), {"frames": 1})), "is of {'frames"),
        ('{"asglight_command_baseline": 1}', "has no ratios and sizes; expected a baseline."),
        (
            '{"asglight_command_baseline": 1, "ratios": {}}',
            "has no ratios and sizes; expected a baseline.",
        ),
        *(
            (
                json.dumps(gate.as_baseline({}, SIZES) | {"ratios": dict.fromkeys(NAMES, value)}),
                said,
            )
            for value, said in (
                ("x", "no ratio; expected a baseline."),
                (math.nan, "no ratio; expected a baseline."),
            )
        ),
    ],
)
def test_another_baseline_is_refused_before_any_time_is_spent(
    tmp_path: Path, text: str | None, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "b.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(SystemExit) as end:
        command.main(["-o", str(tmp_path), "--baseline", str(path)])
    assert end.value.code == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert said in line
    assert line.endswith("Write it anew with --bless.")


def test_a_pipe_is_no_baseline_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(InputError, match=r"pipe\.json: is no file; expected a baseline\. Write it"):
        gate.read(tmp_path / "pipe.json", NAMES, SIZES)


def test_no_run_at_all_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        command.main(["--times", "0"])
    assert end.value.code == 2
    assert "--times: 0; expected 1 or more" in capsys.readouterr().err


def test_a_trial_does_not_become_the_baseline(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "measured", lambda folder, sizes: pytest.fail("time was spent"))
    with pytest.raises(SystemExit) as end:
        command.main(["--short", "--bless"])
    assert end.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "--bless: --short would put a trial in place of the baseline; expected one of" in said


def test_a_command_that_fails_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: Any) -> None:
        runs.run(["-c", "import sys; sys.exit('no light')"])

    monkeypatch.setattr(command, "measured", fails)
    path = baseline(tmp_path / "b.json")
    assert command.main(["-o", str(tmp_path), "--baseline", str(path)]) == 1
    assert capsys.readouterr().err.endswith("ended with 1: no light.\n")


def test_a_run_tells_what_it_took() -> None:
    found = runs.run(["-c", "print(len(bytearray(50_000_000)))"])
    assert found.printed == "50000000\n"
    assert found.peak > 50_000_000
    assert runs.run(["-c", "pass"]).peak < 50_000_000  # not what this process holds
    assert found.cpu > 0
    assert found.wall > 0


def test_commands_take_turns() -> None:
    found = runs.in_turn({"one": ["-c", "print(1)"], "two": ["-c", "print(2)"]}, 2)
    assert [run.printed for run in found["two"]] == ["2\n", "2\n"]


def test_frames_are_lamps_that_go_about_a_sky(tmp_path: Path) -> None:
    frames.written(tmp_path, 2, 32)
    paths = sorted(tmp_path.glob("*.exr"))
    assert [path.name for path in paths] == ["sky.1001.exr", "sky.1002.exr"]
    one, other = (read_latlong(path).radiance for path in paths)
    assert one.shape == (32, 64, 3)
    assert float(one.max()) > 50
    assert not torch.equal(one, other)
