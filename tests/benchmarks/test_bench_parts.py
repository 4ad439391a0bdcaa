# SPDX-License-Identifier: Apache-2.0
"""What cutting a shot into parts costs: `benchmarks/shots/parts.py`."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.images import write_exr
from asglight.judging.stress import maps as stress_maps
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack

parts = module("shots.parts")


def test_parts_are_thirds_that_share_four_frames() -> None:
    found = parts.cut(range(1001, 1049))
    assert found == [(1001, 1018), (1015, 1034), (1031, 1048)]


@pytest.mark.parametrize("count", [12, 13, 25])
def test_parts_hold_all_frames_and_neighbours_share_as_many(count: int) -> None:
    found = parts.cut(range(count))
    held = [set(range(part.first, part.last + 1)) for part in found]
    assert set.union(*held) == set(range(count))
    assert all(len(a & b) == parts.OVERLAP for a, b in pairwise(held))


def test_a_lobe_goes_on_that_is_lit_before_and_after() -> None:
    lit = stress_maps.lamps([(1, 0, 0), (0, 1, 0), (0, 0, 1)], 100.0)
    shares = torch.tensor([[0.5, 0.5, 0.0], [0.5, 0.0, 0.5]])[..., None]
    frames = [replace(lit, amplitude=lit.amplitude * share) for share in shares]
    tracks = LobeTracks((1, 2), 24.0, stack(frames))
    assert parts.going_on(tracks, 1, 2) == (1, 2)
    assert parts.going_on(tracks, 1, 1) == (2, 2)


def test_a_shot_is_fitted_whole_and_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(parts, "OVERLAP", 2)
    done = parts._done
    fewer = {"fit": ["--lobes", "2"], "stitch": []}
    monkeypatch.setattr(parts, "_done", lambda words: done([*words, *fewer[words[0]]]))
    for frame in range(6):
        write_exr(tmp_path / f"sky.{frame + 1:04d}.exr", sky_and_sun(2.0 * frame, 16))
    assert parts.main([str(tmp_path), "--preset", "live"]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("| fit | irr | r0.5 |")
    names = [row.split(" | ")[0].strip("| ") for row in rows]
    assert names == ["one fit", "parts", "parts from nothing"]
    # with a preroll parts of live are the one fit, but for what each by itself leaves out
    whole, cut = ([float(cell) for cell in row.split(" | ")[1:6]] for row in rows[:2])
    assert cut == pytest.approx(whole, abs=2.1e-4)


def test_a_shot_too_short_to_cut_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_exr(tmp_path / "sky.0001.exr", sky_and_sun(0.0, 16))
    with pytest.raises(SystemExit) as end:
        parts.main([str(tmp_path)])
    assert end.value.code == 2
    assert ": 1 frame; expected 12 or more. Give a longer" in capsys.readouterr().err
