# SPDX-License-Identifier: Apache-2.0
"""Pictures: the view transform, lobe outlines, what the sheets show and what they refuse."""

import math
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import torch

from asglight.errors import InputError
from asglight.judging.pictures.display import exposure_stops, view_transform
from asglight.judging.pictures.figures import ball_sheet, contact_sheet
from asglight.judging.pictures.outlines import colour, outline, segments
from asglight.lobes import Form, Lobes
from asglight.sphere import latlong

FRAMES = list(range(1001, 1009))


def _lobes(count: int = 2, form: Form = Form.ASG, frames: int = len(FRAMES)) -> Lobes:
    return Lobes(
        axes=torch.eye(3).expand(frames, count, 3, 3),
        sharpness=torch.tensor([20.0, 80.0]).expand(frames, count, 2),
        amplitude=torch.ones(frames, count, 3),
        form=form,
    )


def _maps(value: float = 1.0) -> torch.Tensor:
    return torch.full((len(FRAMES), 16, 32, 3), value)


def test_exposure_brings_an_even_map_to_middle_grey() -> None:
    assert exposure_stops(_maps(0.72)) == pytest.approx(-2.0)  # 0.72 / 4 = 0.18


def test_exposure_does_not_follow_a_small_sun() -> None:
    maps = _maps(0.18)
    maps[:, 5, 7] = 1e5
    assert exposure_stops(maps) == pytest.approx(0.0, abs=1e-6)


def test_exposure_of_darkness_is_zero() -> None:
    assert exposure_stops(_maps(0.0)) == 0.0


def test_view_transform_encodes_srgb_below_the_shoulder() -> None:
    # IEC 61966-2-1: 0.18 -> 0.4614 -> 118; 0.002 -> 0.02584 -> 7; a stop up, 0.5 -> 0.7354 -> 188.
    grey = torch.tensor([[0.18] * 3, [0.002] * 3])
    assert view_transform(grey, 0.0)[:, 0].tolist() == [118, 7]
    assert view_transform(torch.full((1, 3), 0.25), 1.0).tolist() == [[188] * 3]


def test_view_transform_rises_smoothly_to_white() -> None:
    ramp = torch.logspace(-3, 6, 400)[:, None].expand(-1, 3)
    shown = view_transform(ramp, 0.0)[:, 0].astype(int)
    assert (np.diff(shown) >= 0).all()
    assert np.diff(shown).max() <= 8  # 9 decades in 400 steps: no edge
    assert shown[-1] == 255


def test_view_transform_keeps_the_hue_of_a_lamp_and_turns_a_sun_white() -> None:
    orange = torch.tensor([1.0, 0.4, 0.05])
    lamp, sun = view_transform(torch.stack([5 * orange, 1e5 * orange]), 0.0).astype(int)
    assert lamp[0] > lamp[1] > lamp[2]
    assert lamp[0] - lamp[2] > 100
    assert (sun >= 250).all()


def test_view_transform_shows_black_as_black() -> None:
    assert (view_transform(torch.zeros(2, 3), 3.0) == 0).all()


@pytest.mark.parametrize(("sx", "sy"), [(2.0, 300.0), (50.0, 50.0), (1e5, 3.0)])
def test_outline_lies_where_the_exponent_is_one_half(sx: float, sy: float) -> None:
    curve = outline(torch.eye(3), torch.tensor([sx, sy]), Form.ASG).double()
    x, y, z = curve.unbind(-1)
    assert (sx * x * x + sy * y * y).numpy() == pytest.approx(0.5, rel=1e-4)  # float32 curve
    assert (z > 0).all()
    torch.testing.assert_close(curve[0], curve[-1], rtol=0, atol=1e-5)


def test_outline_of_an_sg_is_a_circle_at_its_angle() -> None:
    curve = outline(torch.eye(3), torch.tensor([10.0, 10.0]), Form.SG)
    assert curve[:, 2].numpy() == pytest.approx(0.95, abs=1e-6)  # 10 (1 - z) = 1/2


def test_outline_is_left_open_where_a_lobe_has_no_edge() -> None:
    curve = outline(torch.eye(3), torch.tensor([0.1, 50.0]), Form.ASG)
    shown = ~curve[:, 0].isnan()
    assert 0 < int(shown.sum()) < len(curve)
    assert float(curve[shown, 0].abs().max()) == pytest.approx(1.0, abs=0.02)  # to its horizon
    everywhere = outline(torch.eye(3), torch.tensor([0.1, 0.2]), Form.ASG)
    assert everywhere.isnan().all()


def test_outline_across_the_seam_has_no_line_across_the_picture() -> None:
    backwards = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))
    pieces = segments(outline(backwards, torch.tensor([10.0, 10.0]), Form.ASG))
    assert len(pieces) >= 2
    assert max(float(u.diff().abs().max()) for u, _ in pieces) < 0.1
    assert min(float(u.min()) for u, _ in pieces) < 0  # reaches both edges of the picture
    assert max(float(u.max()) for u, _ in pieces) > 1


def test_outline_around_a_pole_goes_once_across_the_picture() -> None:
    up = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.1, -1.0], [0.0, 1.0, 0.1]])  # 6 degrees off +Y
    axes = torch.nn.functional.normalize(up, dim=-1)
    pieces = segments(outline(axes, torch.tensor([1.0, 1.0]), Form.SG))  # 60 degrees around it
    for u, v in pieces:
        assert float(u.diff().abs().max()) < 0.01  # 361 points of a circle
        assert float(v.diff().abs().max()) < 0.01
    ends = torch.cat([u for u, _ in pieces])
    assert -0.02 < float(ends.min()) < 0 < 1 < float(ends.max()) < 1.02
    assert sum(float(u.max() - u.min()) for u, _ in pieces) == pytest.approx(1, abs=0.03)


