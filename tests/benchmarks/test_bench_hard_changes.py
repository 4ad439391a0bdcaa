# SPDX-License-Identifier: Apache-2.0
"""What changes too hard to be followed: `benchmarks/shots/hard_changes.py`."""

from itertools import pairwise
from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun

from asglight.images import write_exr
from asglight.sphere import latlong

hard = module("shots.hard_changes")
ROWS = hard.ROWS


def _flux(radiance: torch.Tensor) -> float:
    areas = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)
    return float((areas[..., None] * radiance).sum())


@pytest.mark.parametrize("degrees", [0.0, 100.0])
def test_a_lamp_has_its_share_of_the_flux_where_it_is_wanted(degrees: float) -> None:
    sky = sky_and_sun(0.0, ROWS)
    disc = hard.lamp(sky, degrees)
    assert _flux(disc) == pytest.approx(hard.LAMP_FLUX * _flux(sky), rel=1e-4)
    row, column = divmod(int(disc.sum(-1).argmax()), 2 * ROWS)
    x, y, z = latlong.directions(ROWS, 2 * ROWS)[row, column].tolist()
    wanted = torch.deg2rad(torch.tensor([degrees, 30.0]))
    found = torch.tensor([x, z, y])
    expected = [wanted[1].cos() * wanted[0].sin(), wanted[1].cos() * wanted[0].cos(), 0.5]
    torch.testing.assert_close(found, torch.tensor(expected), atol=0.06, rtol=0)


def test_from_the_centre_all_is_where_it_was_and_what_is_near_is_larger() -> None:
    ahead = (latlong.directions(ROWS, 2 * ROWS)[..., :1] > 0.9).float().expand(-1, -1, 3)
    assert torch.equal(hard.seen_from(ahead, 0.0), ahead)
    # a cap of cosine .9 at 1 from the centre: seen from .5 on the way to it at tan = .436 / .4
    near = hard.seen_from(ahead, 0.5)
    cosine = 0.4 / (0.4**2 + 1 - 0.9**2) ** 0.5
    assert _flux(near) / 3 == pytest.approx(2 * torch.pi * (1 - cosine), rel=0.02)


@pytest.mark.parametrize("change", hard.CHANGES.values())
def test_a_change_makes_frames_that_differ(change: hard.Change) -> None:
    maps = [sky_and_sun(degrees, ROWS) for degrees in (0.0, 120.0)]
    frames = change(*maps)
    assert len(frames) == hard.FRAMES
    assert any(not torch.equal(frames[0], each) for each in frames)
    assert all(each.shape == maps[0].shape and bool((each >= 0).all()) for each in frames)


def test_every_change_is_followed_by_every_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for index, degrees in enumerate((0.0, 120.0)):
        write_exr(tmp_path / f"sky{index}.exr", sky_and_sun(degrees, 16))
    monkeypatch.setattr(hard, "ROWS", 16)
    monkeypatch.setattr(hard, "FRAMES", 3)
    monkeypatch.setattr(hard, "LOBES", 2)
    monkeypatch.setattr(hard, "CHANGES", {"cuts": lambda one, two: [one, two, one]})
    assert hard.main(["--maps", str(tmp_path)]) == 0
    _, _, *rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[1] for row in rows] == ["live", "fast", "best", "afresh"]
    assert all(float(row.split(" | ")[3]) < 0.05 for row in rows)  # r0.5


def test_a_row_has_the_means_and_the_worst_frame_of_all_shots() -> None:
    shots = [hard.Shot([0.1, 0.3], [0.2, 0.4], 0.1, 0.0), hard.Shot([0.2], [0.0], 0.2, 0.0)]
    assert hard.row("a", "fast", shots) == "| a | fast | 0.2000 | 0.2000 | 0.400 | 0.1500 |"


def test_fits_from_nothing_have_no_flicker_to_show() -> None:
    shot = hard.Shot([0.1], [0.2], float("nan"), float("nan"))
    assert hard.row("a", "afresh", [shot]) == "| a | afresh | 0.1000 | 0.2000 | 0.200 | – |"


def test_a_camera_in_the_hand_turns_the_whole_map_by_little() -> None:
    sky = sky_and_sun(0.0, ROWS)
    frames = hard.in_the_hand(sky, sky)
    suns = [
        latlong.directions(ROWS, 2 * ROWS).flatten(0, 1)[each.sum(-1).argmax()] for each in frames
    ]
    steps = [float(one @ other) for one, other in pairwise(suns)]
    least = torch.deg2rad(torch.tensor(8.0)).cos()  # four standard deviations on two axes, a texel
    assert least < min(steps) < 0.9999
    assert [_flux(each) for each in frames] == pytest.approx([_flux(sky)] * len(frames), rel=0.01)
