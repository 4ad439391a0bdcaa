# SPDX-License-Identifier: Apache-2.0
"""How little a sequence can flicker: `benchmarks/shots/flicker_floor.py`."""

from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.fitting.first_frame.fit import exposed, on_fine_cells
from asglight.fitting.loss import lobe_images
from asglight.fitting.options import FitOptions
from asglight.images import write_exr
from asglight.judging.following import follow
from asglight.judging.metrics import frame_errors, sequence_errors

floor = module("shots.flicker_floor")

MAPS = [(1 + 0.5 * frame) * sky_and_sun(18.0 * frame, 32) for frame in range(3)]


def test_the_error_of_a_frame_is_told_on_the_leaves_and_in_the_units_of_another() -> None:
    own, other = exposed(MAPS[0]), exposed(MAPS[2])
    lobes = follow(MAPS[:1], FitOptions(3))[0][0]
    wanted = on_fine_cells(other)
    radiance, parts = floor._error(lobes, own, other, wanted)
    shown = lobe_images.images(lobes.to(torch.float32)[None], wanted.places).radiance
    assert shown.shape[-1] == 32 * 64  # every adaptive cell is a texel
    expected = shown - own.radiance * own.exposure
    torch.testing.assert_close(radiance * other.exposure, expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(parts.mean(1) * other.exposure, expected, rtol=1e-4, atol=1e-4)


def test_lobes_that_are_asked_for_the_change_flicker_less() -> None:
    frames = [exposed(radiance) for radiance in MAPS]
    lobes = follow(MAPS, FitOptions(3), fresh=True)[0]
    before, after = (
        sequence_errors(
            (k, frame_errors(*pair)) for k, pair in enumerate(zip(shot, MAPS, strict=True))
        ).mean["flicker"]
        for shot in (lobes, floor.steadied(lobes, frames))
    )
    assert after < 0.95 * before


def test_the_table_holds_each_way_against_the_first() -> None:
    found = floor.measured(MAPS[:2], 2)
    lines = floor.table(found).splitlines()
    assert lines[0].startswith("| lobes | irr | r0.5 | r0.25 | flicker |")
    assert [line.split(" | ")[0] for line in lines[2:]] == [
        "| fast from nothing",
        "| best from nothing",
        "| r0.25 alone",
        "| r0.25 and its change",
    ]
    assert lines[2].endswith(" 1.00 |")
    first, last = (found[name].mean["flicker"] for name in list(found)[:: len(found) - 1])
    assert lines[-1].endswith(f" {last / first:.2f} |")


@pytest.mark.parametrize(
    ("maps", "says"),
    [
        (MAPS[:1], "1 frame; expected two or more to follow"),
        ([MAPS[0], 0 * MAPS[0]], "has black frames; expected some light in each"),
    ],
)
def test_what_cannot_flicker_is_refused(
    maps: list[torch.Tensor], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for frame, radiance in enumerate(maps):
        write_exr(tmp_path / f"sky.{1001 + frame}.exr", radiance)
    with pytest.raises(SystemExit):
        floor.main([str(tmp_path)])
    assert says in capsys.readouterr().err
