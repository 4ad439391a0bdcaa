# SPDX-License-Identifier: Apache-2.0
"""Lobes of several lights, or of a share of the fill: edited lights come back as one lobe."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_tracks import assert_same, of_every_kind, write_every
from written_stages import calm, put_every, selected

from asglight.lobes import Form
from asglight.usd import lint_stage, read_stage, read_usd, write_edit_layer, write_usd
from asglight.usd.options import OF_LOBES
from asglight.usd.read.read_options import read_options

FRAMES = (1001, 1002, 1005)
SOFT = "/AsgRig/Lobes/lobe_01"
Z_UP = {"up_axis": "Z", "colorspace": "ACEScg"}
PIECES = ("tall", "wide", "outer")


def written(folder: Path, form: Form = Form.ASG, **options) -> Path:
    path = folder / "shot.usda"
    put_every(calm(of_every_kind, FRAMES, form), path, **{"dome_height": 8, **options})
    return path


def edited(path: Path, change) -> Path:
    """Edit a copy of the stage."""
    stage = Usd.Stage.Open(str(path))
    copy = path.with_name("edited.usda")
    stage.GetRootLayer().Export(str(copy))
    stage = Usd.Stage.Open(str(copy))
    change(stage)
    stage.GetRootLayer().Save()
    return copy


def brighten(stage: Usd.Stage, prim: str, factor: float) -> None:
    UsdLux.LightAPI(stage.GetPrimAtPath(prim)).CreateExposureAttr(math.log2(factor))


def card_flux(prim: Usd.Prim, time: int) -> float:
    """Return radiance times solid angle of a card seen from the origin, green."""
    card = UsdLux.RectLight(prim)
    far = prim.GetAttribute("xformOp:translate:dist").Get()[2]
    a, b = (s.Get(time) / (2 * far) for s in (card.GetWidthAttr(), card.GetHeightAttr()))
    # of a rectangle seen from a point over its centre, by the spherical excess
    angle = 4 * math.asin(a * b / math.sqrt((1 + a * a) * (1 + b * b)))
    return angle * card.GetIntensityAttr().Get(time) * card.GetColorAttr().Get(time)[1]


@pytest.mark.parametrize(
    ("form", "distant_lights", "space"),
    [
        (Form.ASG, 1, {}),
        (Form.ASG, 3, Z_UP),
        (Form.BINGHAM, 3, {}),
        (Form.SG, 3, Z_UP),
        (Form.FLAT, 1, Z_UP),
    ],
)
def test_a_stage_that_nobody_edited_has_no_changes(form, distant_lights, space, tmp_path):
    path = tmp_path / "shot.usdc"
    tracks = calm(of_every_kind, range(1001, 1004), form)
    write_every(tracks, path, dome_height=2, distant_lights=distant_lights, **space)
    for representation in OF_LOBES:
        reading = read_stage(selected(path, representation))
        assert reading.changes == ()
        assert_same(reading.tracks, tracks)
    # also of the form sg, whose lobes are round and have one light in any case
    assert read_options(path).distant_lights == distant_lights


def test_a_nearly_round_lobe_of_three_distant_lights_has_no_changes(tmp_path):
    tracks = of_every_kind(range(1001, 1009))
    # in the first half as round as float32 tells, then long: the tilt is a root of almost nothing
    tracks.lobes.sharpness[:4, :, 1] = tracks.lobes.sharpness[:4, :, 0] * (1 - 1e-6)
    path = tmp_path / "shot.usdc"
    write_usd(tracks, path, representations=("distant",), distant_lights=3)
    assert read_stage(path).changes == ()


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_lights_brightened_alike_are_a_brighter_lobe(form, representation, tmp_path):
    path = written(tmp_path, form, representation=representation, distant_lights=3)

    def change(stage: Usd.Stage) -> None:
        children = stage.GetPrimAtPath(SOFT).GetChildren()
        assert len(children) == (6 if form is Form.BINGHAM else 3)
        for child in children:
            brighten(stage, str(child.GetPath()), 3.0)

    reading = read_stage(edited(path, change))
    assert reading.changes == (f"{SOFT}: light x 3",)
    factor = torch.tensor([1.0, 3.0, 1.0])[:, None]
    before = read_usd(path).lobes
    # the samples left out of lights, and float32
    np.testing.assert_allclose(reading.tracks.lobes.amplitude, before.amplitude * factor, rtol=1e-4)
    assert torch.equal(reading.tracks.lobes.sharpness, before.sharpness)


@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_a_turned_lobe_turns_with_its_lights(representation, tmp_path):
    path = written(tmp_path, representation=representation, distant_lights=3)
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 40.0))

    def change(stage: Usd.Stage) -> None:
        xform = UsdGeom.Xformable(stage.GetPrimAtPath(SOFT))
        ops = xform.GetOrderedXformOps()
        first = xform.AddTransformOp(opSuffix="edit")
        first.Set(turn)
        xform.SetXformOpOrder([first, *ops])

    reading = read_stage(edited(path, change))
    assert reading.changes == (f"{SOFT}: turned by 40 degrees",)
    before, after = read_usd(path).lobes, reading.tracks.lobes
    # float32 frames; in distant the outer lights' tilts, to float32 roots
    wanted = before.axes[:, 1].numpy() @ np.array(turn)[:3, :3]
    np.testing.assert_allclose(after.axes[:, 1], wanted, atol=2e-6)
    assert torch.equal(after.axes[:, [0, 2]], before.axes[:, [0, 2]])


def test_the_cards_of_another_lobe_are_that_lobe(tmp_path):
    path = written(tmp_path)
    tracks = calm(of_every_kind, FRAMES)
    tracks.lobes.sharpness[:, 1] *= torch.tensor([1.5, 1.2])
    tracks.lobes.amplitude[:, 1] *= torch.tensor([2.0, 0.5, 1.0])
    write_usd(tracks, tmp_path / "other.usda", representations=("cards",))
    other = Usd.Stage.Open(str(tmp_path / "other.usda"))

    def change(stage: Usd.Stage) -> None:
        for child in stage.GetPrimAtPath(SOFT).GetChildren():
            for attribute in child.GetAuthoredAttributes():
                if attribute.GetName() in ("xformOpOrder", "inputs:normalize"):
                    continue
                source = other.GetAttributeAtPath(attribute.GetPath())
                for time in source.GetTimeSamples() or [Usd.TimeCode.Default()]:
                    attribute.Set(source.Get(time), time)

    after = read_usd(edited(path, change)).lobes
    # which axis comes first is a convention; EDITED, below which a size is as it was, changes a
    # sharpness by twice as much
    found, wanted = (one.sort(-1).values for one in (after.sharpness, tracks.lobes.sharpness))
    np.testing.assert_allclose(found, wanted, rtol=2e-3)
    np.testing.assert_allclose(after.amplitude, tracks.lobes.amplitude, rtol=5e-3)


def test_one_card_of_three_counts_by_its_flux(tmp_path):
    path = written(tmp_path)
    reading = read_stage(edited(path, lambda stage: brighten(stage, f"{SOFT}/outer", 4.0)))
    (line,) = reading.changes
    assert line.startswith(f"{SOFT}: light x ")
    assert line.endswith("its 3 lights differ, their mean counts")
    stage = Usd.Stage.Open(str(path))
    ratio = reading.tracks.lobes.amplitude[:, 1] / read_usd(path).lobes.amplitude[:, 1]
    for index, time in enumerate(FRAMES):
        flux = {name: card_flux(stage.GetPrimAtPath(f"{SOFT}/{name}"), time) for name in PIECES}
        wanted = (sum(flux.values()) + 3 * flux["outer"]) / sum(flux.values())
        # the samples left out of lights
        np.testing.assert_allclose(ratio[index], [wanted] * 3, rtol=2e-4)


@pytest.mark.parametrize("how", ["deactivated", "hidden"])
def test_a_card_that_is_gone_takes_its_flux_with_it(how, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        for name in ("tall", "wide"):
            prim = stage.GetPrimAtPath(f"{SOFT}/{name}")
            if how == "hidden":
                UsdGeom.Imageable(prim).MakeInvisible()
            else:
                prim.SetActive(False)

    reading = read_stage(edited(path, change))
    (line,) = reading.changes
    said = "without tall, without wide" if how == "deactivated" else "its 3 lights differ"
    assert said in line
    ratio = reading.tracks.lobes.amplitude[:, 1] / read_usd(path).lobes.amplitude[:, 1]
    # _OUTER_SHARE of cards.py, fitted to a Gaussian: 0.2949 of the flux
    np.testing.assert_allclose(ratio, 0.2949, rtol=2e-4)


def test_an_edited_fill_changes_the_broad_lobes_only(tmp_path):
    path = written(tmp_path, up_axis="Z")

    def change(stage: Usd.Stage) -> None:
        fill = stage.GetPrimAtPath("/AsgRig/Fill")
        UsdLux.LightAPI(fill).GetIntensityAttr().Set(2.0)
        xform = UsdGeom.Xformable(fill)
        ops = xform.GetOrderedXformOps()
        up = xform.AddRotateZOp()
        up.Set(90.0)
        xform.SetXformOpOrder([up, *ops])

    reading = read_stage(edited(path, change))
    assert reading.changes == ("/AsgRig/Fill: light x 2, turned by 90 degrees",)
    before, after = read_usd(path).lobes, reading.tracks.lobes
    factor = torch.tensor([2.0, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(after.amplitude, before.amplitude * factor, rtol=1e-6)
    x, y, z = before.axis_z[:, 0].unbind(-1)  # asglight's: +Y up, so +Z goes to +X
    np.testing.assert_allclose(after.axis_z[:, 0], torch.stack([z, y, -x], -1), atol=1e-6)
    assert torch.equal(after.axes[:, 1:], before.axes[:, 1:])


def test_the_fill_is_turned_and_coloured_as_the_dome_is(tmp_path):
    tracks = calm(of_every_kind, FRAMES)
    only = replace(tracks, lobes=tracks.lobes.select(torch.tensor([0])), names=("lobe_00",))
    options = {"up_axis": "Z", "colorspace": "ACEScg", "dome_height": 64}
    write_every(only, tmp_path / "one.usda", **options)
    stage = Usd.Stage.Open(str(tmp_path / "one.usda"))
    fill = stage.GetPrimAtPath("/AsgRig/Fill")
    turned = UsdGeom.Xformable(fill).GetLocalTransformation()
    stage.GetPrimAtPath("/AsgRig").GetVariantSet("representation").SetVariantSelection("dome")
    dome = UsdGeom.Xformable(stage.GetPrimAtPath("/AsgRig/Dome"))
    assert turned == dome.GetLocalTransformation() != Gf.Matrix4d(1)
    for frame in FRAMES:  # all of the light is fill: the images are the dome's, headers included
        names = [f"one.{frame}.exr", f"one.fill.{frame}.exr"]
        first, second = ((tmp_path / "one_dome" / name).read_bytes() for name in names)
        assert first == second


def test_a_package_and_a_layer_of_edits_keep_the_kinds(tmp_path):
    tracks = calm(of_every_kind, FRAMES)
    path = tmp_path / "shot.usdz"
    write_every(tracks, path, dome_height=2, distant_lights=3, up_axis="Z", colorspace="ACEScg")
    assert [file.name for file in tmp_path.iterdir()] == ["shot.usdz"]
    assert lint_stage(path) == []
    assert read_options(path).distant_lights == 3
    before = read_usd(path)
    lobes = before.lobes.clone()
    lobes.sharpness[:, 0] *= 1000  # a lobe in the fill stays there
    lobes.amplitude[:, 1] *= 3
    after = replace(before, lobes=lobes)
    layer = tmp_path / "edit.usda"
    write_edit_layer(layer, path, after, [0, 1])
    assert_same(read_usd(layer), after)
    assert read_stage(layer).changes == ()
    assert read_options(layer).distant_lights == 3
    assert (tmp_path / "edit_dome" / "edit.fill.1001.exr").is_file()
