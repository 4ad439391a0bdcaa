# SPDX-License-Identifier: Apache-2.0
"""Maps that no one looked at: `benchmarks/fits/unseen.py`."""

from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.images import write_exr
from asglight.lobes import Form, Lobes, texels
from asglight.sphere import latlong

unseen = module("fits.unseen")


def _lamp() -> Lobes:
    return Lobes(torch.eye(3)[None], torch.full((1, 2), 60.0), torch.ones(1, 3), Form.ASG)


def test_a_map_that_is_not_turned_stays() -> None:
    radiance = texels.texel_means(_lamp(), 128, 256)
    found = unseen.turned(radiance, torch.eye(3, dtype=torch.float64))
    # samples a third of a texel from its centre take a third of its neighbour, on a lamp of ten
    assert float((found - radiance).abs().sum() / radiance.sum()) < 0.1
    even = unseen.turned(torch.ones(8, 16, 3), unseen.random_axes(3))
    torch.testing.assert_close(even, torch.ones(8, 16, 3))


def test_lamps_turn_with_the_axes() -> None:
    axes = unseen.random_axes(1)
    seen = unseen.turned(texels.texel_means(_lamp(), 64, 128), axes)
    weight = latlong.texel_solid_angles(64, 128)[..., None] * seen
    mean = (weight.sum(-1)[..., None] * latlong.directions(64, 128)).sum((0, 1))
    # the lamp at +Z of the map lies at its components along the axes
    expected = axes.float() @ torch.tensor([0.0, 0.0, 1.0])
    assert float(torch.nn.functional.normalize(mean, dim=0) @ expected) > 0.9999


@pytest.mark.parametrize("count", unseen.LAMPS)
def test_a_room_is_lit_by_its_lamps_and_is_the_same_each_time(count: int) -> None:
    radiance = unseen.room(count)
    assert radiance.shape == (unseen.ROWS, 2 * unseen.ROWS, 3)
    lit = radiance.sum(-1) > 0.5
    assert 0 < float(lit.float().mean()) < 0.7
    area = latlong.texel_solid_angles(*radiance.shape[:2])
    light = radiance.sum(-1) * area
    assert float(light[lit].sum()) > 0.2 * float(light.sum())
    assert torch.equal(radiance, unseen.room(count))


def test_every_case_has_a_row_and_what_misses_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "shots" / "walk").mkdir(parents=True)
    write_exr(tmp_path / "maps" / "sky.exr", sky_and_sun(30.0, 16))
    for frame in range(9):
        write_exr(tmp_path / "shots" / "walk" / f"walk.{frame:04d}.exr", sky_and_sun(30.0, 16))
    errors = {"env": 1.0, "flux": 0.0, "irr": 0.5, "irrMax": 1.0, "r0.5": 1.0, "r0.25": 1.0}

    def noted(reference: torch.Tensor) -> dict[str, dict[str, float]]:
        poor = reference.shape[0] == unseen.ROWS
        own = {name: (0.9 if poor else 0.1) * value for name, value in errors.items()}
        return {"em": errors | {"wall_seconds": 1.0}, "fast": own | {"wall_seconds": 2.0}}

    monkeypatch.setattr(unseen, "measured", noted)
    monkeypatch.setattr(unseen, "fit_frame", lambda *_: None)
    options = ["--maps", str(tmp_path / "maps"), "--sequences", str(tmp_path / "shots")]
    assert unseen.main(options) == 0
    printed = capsys.readouterr().out
    for row in ("sky, turned once", "sky, turned again", "walk 0", "walk 8", "room with lamps: 40"):
        assert f"| {row} |" in printed
    assert "| walk 0 | 0.10 | 0.10 | 0.10 | 0.10 | 0.10 | 2.0 |" in printed
    assert "room with lamps: 1: irr, irrMax, r0.5, r0.25" in printed
    assert "walk 0:" not in printed


def test_the_fit_and_the_peer_are_measured_on_the_same_map(monkeypatch: pytest.MonkeyPatch) -> None:
    reference = sky_and_sun(30.0, 32)
    monkeypatch.setattr(unseen, "LOBES", 3)
    found = unseen.measured(reference)
    assert found["fast"]["r0.5"] < found["em"]["r0.5"]
    assert found["fast"]["wall_seconds"] > 0


def test_a_fit_that_does_not_count_comes_before_the_first_of_a_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[tuple[str, int]] = []
    monkeypatch.setattr(
        unseen, "fit_frame", lambda reference, *_: done.append(("fit", len(reference)))
    )
    monkeypatch.setattr(
        unseen, "measured", lambda reference: done.append(("measured", len(reference)))
    )
    cases = [("a", torch.ones(8, 16, 3)), ("b", torch.ones(8, 16, 3)), ("c", torch.ones(4, 8, 3))]
    assert list(unseen.every(cases)) == ["a", "b", "c"]
    large, small = ("measured", 8), ("measured", 4)
    assert done == [("fit", 8), large, large, ("fit", 4), small]


def test_a_wrong_folder_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        unseen.main(["--maps", str(tmp_path / "nothing")])
    assert ended.value.code == 2
    assert "nothing" in capsys.readouterr().err.splitlines()[-1]
