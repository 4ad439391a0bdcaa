# SPDX-License-Identifier: Apache-2.0
"""Light between frames and at them, measured: `benchmarks/motion`."""

import json
from functools import partial
from pathlib import Path

import pytest
from lobe_cases import sky_and_sun

from asglight.images import write_exr
from benchmarks.motion import measure, tables
from tests.support.old_files import old_files


@pytest.fixture
def sequences(tmp_path: Path) -> Path:
    """A folder of one sequence: a sun that moves by three degrees a frame."""
    folder = tmp_path / "all" / "sun"
    folder.mkdir(parents=True)
    for frame in range(1001, 1008):
        write_exr(folder / f"sun.{frame}.exr", sky_and_sun(3.0 * (frame - 1001), 32))
    return tmp_path / "all"


def test_a_moving_sun_is_one_track_and_right_between_frames(
    sequences: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Dissolved maps show two suns half-way; lobes show one, where it is."""
    monkeypatch.setattr(measure, "LOBES", 4)
    monkeypatch.setattr(measure, "fit_sequence", partial(measure.fit_sequence, lobes=4))
    linked = old_files(tmp_path / "out", "motion.json", "sun.png")
    status = measure.main(
        ["--sequences", str(sequences), "--presets", "fast", "-o", str(tmp_path / "out")]
    )
    assert status == 0
    assert [kept.read_text() for kept in linked] == ["old", "old"]
    found = json.loads((tmp_path / "out" / "motion.json").read_text())["sun"]["fast"]
    assert found["ratios"]["rule"]["r0.25"] < 0.9
    assert found["ratios"]["maps"]["r0.25"] > 0.9
    assert found["passages"]
    assert all(one["share"] == 1 for one in found["passages"])
    assert (tmp_path / "out" / "sun.png").stat().st_size > 1000
    printed = capsys.readouterr().out
    assert "| sun, fast | stage |" in printed
    assert printed.strip() == tables.tables({"sun": {"fast": found}}).strip()


def test_a_folder_without_sequences_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "none").mkdir()
    words = ["--sequences", str(tmp_path / "none"), "-o", str(tmp_path / "out")]
    assert measure.main(words) == 2
    assert "no sequence found; expected folders of images" in capsys.readouterr().err


def test_only_names_that_are_there_are_measured(sequences: Path) -> None:
    assert [one.name for one in measure.sequences_in([sequences], ["sun"])] == ["sun"]
    with pytest.raises(measure.InputError):
        measure.sequences_in([sequences], ["moon"])
