# SPDX-License-Identifier: Apache-2.0
"""Lights that another program edited come back as the lobes that would shine so."""

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from usd_tracks import assert_same, moving, still, write_every
from written_stages import calm, selected

from asglight.errors import InputError
from asglight.lobes import Form, LobeTracks
from asglight.usd import lint_stage, read_stage, read_usd, write_usd
from asglight.usd.options import OF_LOBES
from asglight.usd.write.edits.edit_layer import write_edit_layer

FRAMES = (1001, 1002, 1005)
LOBE = "/AsgRig/Lobes/lobe_01"


def edit(path: Path, change) -> Path:
    """Edit the stage in a layer over it, through pxr's own classes, as a program would."""
    stage = Usd.Stage.Open(str(path))
    over = path.with_name("over.usda")
    layer = Sdf.Layer.CreateNew(str(over))
    layer.TransferContent(stage.GetRootLayer().CreateAnonymous(".usda"))
    layer.subLayerPaths = [f"./{path.name}"]
    for key in ("defaultPrim", "upAxis", "metersPerUnit", "timeCodesPerSecond"):
        layer.pseudoRoot.SetInfo(key, stage.GetRootLayer().pseudoRoot.GetInfo(key))
    layer.startTimeCode, layer.endTimeCode = FRAMES[0], FRAMES[-1]
    edited = Usd.Stage.Open(layer)
    change(edited)
    layer.Save()
    return over


Write = Callable[..., Path]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Write:
    """Return what gives a folder a copy of a stage made once, which opens as asked for."""
    made: dict[tuple[Form, str], Path] = {}

    def write(
        folder: Path, form: Form = Form.ASG, representation: str = "cards", up_axis: str = "Y"
    ) -> Path:
        key = form, up_axis
        if key not in made:
            made[key] = tmp_path_factory.mktemp("written")
            write_every(tracks_of(form), made[key] / "shot.usda", dome_height=8, up_axis=up_axis)
        path = shutil.copytree(made[key], folder, dirs_exist_ok=True) / "shot.usda"
        text = path.read_text()
        first, chosen = (f'string representation = "{one}"' for one in ("cards", representation))
        assert text.count(first) == 1
        path.write_text(text.replace(first, chosen))
        return path

    return write


def tracks_of(form: Form = Form.ASG) -> LobeTracks:
    """Return three lobes; the second is so sharp that it is one card."""
    tracks = calm(moving, FRAMES, form=form)
    tracks.lobes.sharpness[:, 1] *= 500
    return tracks


def light(stage: Usd.Stage, name: str = "") -> UsdLux.LightAPI:
    prim = stage.GetPrimAtPath(LOBE)
    return UsdLux.LightAPI(prim.GetChild(name) if name else prim)


def scale_samples(attribute: Usd.Attribute, factor: float | Gf.Vec3f) -> None:
    """Multiply all samples; all are read before the first is set, which hides those below."""
    times = attribute.GetTimeSamples() or [Usd.TimeCode.Default()]
    values = [(time, attribute.Get(time)) for time in times]
    for time, value in values:
        is_color = isinstance(value, Gf.Vec3f)
        attribute.Set(Gf.CompMult(value, factor) if is_color else value * factor, time)


@pytest.mark.parametrize(("form", "up_axis"), [*zip(Form, "ZYZY", strict=True)])
def test_a_stage_that_nobody_edited_has_no_changes(form, up_axis, tmp_path):
    path = tmp_path / "shot.usda"
    tracks = moving(range(1001, 1021), form=form, jitter=0.02)
    write_every(tracks, path, up_axis=up_axis, dome_height=2)
    for representation in OF_LOBES:
        reading = read_stage(selected(path, representation))
        assert reading.changes == ()
        assert_same(reading.tracks, tracks)


@pytest.mark.parametrize("representation", ["cards", "distant"])
@pytest.mark.parametrize("how", ["intensity", "exposure", "color"])
def test_a_brighter_light_is_a_brighter_lobe(how, representation, written, tmp_path):
    path = written(tmp_path, representation=representation)
    factor = np.array([1.0, 0.5, 0.25]) if how == "color" else np.array([2.0, 2.0, 2.0])

    def change(stage: Usd.Stage) -> None:
        if how == "intensity":
            scale_samples(light(stage).GetIntensityAttr(), 2.0)
        elif how == "exposure":
            light(stage).CreateExposureAttr(1.0)
        else:
            scale_samples(light(stage).GetColorAttr(), Gf.Vec3f(1.0, 0.5, 0.25))

    reading = read_stage(edit(path, change))
    before, after = read_usd(path).lobes, reading.tracks.lobes
    # the samples left out of lights, and float32
    np.testing.assert_allclose(
        after.amplitude[:, 1], before.amplitude[:, 1].numpy() * factor, rtol=1e-4
    )
    assert torch.equal(after.amplitude[:, [0, 2]], before.amplitude[:, [0, 2]])
    assert torch.equal(after.sharpness, before.sharpness)
    (line,) = reading.changes
    assert line.startswith(f"{LOBE}: ")
    assert ("another colour" if how == "color" else "light x 2") in line


