# SPDX-License-Identifier: Apache-2.0
"""A layer of edits shows what writing the edited tracks would, and leaves the stage untouched."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from edited_stages import FRAMES, changed, fit
from pxr import Sdf, Usd, UsdValidation
from usd_tracks import contents, edited, moving, write_every
from written_stages import calm

from asglight.errors import InputError
from asglight.images import read_latlong
from asglight.lobes import Form, LobeTracks
from asglight.usd import Representation, lint_stage, read_usd, write_edit_layer
from asglight.usd.check import trust
from asglight.usd.options import OF_LOBES

ROUNDING = 3e-6
"""Of components: the lobes' 1e-6 of samples left out, twice, and float32 rounding on the way."""
LIGHTS = 4e-4
"""Relative: samples left out of either stage, 1e-4 each, and an override of the difference left
out up to twice that."""


def shown(path: Path, representation: Representation) -> dict[str, tuple]:
    """Return type, defaults and values of every attribute in one representation."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    rig = stage.GetDefaultPrim()
    rig.GetVariantSet("representation").SetVariantSelection(str(representation))
    codes = [Usd.TimeCode.Default(), *map(Usd.TimeCode, FRAMES)]
    found: dict[str, tuple] = {str(p.GetPath()): (p.GetTypeName(),) for p in Usd.PrimRange(rig)}
    for prim in Usd.PrimRange(rig):
        for attribute in prim.GetAuthoredAttributes():
            values = [attribute.Get(code) for code in codes]
            found[str(attribute.GetPath())] = (attribute.GetTypeName(), values)
    return found


def assert_same_value(name: str, value, wanted) -> None:
    if isinstance(wanted, Sdf.AssetPath):
        images = [read_latlong(asset.resolvedPath).radiance for asset in (value, wanted)]
        # half floats: the two dome images come from lobes that differ in float32 rounding
        np.testing.assert_allclose(*images, rtol=2e-3, atol=1e-6 * float(images[1].max()))
    elif hasattr(wanted, "GetImaginary"):
        value, wanted = ([q.GetReal(), *q.GetImaginary()] for q in (value, wanted))
        sign = np.sign(np.dot(value, wanted))  # q and -q are one rotation
        np.testing.assert_allclose(sign * np.array(value), wanted, atol=ROUNDING, err_msg=name)
    elif isinstance(wanted, str | bool | Sdf.ValueTypeName) or name.endswith("xformOpOrder"):
        assert value == wanted, name
    else:
        tolerance = ROUNDING if ".asg:" in name else LIGHTS
        np.testing.assert_allclose(value, wanted, rtol=tolerance, atol=1e-30, err_msg=name)


def assert_shows_what_writing_shows(path: Path, tracks: LobeTracks, height: int = 8) -> None:
    """Compare with a stage that is written from the edited tracks, attribute by attribute."""
    direct = path.parent / "direct.usda"
    write_every(tracks, direct, distance=50.0, meters_per_unit=0.01, dome_height=height)
    for representation in OF_LOBES:
        found, wanted = shown(path, representation), shown(direct, representation)
        assert found.keys() == wanted.keys()
        for name, (kind, *values) in wanted.items():
            assert found[name][0] == kind
            for one, other in zip(found[name][1:], values, strict=True):
                assert len(one) == len(other)
                for value, want in zip(one, other, strict=True):
                    assert_same_value(name, value, want)
    stages = [Usd.Stage.Open(str(file)) for file in (path, direct)]
    metadata = [stage.GetPseudoRoot().GetAllAuthoredMetadata() for stage in stages]
    assert metadata[0] == metadata[1]
    assert "endTimeCode" in metadata[1]


FILL, SOFT, SINGLE = range(3)


@pytest.mark.parametrize(
    ("form", "lobes", "frames", "extension"),
    [(form, (FILL, SOFT, SINGLE), slice(None), "usda") for form in Form]
    + [
        (Form.ASG, (FILL,), slice(None), "usdc"),
        (Form.ASG, (SOFT,), slice(2, 3), "usdc"),
        (Form.BINGHAM, (SINGLE,), slice(2, 3), "usdc"),
    ],
)
def test_the_layer_shows_what_writing_the_edit_shows(form, lobes, frames, extension, tmp_path):
    path, tracks = fit(tmp_path, form)
    before = contents(tmp_path)
    after = tracks
    for lobe in lobes:
        after = changed(after, lobe, frames, "turn", "brighten", "sharpen")
    target = tmp_path / f"edit.{extension}"
    report = write_edit_layer(target, path, after, lobes)
    assert lint_stage(target) == []
    assert {name: contents(tmp_path)[name] for name in before} == before
    assert set(report.files) == {tmp_path / n for n in contents(tmp_path).keys() - before.keys()}
    back = read_usd(target)
    assert (back.frames, back.fps, back.metadata) == (after.frames, after.fps, after.metadata)
    np.testing.assert_allclose(back.lobes.amplitude, after.lobes.amplitude, rtol=ROUNDING)
    assert_shows_what_writing_shows(target, after)


@pytest.mark.parametrize(
    ("kind", "overridden"),
    [
        ("turn", {"xformOp:orient"}),
        ("brighten", {"asg:amplitude", "inputs:intensity", "inputs:color"}),
        (
            "sharpen",
            {"asg:sharpness", "inputs:width", "inputs:height", "inputs:angle", "inputs:intensity"},
        ),
    ],
)
def test_only_what_the_edit_changes_is_overridden(kind, overridden, tmp_path):
    path, tracks = fit(tmp_path, Form.SG)
    after = changed(tracks, 2, slice(None), kind)
    write_edit_layer(tmp_path / "edit.usda", path, after, [2])
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "edit.usda"))
    found: set[str] = set()
    prims: set[str] = set()

    def visit(place: Sdf.Path) -> None:
        if place.IsPropertyPath():
            found.add(place.name)
            prims.add(place.GetPrimPath().name)

    layer.Traverse("/", visit)
    assert found == overridden | {"inputs:texture:file"}
    assert prims == {"lobe_02", "Dome"}
    assert layer.GetPrimAtPath("/AsgRig").specifier == Sdf.SpecifierOver


def test_tracks_that_stand_still_can_be_made_to_move_and_back(tmp_path):
    path = tmp_path / "fit.usda"
    tracks = calm(moving, FRAMES)
    for values in (tracks.lobes.axes, tracks.lobes.sharpness, tracks.lobes.amplitude):
        values[:] = values[:1].clone()
    write_every(tracks, path, distance=50.0, meters_per_unit=0.01, dome_height=8)
    tracks = read_usd(path)
    moved = changed(tracks, 0, slice(2, 3), "turn", "brighten", "sharpen")
    write_edit_layer(tmp_path / "moved.usda", path, moved, [0])
    assert lint_stage(tmp_path / "moved.usda") == []
    assert_shows_what_writing_shows(tmp_path / "moved.usda", moved)
    stilled = LobeTracks(tracks.frames, tracks.fps, tracks.lobes, tracks.metadata)
    rest = read_usd(tmp_path / "moved.usda").lobes
    for name in ("axes", "sharpness", "amplitude"):
        getattr(stilled.lobes, name)[:, 1:] = getattr(rest, name)[:, 1:]
    write_edit_layer(tmp_path / "still.usda", tmp_path / "moved.usda", stilled, [0])
    assert lint_stage(tmp_path / "still.usda") == []
    assert_shows_what_writing_shows(tmp_path / "still.usda", stilled)


def test_a_lobe_keeps_the_kind_of_light_that_it_has_in_the_stage(tmp_path):
    path, tracks = fit(tmp_path)
    tracks.lobes.sharpness[:, 0] = 50.0  # in the fill: written anew, it would be three cards
    tracks.lobes.sharpness[:, 2] = 0.5  # one card: written anew, it would be in the fill
    write_edit_layer(tmp_path / "edit.usda", path, tracks, [0, 2])
    assert lint_stage(tmp_path / "edit.usda") == []
    after = shown(tmp_path / "edit.usda", Representation.CARDS)
    assert after.keys() == shown(path, Representation.CARDS).keys()
    _, fill = after["/AsgRig/Fill.inputs:texture:file"]
    for image, amplitude in zip(fill[1:], tracks.lobes.amplitude[:, 0], strict=True):
        peak = float(read_latlong(image.resolvedPath).radiance.amax())
        # the brightest texel's centre may be half a texel away; texels hold narrower lobes
        assert 0.7 * float(amplitude.amax()) < peak < 1.1 * float(amplitude.amax())


def test_the_fill_is_written_anew_only_for_a_lobe_in_it(tmp_path):
    path, tracks = fit(tmp_path)
    for lobe, images in ((0, 2 * len(FRAMES)), (1, len(FRAMES))):
        after = changed(tracks, lobe, slice(1), "turn")
        report = write_edit_layer(tmp_path / f"edit{lobe}.usda", path, after, [lobe])
        assert len(report.files) == 1 + images
        assert sum(".fill." in file.name for file in report.files) == images - len(FRAMES)


def test_a_layer_of_edits_can_be_edited(tmp_path):
    path, tracks = fit(tmp_path)
    first = changed(tracks, 1, slice(None), "turn", "sharpen")
    write_edit_layer(tmp_path / "one.usda", path, first, [1])
    before = contents(tmp_path)
    second = changed(read_usd(tmp_path / "one.usda"), 1, slice(0, 1), "brighten", "turn")
    second = changed(second, 2, slice(3, 4), "sharpen")
    write_edit_layer(tmp_path / "two.usdc", tmp_path / "one.usda", second, [1, 2])
    assert {name: contents(tmp_path)[name] for name in before} == before
    assert lint_stage(tmp_path / "two.usdc") == []
    assert_shows_what_writing_shows(tmp_path / "two.usdc", second)


def test_the_validators_of_usd_are_content(tmp_path):
    path, tracks = fit(tmp_path, Form.BINGHAM)
    write_edit_layer(tmp_path / "edit.usda", path, changed(tracks, 0, slice(1, 2), "turn"), [0])
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stage = Usd.Stage.Open(str(tmp_path / "edit.usda"))
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in errors] == []


def test_the_stage_is_named_relatively_so_both_can_move_together(tmp_path, monkeypatch):
    (tmp_path / "a" / "shots").mkdir(parents=True)
    (tmp_path / "a" / "edits").mkdir()
    path, tracks = fit(tmp_path / "a" / "shots")
    after = changed(tracks, 1, slice(None), "brighten")
    write_edit_layer(tmp_path / "a" / "edits" / "edit.usda", path, after, [1])
    (tmp_path / "a").rename(tmp_path / "b")
    moved = tmp_path / "b" / "edits" / "edit.usda"
    layer = Sdf.Layer.FindOrOpen(str(moved))
    assert list(layer.subLayerPaths) == ["../shots/fit.usda"]
    with pytest.raises(InputError, match=r"refers to \.\./shots/fit\.usda, outside its folder"):
        read_usd(moved)
    monkeypatch.setattr(trust, "_ASKED", trust._Asked())
    trust.follow_references()
    assert lint_stage(moved) == []
    np.testing.assert_allclose(
        read_usd(moved).lobes.amplitude, after.lobes.amplitude, rtol=ROUNDING
    )


def test_no_edit_gives_a_layer_that_adds_nothing(tmp_path):
    path, tracks = fit(tmp_path)
    report = write_edit_layer(tmp_path / "edit.usda", path, tracks, [0, 1, 2])
    assert report.files == (tmp_path / "edit.usda",)
    assert report.samples_written == 0
    assert_shows_what_writing_shows(tmp_path / "edit.usda", tracks)


def test_a_light_that_was_changed_by_hand_stays_on_the_lobes_that_were_not_edited(tmp_path):
    path, _ = fit(tmp_path)
    place = "/AsgRig{representation=cards}Lobes/lobe_02.inputs:intensity"

    def dim(layer: Sdf.Layer) -> None:
        for time in layer.ListTimeSamplesForPath(place):
            layer.EraseTimeSample(place, time)
        layer.GetAttributeAtPath(place).default = 0.25

    edited(path, dim)
    after = changed(read_usd(path), 1, slice(None), "turn")
    write_edit_layer(tmp_path / "edit.usda", path, after, [1])
    _, values = shown(tmp_path / "edit.usda", Representation.CARDS)[
        "/AsgRig/Lobes/lobe_02.inputs:intensity"
    ]
    assert set(values) == {0.25}


def test_a_lobe_that_was_switched_off_keeps_the_names_of_the_others(tmp_path):
    path, _ = fit(tmp_path)
    edited(path, lambda layer: setattr(layer.GetPrimAtPath("/AsgRig/Lobes/lobe_00"), "active", 0))
    after = changed(read_usd(path), 0, slice(None), "brighten")
    write_edit_layer(tmp_path / "edit.usda", path, after, [0])
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "edit.usda"))
    assert layer.GetAttributeAtPath("/AsgRig/Lobes/lobe_01.asg:amplitude")
    np.testing.assert_allclose(
        read_usd(tmp_path / "edit.usda").lobes.amplitude, after.lobes.amplitude, rtol=ROUNDING
    )


def test_metadata_that_changed_comes_back(tmp_path):
    path, tracks = fit(tmp_path)
    after = replace(tracks, metadata={"note": "größer", "none": None})
    write_edit_layer(tmp_path / "edit.usda", path, after, [])
    assert read_usd(tmp_path / "edit.usda").metadata == after.metadata
    assert read_usd(tmp_path / "edit.usda").frames == FRAMES


def test_a_stage_whose_images_are_gone_gets_new_ones(tmp_path):
    path, tracks = fit(tmp_path)
    for image in (tmp_path / "fit_dome").iterdir():
        image.unlink()
    write_edit_layer(tmp_path / "edit.usda", path, changed(tracks, 0, slice(1), "turn"), [0])
    assert lint_stage(tmp_path / "edit.usda") == []


def test_a_fault_of_the_stage_below_is_not_a_fault_of_the_edit(tmp_path):
    path, tracks = fit(tmp_path)
    edited(path, lambda layer: layer.pseudoRoot.ClearInfo("upAxis"))
    write_edit_layer(tmp_path / "edit.usda", path, changed(tracks, 0, slice(1), "turn"), [0])
    assert lint_stage(tmp_path / "edit.usda") == lint_stage(path) != []
