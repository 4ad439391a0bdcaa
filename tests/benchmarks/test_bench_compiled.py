# SPDX-License-Identifier: Apache-2.0
"""What compiled steps gain: `benchmarks/steps/compiled.py`."""

from pathlib import Path

import pytest
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.fitting import compiled
from asglight.images import write_exr

bench = module("steps.compiled")


def test_a_row_tells_milliseconds_and_their_ratio() -> None:
    *_, row = bench.table([("J", 2e-4, 5e-4)]).splitlines()
    assert row == "| J | 0.2 | 0.5 | 2.5 |"


def test_the_least_of_several_runs_counts_and_torch_takes_every_other() -> None:
    served = []
    ((name, _, _),) = bench.in_turn({"it": lambda: served.append(compiled.LIBRARY is not None)}, 2)
    assert name == "it"
    assert served == [True, False, True, False]


def test_a_map_and_a_sequence_are_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "LOBES", 2)
    monkeypatch.setattr(bench, "PART_RUNS", 1)
    for frame, angle in enumerate((0.0, 4.0)):
        write_exr(tmp_path / f"sky.{frame:04d}.exr", sky_and_sun(angle, 32))
    arguments = [str(tmp_path / "sky.0000.exr"), str(tmp_path), "--runs", "1"]
    assert bench.main(arguments) == 0
    _, _, *rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 9
    with pytest.raises(SystemExit):
        bench.main([str(tmp_path / "none.exr"), str(tmp_path)])
    assert "none.exr" in capsys.readouterr().err


def test_without_compiled_steps_it_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled, "LIBRARY", None)
    with pytest.raises(SystemExit):
        bench.main(["map.exr", "shot"])
    assert "install a C compiler" in capsys.readouterr().err
