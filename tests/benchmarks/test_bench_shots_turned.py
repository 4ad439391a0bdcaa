# SPDX-License-Identifier: Apache-2.0
"""A sequence followed whichever way it is turned: `benchmarks/shots/turned.py`."""

from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.fitting.options import FitOptions, Preset
from asglight.images import write_exr

turned = module("shots.turned")


@pytest.mark.parametrize("turns", [2, 8])
def test_each_way_has_the_same_light_in_another_place_or_order(turns: int) -> None:
    maps = [sky_and_sun(degrees, 16) for degrees in (0.0, 20.0)]
    found = turned.ways(maps, turns)
    assert len(found) == 3 * turns
    keys = {tuple(each.numpy().tobytes() for each in way) for way in found}
    assert len(keys) == 3 * turns
    for way in found:
        assert sum(float(each.sum()) for each in way) == pytest.approx(
            sum(float(each.sum()) for each in maps), rel=1e-6
        )
    assert torch.equal(found[turns][0], maps[1])
    assert torch.equal(found[2 * turns][0], maps[0].flip(1))


@pytest.mark.parametrize("preset", list(turned.PRESETS))
def test_what_stands_still_does_not_flicker(preset: Preset) -> None:
    still = turned.measured([sky_and_sun(0.0, 16)] * 3, FitOptions(3, preset))
    assert len(still.rough) == len(still.irr) == 3
    assert still.flicker < 0.2 * max(still.rough)
    assert still.seconds > 0


def test_fits_from_nothing_do_not_hang_on_the_frames_before() -> None:
    maps = [sky_and_sun(0.0, 16), sky_and_sun(90.0, 16)]
    fit = FitOptions(3, Preset.FAST)
    both = turned.measured(maps, fit, fresh=True)
    alone = turned.measured(maps[1:] * 2, fit, fresh=True)
    # what is missed is a difference of light of about 1 in float32
    assert both.rough[1] == pytest.approx(alone.rough[0], abs=2**-23)


def test_flicker_is_the_change_of_what_is_missed_over_the_whole() -> None:
    maps = [sky_and_sun(0.0, 16), 2 * sky_and_sun(0.0, 16)]
    truth = [turned.measures.shown(each) for each in maps]
    black = turned.stack([turned.Lobes(*_black())] * 2)
    # black lobes miss 1, then 2, of 3: a third
    assert turned._flicker([black[0], black[1]], truth) == pytest.approx(1 / 3, rel=1e-5)


def _black() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    return torch.eye(3)[None], torch.full((1, 2), 4.0), torch.zeros(1, 3)


def test_the_table_tells_the_luckiest_and_the_unluckiest() -> None:
    one = turned.Shot([0.1, 0.3], [0.1, 0.4], 0.2, 0.5)
    other = turned.Shot([0.1, 0.1], [0.2, 0.2], 0.4, 1.5)
    *_, row = turned.table({"fast": [one, other]}).splitlines()
    expected = "| fast | 0.1500 | 0.2250 | 0.2500 | 1.11 | 0.200 to 0.400 | 0.3000 | 1.000 |"
    assert row == expected


def test_a_sequence_is_read_and_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for frame in range(1001, 1004):
        write_exr(tmp_path / f"sky.{frame}.exr", sky_and_sun(frame - 1001.0, 16))
    given: list[int] = []
    lobes: list[tuple[int | None, bool]] = []

    def noted(maps: list[torch.Tensor], options: FitOptions, *, fresh: bool = False) -> object:
        given.append(len(maps))
        lobes.append((options.lobes, fresh))
        return turned.Shot([0.0], [0.1], 0.0, 0.0)

    monkeypatch.setattr(turned, "measured", noted)
    assert turned.main([str(tmp_path), "--frames", "2"]) == 0
    assert given == [2] * 18
    assert capsys.readouterr().out.startswith("| preset |")
    lobes.clear()
    assert turned.main([str(tmp_path), "--turns", "1", "--afresh", "5", "7"]) == 0
    assert lobes == [(15, False)] * 9 + [(5, True)] * 3 + [(7, True)] * 3
    assert "| afresh, 7 lobes |" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        turned.main([str(tmp_path), "--afresh", "0"])
    assert "--afresh 0; expected one or more" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        turned.main([str(tmp_path), "--frames", "1"])
    assert "1 frame; expected two or more to follow" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        turned.main([str(tmp_path), "--turns", "0"])
    assert "--turns 0; expected one or more" in capsys.readouterr().err


def test_a_folder_without_images_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        turned.main([str(tmp_path)])
    last = capsys.readouterr().err.splitlines()[-1]
    assert str(tmp_path) in last
    assert "holds no image" in last