def test_an_edit_of_one_frame_is_one_of_that_frame(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        intensity = light(stage).GetIntensityAttr()
        values = {time: intensity.Get(time) for time in FRAMES}
        for time, value in values.items():
            intensity.Set(value * (3.0 if time == 1002 else 1.0), time)

    reading = read_stage(edit(path, change))
    ratio = reading.tracks.lobes.amplitude[:, 1] / read_usd(path).lobes.amplitude[:, 1]
    np.testing.assert_allclose(ratio, [[1] * 3, [3] * 3, [1] * 3], rtol=1e-4)
    assert reading.changes == (f"{LOBE}: light x 1 to 3",)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize(
    ("representation", "factors"), [("cards", (1.5, 0.7)), ("distant", (0.8,))]
)
def test_a_resized_light_is_the_lobe_that_writes_that_size(
    form, representation, factors, written, tmp_path
):
    """Writing the lobe anew gives the edited light: width, height or angle, and intensity."""
    path = written(tmp_path, form, representation=representation)
    names = ["inputs:width", "inputs:height"] if len(factors) == 2 else ["inputs:angle"]
    if form is Form.SG:
        factors = factors[:1] * len(factors)  # it has one sharpness for both

    def lights(stage: Usd.Stage) -> list[Usd.Prim]:
        return [p for p in Usd.PrimRange(stage.GetPrimAtPath(LOBE)) if p.HasAPI(UsdLux.LightAPI)]

    def change(stage: Usd.Stage) -> None:
        for prim in lights(stage):
            for name, factor in zip(names, factors, strict=True):
                scale_samples(prim.GetAttribute(name), factor)

    over = edit(path, change)
    reading = read_stage(over)
    (line,) = reading.changes
    assert all(f"{name[7:]} x {by:g}" in line for name, by in zip(names, factors, strict=True))
    write_usd(reading.tracks, tmp_path / "anew.usda", representations=(representation,))
    stages = [Usd.Stage.Open(str(file)) for file in (over, tmp_path / "anew.usda")]
    for pair in zip(*map(lights, stages), strict=True):
        for time in FRAMES:
            # the lobe's axes may have changed places, and with them width and height
            found, wanted = (sorted(p.GetAttribute(n).Get(time) for n in names) for p in pair)
            np.testing.assert_allclose(found, wanted, rtol=1e-3)  # what counts as edited
            found, wanted = (p.GetAttribute("inputs:intensity").Get(time) for p in pair)
            assert found == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("representation", ["cards", "distant"])
@pytest.mark.parametrize("how", ["matrix", "op"])
def test_a_moved_light_is_a_lobe_in_the_direction_it_was_moved_to(
    how, representation, up_axis, written, tmp_path
):
    path = written(tmp_path, representation=representation, up_axis=up_axis)
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 40.0))

    def change(stage: Usd.Stage) -> None:
        xform = UsdGeom.Xformable(stage.GetPrimAtPath(LOBE))
        if how == "op":  # an op before the others, as Solaris edits
            ops = xform.GetOrderedXformOps()
            first = xform.AddTransformOp(opSuffix="edit")
            first.Set(turn)
            xform.SetXformOpOrder([first, *ops])
            return
        matrices = {time: xform.GetLocalTransformation(time) for time in FRAMES}
        op = xform.MakeMatrixXform()
        for time, matrix in matrices.items():
            op.Set(matrix * turn, time)

    reading = read_stage(edit(path, change))
    before, after = read_usd(path).lobes, reading.tracks.lobes
    matrix = np.array(turn)[:3, :3]
    if up_axis == "Z":  # the turn is about an axis of the stage
        to_z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        matrix = (to_z.T @ matrix.T @ to_z).T
    # float32 frames
    np.testing.assert_allclose(after.axes[:, 1], before.axes[:, 1].numpy() @ matrix, atol=2e-6)
    assert torch.equal(after.axes[:, [0, 2]], before.axes[:, [0, 2]])
    np.testing.assert_allclose(after.amplitude, before.amplitude, rtol=1e-6)
    assert reading.changes == (f"{LOBE}: turned by 40 degrees",)


