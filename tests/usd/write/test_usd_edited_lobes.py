# SPDX-License-Identifier: Apache-2.0
"""A layer that mutes, deletes, adds and renames lobes, over a stage that stays as it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom
from usd_tracks import contents, moving, still
from written_stages import calm, put_every, selected

from asglight.images import read_latlong
from asglight.lobes import Form, Lobes, LobeTracks, asg, frames
from asglight.usd import lint_stage, read_usd, write_edit_layer, write_usd
from asglight.usd.read.tracks import read_stage

EVERY = ("cards", "distant", "dome")
ROUNDING = 3e-6
"""Of components: samples left out, and float32 on the way."""


def stage_of(folder: Path, representations: tuple[str, ...] = EVERY) -> Path:
    path = folder / "shot.usda"
    put_every(calm(moving, (1, 2, 4)), path, representations=representations, dome_height=16)
    return path


def with_one_more(tracks: LobeTracks, sharpness: float = 60.0) -> LobeTracks:
    """Return tracks with a round red lobe at +X in every frame."""
    count = len(tracks.frames)
    more = Lobes(
        frames.axes_around(torch.tensor([[[1.0, 0.0, 0.0]]])).expand(count, 1, 3, 3),
        torch.full((count, 1, 2), sharpness),
        torch.tensor([3.0, 0.5, 0.25]).expand(count, 1, 3),
        tracks.lobes.form,
    )
    old = tracks.lobes
    lobes = Lobes(
        torch.cat([old.axes, more.axes], dim=1),
        torch.cat([old.sharpness, more.sharpness], dim=1),
        torch.cat([old.amplitude, more.amplitude], dim=1),
        old.form,
    )
    return replace(tracks, lobes=lobes, names=(*tracks.names, "lobe_03"))


def assert_same_light(one: LobeTracks, other: LobeTracks) -> None:
    """Check that the lobes of two tracks are the same function of direction."""
    directions = torch.nn.functional.normalize(
        torch.from_numpy(np.random.default_rng(1).normal(size=(200, 3))), dim=-1
    )
    for frame in range(len(one.frames)):
        first, second = (
            asg.evaluate(tracks.lobes[frame].to(torch.float64), directions)
            for tracks in (one, other)
        )
        torch.testing.assert_close(first, second, rtol=3e-4, atol=1e-6 * float(first.max()))


@pytest.mark.parametrize("representations", [EVERY, ("cards",), ("distant",), ("dome",)])
def test_a_muted_lobe_is_dark_everywhere_and_lights_again_as_it_was(
    tmp_path: Path, representations: tuple[str, ...]
) -> None:
    stage = stage_of(tmp_path, representations)
    before = contents(stage.parent)
    reading = read_stage(stage)
    muted, again = tmp_path / "muted.usda", tmp_path / "again.usda"
    write_edit_layer(muted, stage, reading.unmuted, (1,), muted={1})
    assert {name: contents(stage.parent)[name] for name in before} == before
    found = read_stage(muted)
    assert found.muted == {1}
    assert not found.tracks.lobes.amplitude[:, 1].any()
    for name in ("axes", "sharpness", "amplitude"):
        held = getattr(found.unmuted.lobes, name)
        torch.testing.assert_close(held, getattr(reading.tracks.lobes, name), rtol=0, atol=0)
    opened = Usd.Stage.Open(str(muted))
    prim = UsdGeom.Imageable(opened.GetPrimAtPath("/AsgRig/Lobes/lobe_01"))
    assert prim.ComputeVisibility() == UsdGeom.Tokens.invisible

    write_edit_layer(again, muted, found.unmuted, (1,), muted=())
    assert_same_light(read_usd(again), reading.tracks)
    assert read_stage(again).muted == set()


def test_the_dome_of_a_layer_shows_no_lobe_that_is_muted_or_deleted(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, ("dome",))
    tracks = read_usd(stage)
    layer = tmp_path / "edit.usda"
    write_edit_layer(layer, stage, tracks, (0, 1), muted={0}, deleted={1})
    image = read_latlong(sorted((tmp_path / "edit_dome").glob("*.exr"))[0]).radiance
    alone = replace(tracks, lobes=tracks.lobes.select(torch.tensor([2])), names=("lobe_02",))
    write_usd(alone, tmp_path / "alone.usda", representations=("dome",), dome_height=16)
    wanted = read_latlong(sorted((tmp_path / "alone_dome").glob("*.exr"))[0]).radiance
    # half floats
    np.testing.assert_allclose(image, wanted, rtol=2e-3, atol=1e-6 * float(wanted.max()))


def test_a_deleted_lobe_is_gone_and_the_others_keep_their_names(tmp_path: Path) -> None:
    stage = stage_of(tmp_path)
    tracks = read_usd(stage)
    write_edit_layer(tmp_path / "edit.usda", stage, tracks, (1,), (), {1})
    found = read_usd(tmp_path / "edit.usda")
    assert found.names == ("lobe_00", "lobe_02")
    kept = tracks.lobes.select(torch.tensor([0, 2]))
    torch.testing.assert_close(found.lobes.amplitude, kept.amplitude, rtol=0, atol=0)
    opened = Usd.Stage.Open(str(tmp_path / "edit.usda"))
    assert not opened.GetPrimAtPath("/AsgRig/Lobes/lobe_01").IsActive()


@pytest.mark.parametrize(
    ("representations", "form"),
    [
        *((EVERY, form) for form in Form),
        (("cards",), Form.BINGHAM),
        (("distant",), Form.FLAT),
        (("dome",), Form.SG),
    ],
)
def test_an_added_lobe_has_its_lights_in_every_representation(
    tmp_path: Path, representations: tuple[str, ...], form: Form
) -> None:
    stage = tmp_path / "shot.usda"
    write_usd(
        calm(moving, (1, 2, 4), form=form), stage, representations=representations, dome_height=16
    )
    wanted = with_one_more(read_usd(stage))
    layer = tmp_path / "edit.usda"
    write_edit_layer(layer, stage, wanted, (3,))
    assert lint_stage(layer) == []
    opened = [layer]
    if representations == EVERY:
        opened = [selected(layer, representation) for representation in EVERY]
    for one in opened:
        reading = read_stage(one)
        assert reading.changes == ()  # its lights are those that asglight would author
        assert reading.tracks.names == wanted.names
        assert_same_light(reading.tracks, wanted)


@pytest.mark.parametrize("has_fill", [True, False])
def test_a_broad_lobe_that_is_added_joins_the_fill_where_there_is_one(
    tmp_path: Path, has_fill: bool
) -> None:
    stage = tmp_path / "shot.usda"
    tracks = calm(moving, (1, 2))
    tracks.lobes.sharpness[:] = 80.0
    if has_fill:
        tracks.lobes.sharpness[:, 0] = 0.5
    write_usd(tracks, stage, representations=("cards",))
    assert bool(list(tmp_path.glob("shot_dome/*"))) is has_fill
    wanted = with_one_more(read_usd(stage), sharpness=0.5)
    write_edit_layer(tmp_path / "edit.usda", stage, wanted, (3,))
    reading = read_stage(tmp_path / "edit.usda")
    assert reading.changes == ()
    assert_same_light(reading.tracks, wanted)
    assert bool(list(tmp_path.glob("edit_dome/*"))) is has_fill


def test_what_a_lobe_is_called_is_its_display_name_and_survives_a_new_stage(
    tmp_path: Path,
) -> None:
    stage = stage_of(tmp_path, ("cards",))
    tracks = read_usd(stage)
    called = replace(tracks, display_names={"lobe_01": "Fenster, links ## 2"})
    write_edit_layer(tmp_path / "edit.usda", stage, called, ())
    opened = Usd.Stage.Open(str(tmp_path / "edit.usda"))
    prim = opened.GetPrimAtPath("/AsgRig/Lobes/lobe_01")
    assert prim.GetDisplayName() == "Fenster, links ## 2"
    found = read_usd(tmp_path / "edit.usda")
    assert found.names == tracks.names  # lights are linked by path: that stays
    assert found.display_names == called.display_names
    write_usd(found, tmp_path / "new.usda", representations=("cards",))
    assert read_usd(tmp_path / "new.usda").display_names == called.display_names
    write_edit_layer(tmp_path / "back.usda", tmp_path / "edit.usda", tracks, ())
    assert read_usd(tmp_path / "back.usda").display_names == {}


def test_an_added_lobe_takes_no_name_of_a_deleted_one(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, ("cards",))
    tracks = with_one_more(read_usd(stage))
    first, second = tmp_path / "first.usda", tmp_path / "second.usda"
    write_edit_layer(first, stage, read_usd(stage), (2,), (), {2})
    left = read_usd(first)
    lobes = tracks.lobes.select(torch.tensor([0, 1, 3]))
    again = replace(left, lobes=lobes, names=("lobe_00", "lobe_01", "lobe_02"))
    write_edit_layer(second, first, again, (2,))
    found = read_usd(second)
    assert found.names == ("lobe_00", "lobe_01", "lobe_03")
    assert found.display_names == {"lobe_03": "lobe_02"}
    assert_same_light(found, again)


def test_a_lobe_that_was_added_and_deleted_again_leaves_nothing(tmp_path: Path) -> None:
    stage = stage_of(tmp_path)
    tracks = with_one_more(read_usd(stage))
    write_edit_layer(tmp_path / "edit.usda", stage, tracks, (3,), (), {3})
    found = read_usd(tmp_path / "edit.usda")
    assert found.names == ("lobe_00", "lobe_01", "lobe_02")
    assert "lobe_03" not in (tmp_path / "edit.usda").read_text()


def test_lobes_muted_elsewhere_stay_muted_when_another_is_edited(tmp_path: Path) -> None:
    stage = stage_of(tmp_path, ("cards",))
    muted = tmp_path / "muted.usda"
    write_edit_layer(muted, stage, read_usd(stage), (1,), muted={1})
    seen = read_usd(muted)  # the lobe is black in these
    lobes = seen.lobes.clone()
    lobes.amplitude[:, 0] *= 2
    write_edit_layer(tmp_path / "more.usda", muted, replace(seen, lobes=lobes), (0,))
    found = read_stage(tmp_path / "more.usda")
    assert found.muted == {1}
    before = read_usd(stage).lobes.amplitude
    torch.testing.assert_close(found.unmuted.lobes.amplitude[:, 1], before[:, 1])
    torch.testing.assert_close(
        found.tracks.lobes.amplitude[:, 0], 2 * before[:, 0], rtol=ROUNDING, atol=0
    )


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_what_was_the_width_remains_the_width_however_wide_it_becomes(
    tmp_path: Path, up_axis: str
) -> None:
    write_usd(still(), tmp_path / "shot.usda", up_axis=up_axis, representations=("cards",))
    tracks = read_usd(tmp_path / "shot.usda")
    lobes = tracks.lobes.clone()
    lobes.sharpness[:, 1] *= torch.tensor([0.1, 10.0])
    assert bool((lobes.sharpness[:, 1, 0] < lobes.sharpness[:, 1, 1]).all())
    tracks = replace(tracks, lobes=lobes)
    write_edit_layer(tmp_path / "edits.usda", tmp_path / "shot.usda", tracks, [1])
    found = read_usd(tmp_path / "edits.usda").lobes
    torch.testing.assert_close(found.axes, lobes.axes, rtol=0, atol=ROUNDING)
    torch.testing.assert_close(found.sharpness, lobes.sharpness, rtol=1e-6, atol=0)