def test_colour_of_a_lobe_depends_on_its_number_only_and_differs_from_the_next() -> None:
    assert colour(4) == colour(4)
    distances = [math.dist(colour(i), colour(i + 1)) for i in range(20)]
    assert min(distances) > 0.3


def test_contact_sheet_is_a_readable_png_of_at_most_six_rows(tmp_path: Path) -> None:
    path = tmp_path / "sheet.png"
    errors = {"env": [0.1] * len(FRAMES)}
    contact_sheet(path, FRAMES, _maps(), _maps(1.2), _lobes(), "shot", errors=errors)
    height, width = matplotlib.image.imread(path).shape[:2]
    assert width == 1800
    assert 6 * 278 < height < 6 * 360
    assert [p.name for p in tmp_path.iterdir()] == ["sheet.png"]


def test_contact_sheet_shows_the_reference_and_the_sign_of_the_difference(tmp_path: Path) -> None:
    reference, fit = _maps(1.0)[:1], _maps(1.0)[:1]
    fit[:, :8] = 2.0  # too bright above
    fit[:, 8:] = 0.5  # too dark below
    path = tmp_path / "sheet.png"
    dark = replace(_lobes(frames=1), amplitude=torch.zeros(1, 2, 3))
    contact_sheet(path, FRAMES[:1], reference, fit, dark, "shot")
    picture = matplotlib.image.imread(path)[..., :3]
    above, below = picture[116 + 60, 1500], picture[116 + 220, 1500]
    assert above[0] > above[2] + 0.2  # orange
    assert below[2] > below[0] + 0.2  # blue
    # Middle grey of an even map; the lobes are dark and so not drawn.
    assert picture[116 + 60, 300] == pytest.approx([118 / 255] * 3, abs=2 / 255)


def test_contact_sheet_of_a_black_shot_is_drawn(tmp_path: Path) -> None:
    black = _maps(0.0)[:2]
    contact_sheet(tmp_path / "a.png", FRAMES[:2], black, black, _lobes(frames=2), "dark")
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize("form", list(Form))
def test_contact_sheet_of_one_frame_is_drawn(tmp_path: Path, form: Form) -> None:
    lobes = _lobes(form=form, frames=1)
    contact_sheet(tmp_path / "a.png", [1], _maps()[:1], _maps()[:1], lobes, "still")
    assert matplotlib.image.imread(tmp_path / "a.png").shape[0] < 2 * 322 + 200


def test_ball_sheet_shows_four_frames_at_most(tmp_path: Path) -> None:
    balls = torch.full((len(FRAMES), 2, 24, 24, 3), 0.5)
    ball_sheet(tmp_path / "b.png", FRAMES, (0.25, 1.0), balls, 1.1 * balls, "balls")
    height, width = matplotlib.image.imread(tmp_path / "b.png").shape[:2]
    assert 4 * 400 < height < 4 * 520
    assert width >= 500


def test_ball_sheet_of_black_balls_is_drawn(tmp_path: Path) -> None:
    black = torch.zeros(1, 1, 24, 24, 3)
    ball_sheet(tmp_path / "b.png", [7], (0.5,), black, black, "dark")
    assert (tmp_path / "b.png").stat().st_size > 0


def test_maps_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fits: shape .* for 8 frames; expected one of each"):
        contact_sheet(tmp_path / "a.png", FRAMES, _maps(), _maps()[:3], _lobes(), "x")


def test_lobes_of_another_number_of_frames_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"lobes: shape \(3, 2\); expected \[8, N\]"):
        contact_sheet(tmp_path / "a.png", FRAMES, _maps(), _maps(), _lobes(frames=3), "x")


def test_balls_of_another_number_of_roughnesses_are_refused(tmp_path: Path) -> None:
    balls = torch.ones(8, 2, 24, 24, 3)
    with pytest.raises(InputError, match=r"balls: shape .*; expected \[8, 3, S, S, 3\]"):
        ball_sheet(tmp_path / "b.png", FRAMES, (0.1, 0.2, 0.3), balls, balls, "x")


def test_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "none" / "a.png"
    with pytest.raises(
        InputError, match=r"a.png: cannot be written \(no folder .*none\); expected"
    ):
        contact_sheet(path, [1], _maps()[:1], _maps()[:1], _lobes(frames=1), "x")


def test_picture_that_fails_leaves_the_older_one_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"older")

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full_disk)
    with pytest.raises(InputError, match="No space left on device"):
        contact_sheet(path, FRAMES[:1], _maps()[:1], _maps()[:1], _lobes(frames=1), "x")
    assert path.read_bytes() == b"older"
    assert len(list(tmp_path.iterdir())) == 1


def test_lobe_is_drawn_where_it_points(tmp_path: Path) -> None:
    lobes = Lobes(
        axes=torch.eye(3).expand(1, 1, 3, 3),
        sharpness=torch.full((1, 1, 2), 200.0),
        amplitude=torch.ones(1, 1, 3),
    )
    grey = _maps(1.0)[:1]
    path = tmp_path / "a.png"
    contact_sheet(path, [1], grey, grey, lobes, "x")
    picture = matplotlib.image.imread(path)[116 : 116 + 278, 656 : 656 + 556, :3]
    changed = np.abs(picture - 118 / 255).max(-1) > 0.1
    rows, columns = np.nonzero(changed)
    u, v = latlong.uv_from_direction(torch.tensor([0.0, 0.0, 1.0]))
    # The number stands to the upper right of the cross and moves the mean by a few pixels.
    assert rows.mean() / 278 == pytest.approx(float(v), abs=0.04)
    assert columns.mean() / 556 == pytest.approx(float(u), abs=0.04)