def test_a_card_moved_away_is_a_sharper_lobe(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath(LOBE).GetAttribute("xformOp:translate:dist").Set(Gf.Vec3d(0, 0, 2000))

    reading = read_stage(edit(path, change))
    (line,) = reading.changes
    assert "width x 0.5, height x 0.5" in line
    before, after = read_usd(path).lobes, reading.tracks.lobes
    ratio = after.sharpness[:, 1] / before.sharpness[:, 1]
    # a quarter of the variance on a plane; on the sphere a lobe of 2 degrees is 0.2 % off that
    assert bool(((ratio > 3.98) & (ratio < 4.01)).all())


def test_scale_of_a_card_counts_as_its_size(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        UsdGeom.Xformable(stage.GetPrimAtPath(LOBE)).AddScaleOp().Set(Gf.Vec3f(2, 1, 1))

    (line,) = read_stage(edit(path, change)).changes
    assert line == f"{LOBE}: width x 2"


def test_normalized_cards_and_plain_distant_lights_say_the_same_light(written, tmp_path):
    for representation in ("cards", "distant"):
        path = written(tmp_path, representation=representation)

        def change(stage: Usd.Stage, kind: str = representation) -> None:
            api, prim = light(stage), stage.GetPrimAtPath(LOBE)
            intensity = api.GetIntensityAttr()
            values = {time: intensity.Get(time) for time in FRAMES}
            for time, value in values.items():
                if kind == "cards":
                    size = [prim.GetAttribute(f"inputs:{n}").Get(time) for n in ("width", "height")]
                    factor = size[0] * size[1]
                else:
                    half = math.radians(prim.GetAttribute("inputs:angle").Get(time) / 2)
                    factor = 1 / (math.pi * math.sin(half) ** 2)
                intensity.Set(value * factor, time)
            api.GetNormalizeAttr().Set(kind == "cards")

        assert read_stage(edit(path, change)).changes == ()
        (tmp_path / "over.usda").unlink()


def test_invisible_and_deactivated_lobes_are_told_of(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00").SetActive(False)
        visibility = UsdGeom.Imageable(stage.GetPrimAtPath(LOBE)).CreateVisibilityAttr()
        visibility.Set("inherited", 1001)
        visibility.Set("invisible", 1002)
        visibility.Set("inherited", 1005)
        UsdGeom.Imageable(stage.GetPrimAtPath("/AsgRig/Lobes/lobe_02")).MakeInvisible()

    reading = read_stage(edit(path, change))
    assert reading.changes == (
        "/AsgRig/Lobes/lobe_00: switched off",
        f"{LOBE}: invisible in 1 of 3 frames",
        "/AsgRig/Lobes/lobe_02: invisible",
    )
    assert reading.tracks.names == ("lobe_01", "lobe_02")
    dark = (reading.tracks.lobes.amplitude == 0).all(-1)
    assert dark.tolist() == [[False, True], [True, True], [False, True]]


def test_a_turned_rig_turns_every_lobe(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        UsdGeom.Xformable(stage.GetPrimAtPath("/AsgRig")).AddRotateYOp().Set(90.0)

    reading = read_stage(edit(path, change))
    before, after = read_usd(path).lobes, reading.tracks.lobes
    x, y, z = before.axis_z.unbind(-1)
    # +Z goes to +X
    np.testing.assert_allclose(after.axis_z, torch.stack([z, y, -x], -1), atol=1e-6)
    assert reading.changes == ("/AsgRig: turned by 90 degrees with all its lobes",)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_an_edited_dome_changes_every_lobe(up_axis, written, tmp_path):
    path = written(tmp_path, representation="dome", up_axis=up_axis)

    def change(stage: Usd.Stage) -> None:
        dome = UsdLux.DomeLight(stage.GetPrimAtPath("/AsgRig/Dome"))
        dome.GetIntensityAttr().Set(3.0)
        xform = UsdGeom.Xformable(dome)
        ops = xform.GetOrderedXformOps()
        up = xform.AddRotateYOp() if up_axis == "Y" else xform.AddRotateZOp()
        up.Set(90.0)
        xform.SetXformOpOrder([up, *ops])

    reading = read_stage(edit(path, change))
    before, after = read_usd(path).lobes, reading.tracks.lobes
    x, y, z = before.axis_z.unbind(-1)
    np.testing.assert_allclose(after.axis_z, torch.stack([z, y, -x], -1), atol=1e-6)
    np.testing.assert_allclose(after.amplitude, 3 * before.amplitude, rtol=1e-6)
    assert reading.changes == ("/AsgRig/Dome: light x 3, turned by 90 degrees",)


def test_a_light_of_another_kind_leaves_its_lobe(written, tmp_path):
    path = written(tmp_path)
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.GetPrimAtPath(
        LOBE.replace("/AsgRig/", "/AsgRig{representation=cards}")
    ).typeName = "DiskLight"
    layer.Save()
    reading = read_stage(path)
    assert reading.changes == (f"{LOBE}: has no RectLight; its lobe is as it was",)
    assert_same(reading.tracks, tracks_of())


def test_a_lobe_that_was_overridden_itself_counts_and_not_its_light(written, tmp_path):
    path = written(tmp_path)

    def change(stage: Usd.Stage) -> None:
        lobe = stage.GetPrimAtPath(LOBE).GetAttribute("asg:amplitude")
        for time in FRAMES:
            lobe.Set(Gf.Vec3f(7, 8, 9), time)

    reading = read_stage(edit(path, change))
    assert reading.tracks.lobes.amplitude[:, 1].tolist() == [[7, 8, 9]] * 3
    assert reading.changes == ()


def test_a_light_edited_over_a_layer_of_edits_counts(written, tmp_path):
    path = written(tmp_path)
    tracks = read_usd(path)
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 1] *= 5
    write_edit_layer(tmp_path / "edit.usda", path, replace(tracks, lobes=lobes), [1])
    assert read_stage(tmp_path / "edit.usda").changes == ()
    over = edit(
        tmp_path / "edit.usda", lambda stage: scale_samples(light(stage).GetIntensityAttr(), 2.0)
    )
    reading = read_stage(over)
    assert reading.changes == (f"{LOBE}: light x 2",)
    np.testing.assert_allclose(
        reading.tracks.lobes.amplitude[:, 1], 10 * tracks.lobes.amplitude[:, 1], rtol=1e-4
    )


def test_edits_are_absorbed_where_the_stage_is_written_anew(written, tmp_path):
    path = written(tmp_path)
    over = edit(path, lambda stage: scale_samples(light(stage).GetIntensityAttr(), 2.0))
    tracks = read_usd(over)
    write_every(tracks, tmp_path / "anew.usda", dome_height=2)
    assert read_stage(tmp_path / "anew.usda").changes == ()
    assert lint_stage(tmp_path / "anew.usda") == []
    assert_same(read_usd(tmp_path / "anew.usda"), tracks)


def test_a_black_light_that_was_lit_is_lit(tmp_path):
    tracks = still()
    tracks.lobes.sharpness[0, 1] *= 500  # one card
    tracks.lobes.amplitude[0, 1] = 0
    write_usd(tracks, tmp_path / "shot.usda", representations=("cards",))
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    stage.GetPrimAtPath(LOBE).GetAttribute("inputs:intensity").Set(3.0)
    stage.GetRootLayer().Export(str(tmp_path / "lit.usda"))
    reading = read_stage(tmp_path / "lit.usda")
    assert reading.changes == (f"{LOBE}: light from 0 to 3",)
    write_usd(reading.tracks, tmp_path / "anew.usda", representations=("cards",))
    anew = Usd.Stage.Open(str(tmp_path / "anew.usda"))
    assert anew.GetPrimAtPath(LOBE).GetAttribute("inputs:intensity").Get() == pytest.approx(3.0)


def test_a_layer_of_edits_refuses_what_it_could_not_change(written, tmp_path):
    path = written(tmp_path)
    over = edit(path, lambda stage: scale_samples(light(stage).GetIntensityAttr(), 2.0))
    tracks = read_usd(over)
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, :2] *= 5
    after = replace(tracks, lobes=lobes)
    with pytest.raises(InputError) as caught:
        write_edit_layer(tmp_path / "edit.usda", over, after, [0, 1])
    message = str(caught.value)
    assert message.startswith(f"{over}: {LOBE}: light x ")
    assert message.endswith(f"Write a stage anew: asglight stitch {over} -o STAGE.")
    assert not (tmp_path / "edit.usda").exists()
    lobes.amplitude[:, 1] = tracks.lobes.amplitude[:, 1]
    write_edit_layer(tmp_path / "edit.usda", over, after, [0])
    assert_same(read_usd(tmp_path / "edit.usda"), after)
