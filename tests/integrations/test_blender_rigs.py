# SPDX-License-Identifier: Apache-2.0
"""Stages as the Blender extension reads them, against USD's own values; and its layers of edits."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import written_stages
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdUtils
from scipy.spatial.transform import Rotation
from usd_tracks import edited, of_every_kind

from asglight.usd import read_stage
from integrations.blender.plain import edits, rigs
from integrations.blender.plain.edits import Seen, View
from integrations.blender.plain.rigs import Rig
from integrations.blender.plain.tracks import TURN_MAX

FRAMES = (1001, 1002, 1003)
TIMES = np.array([1001.0, 1001.5, 1002.0, 1002.25, 1003.0])
SAG = 1000 * (1 - np.cos(TURN_MAX / 2)) + 0.02
"""Of the chord between two places of a card 1,000 units away, and what float32 rounds."""

EVERY = ("cards", "distant", "dome")


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    path = tmp_path / "shot.usda"
    written_stages.put(of_every_kind(FRAMES), path, dome_height=8)
    return path


def read(path: Path) -> Rig:
    opened = Usd.Stage.Open(str(path))
    (prim,) = rigs.rig_prims(opened)
    return rigs.read_rig(prim)


def test_lights_are_what_usd_says_at_every_time(stage: Path) -> None:
    opened = Usd.Stage.Open(str(stage))
    rig = read(stage)
    assert rig.representation == "cards"
    assert [path.rpartition("/")[2] for path in rig.groups] == ["lobe_00", "lobe_01", "lobe_02"]
    assert {lamp.group.rpartition("/")[2] for lamp in rig.lamps} == {"lobe_01", "lobe_02"}
    for lamp in rig.lamps:
        light = UsdLux.RectLight(opened.GetPrimAtPath(lamp.path))
        for time in TIMES.tolist():
            when = np.array([time])
            found = lamp.brightness.at(when)[0] * lamp.colour.at(when)[0]
            sent = light.GetIntensityAttr().Get(time) * np.array(light.GetColorAttr().Get(time))
            np.testing.assert_allclose(found, sent, rtol=1e-6)
            size = [light.GetWidthAttr().Get(time), light.GetHeightAttr().Get(time)]
            np.testing.assert_allclose(lamp.size.at(when)[0], size, rtol=1e-6)
            world = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(light.GetPrim()))
            x, y, z = world[3, :3]
            np.testing.assert_allclose(lamp.place.position.at(when)[0], [x, -z, y], atol=SAG)
            shines = Rotation.from_quat(lamp.place.rotation.at(when)[0], scalar_first=True)
            x, y, z = -world[2, :3]  # along -Z of its prim
            np.testing.assert_allclose(shines.apply([0, 0, -1]), [x, -z, y], atol=2e-5)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_a_rig_is_the_same_whatever_the_stage_s_axis(tmp_path: Path, up_axis: str) -> None:
    path = tmp_path / "shot.usda"
    written_stages.put(
        of_every_kind(FRAMES), path, dome_height=8, up_axis=up_axis, colorspace="ACEScg"
    )
    # lights are written in the space of the stage, and are Rec.709 again
    plain = tmp_path / "plain.usda"
    written_stages.put(of_every_kind(FRAMES), plain, dome_height=8)
    for found, expected in zip(read(path).lamps, read(plain).lamps, strict=True):
        places = found.place.position.at(TIMES), expected.place.position.at(TIMES)
        np.testing.assert_allclose(*places, atol=SAG)
        frames = np.array(FRAMES, dtype=float)  # between them samples are chosen for each stage
        light, due = (
            one.brightness.at(frames) * one.colour.at(frames) for one in (found, expected)
        )
        np.testing.assert_allclose(light, due, rtol=1e-4)


def test_suns_have_their_irradiance_and_domes_their_images(tmp_path: Path) -> None:
    path = tmp_path / "shot.usda"
    written_stages.put(of_every_kind(FRAMES), path, representations=EVERY, dome_height=8)
    opened = Usd.Stage.Open(str(path))
    (prim,) = rigs.rig_prims(opened)
    assert rigs.representations(prim) == ["cards", "distant", "dome"]
    prim.GetVariantSet("representation").SetVariantSelection("distant")
    suns = rigs.read_rig(prim).lamps
    assert {sun.kind for sun in suns} == {"sun"}
    light = UsdLux.DistantLight(opened.GetPrimAtPath(suns[0].path))
    assert suns[0].brightness.at(TIMES)[0, 0] == pytest.approx(light.GetIntensityAttr().Get(1001))
    prim.GetVariantSet("representation").SetVariantSelection("dome")
    (dome,) = rigs.read_rig(prim).domes
    assert dome.times.tolist() == list(FRAMES)
    assert [Path(image).name for image in dome.images] == [f"shot.{frame}.exr" for frame in FRAMES]
    assert all(Path(image).is_file() for image in dome.images)


def author(name: str, value: object, kind: Sdf.ValueTypeName) -> Callable[[Sdf.Layer], None]:
    def edit(layer: Sdf.Layer) -> None:
        prim = layer.GetPrimAtPath("/AsgRig/Lobes/lobe_02")
        found = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, kind)
        found.default = value
        for time in layer.ListTimeSamplesForPath(found.path):
            layer.EraseTimeSample(found.path, time)

    return edit


def test_exposure_normalising_and_visibility_count(stage: Path) -> None:
    lamp = next(one for one in read(stage).lamps if one.path.endswith("lobe_02"))
    edited(stage, author("inputs:exposure", 3.0, Sdf.ValueTypeNames.Float))
    edited(stage, author("inputs:width", 4.0, Sdf.ValueTypeNames.Float))
    edited(stage, author("inputs:height", 5.0, Sdf.ValueTypeNames.Float))
    edited(stage, author("inputs:normalize", True, Sdf.ValueTypeNames.Bool))
    edited(stage, author("visibility", "invisible", Sdf.ValueTypeNames.Token))
    found = next(one for one in read(stage).lamps if one.path.endswith("lobe_02"))
    ratio = found.brightness.at(TIMES) / lamp.brightness.at(TIMES)
    np.testing.assert_allclose(ratio, 8 / 20, rtol=1e-6)
    assert found.visible.values.tolist() == [[0.0]]


def test_a_mirrored_card_is_seen_where_it_stands() -> None:
    turn = Rotation.from_rotvec([0.3, -1.0, 0.2]).as_matrix()
    mirrored = turn @ np.diag([-1.0, 1.0, 1.0])
    found = rigs.rotation_matrix(rigs.quaternions(mirrored[None])[0].tolist())
    np.testing.assert_allclose(found, turn, atol=1e-12)  # the same card, mirrored in its x


def view_of(rig: Rig) -> View:
    """Return a rig as it would be seen in Blender without an edit."""
    lights = [
        Seen(
            lamp.path,
            lamp.brightness.at(TIMES) * lamp.colour.at(TIMES),
            lamp.size.at(TIMES),
            np.ones(len(TIMES), bool),
            lamp.place.position.at(TIMES) - rig.place.position.at(TIMES),
            lamp.place.rotation.at(TIMES),
        )
        for lamp in rig.lamps
    ]
    return View(rig.representation, TIMES, lights, np.zeros(len(TIMES)), "lin_rec709_scene")


def with_light(view: View, name: str, change: Callable[[Seen], Seen]) -> View:
    return replace(
        view, lights=[change(one) if one.path.endswith(name) else one for one in view.lights]
    )


def test_nothing_is_written_where_nothing_was_edited(stage: Path, tmp_path: Path) -> None:
    target = tmp_path / "edits.usda"
    assert edits.write_edits(stage, target, "/AsgRig", view_of(read(stage))) == []
    assert not target.exists()


CHANGES: dict[str, tuple[Callable[[Seen], Seen], str, str]] = {
    "gain": (lambda one: replace(one, light=2 * one.light), "light x 2", "light x 2"),
    "warmer": (
        lambda one: replace(one, light=one.light * [1.0, 0.5, 0.5]),
        "another colour",
        "another colour",
    ),
    "wider": (
        lambda one: replace(one, size=one.size * [1.5, 1.0]),
        "width and height",
        "width x 1.5",
    ),
    "hidden": (
        lambda one: replace(one, visible=np.zeros(len(TIMES), bool)),
        "hidden",
        "invisible",
    ),
    "moved": (
        lambda one: replace(
            one,
            position=Rotation.from_rotvec([0, 0, 0.4]).apply(one.position),
            rotation=(
                Rotation.from_rotvec([0, 0, 0.4])
                * Rotation.from_quat(one.rotation, scalar_first=True)
            ).as_quat(scalar_first=True),
        ),
        "moved",
        "turned by 22.9 degrees",
    ),
}


@pytest.mark.parametrize("representations", [("cards",), ("distant", "cards")])
@pytest.mark.parametrize("change", list(CHANGES))
def test_asglight_reads_edits_as_what_was_done(
    tmp_path: Path, change: str, representations: tuple[str, ...]
) -> None:
    stage = tmp_path / "shot.usda"
    written_stages.put(of_every_kind(FRAMES), stage, dome_height=8, representations=representations)
    opened = Usd.Stage.Open(str(stage))
    (prim,) = rigs.rig_prims(opened)
    if len(representations) > 1:
        prim.GetVariantSet("representation").SetVariantSelection("cards")
    edit, said, read_as = CHANGES[change]
    view = with_light(view_of(rigs.read_rig(prim)), "lobe_02", edit)
    target = tmp_path / "edits.usda"
    words = edits.write_edits(stage, target, "/AsgRig", view)
    assert words == [f"/AsgRig/Lobes/lobe_02: {words[0].partition(': ')[2]}"]
    assert said in words[0]
    (found,) = read_stage(target).changes
    assert found.startswith("/AsgRig/Lobes/lobe_02: ")
    assert read_as in found
    assert [path.name for path in tmp_path.glob(".*")] == []


def test_a_turned_rig_turns_all_its_lights(stage: Path, tmp_path: Path) -> None:
    view = replace(view_of(read(stage)), turn=np.full(len(TIMES), 40.0))
    target = tmp_path / "edits.usda"
    words = edits.write_edits(stage, target, "/AsgRig", view)
    assert words == ["/AsgRig: turned by 40.0 degrees"]
    assert list(read_stage(target).changes) == ["/AsgRig: turned by 40 degrees with all its lobes"]
    # a turn about Blender's +Z is one about the stage's +Y
    before, after = (read(path).lamps[0].place.position.at(TIMES) for path in (stage, target))
    turned = Rotation.from_rotvec([0, 0, np.radians(40)]).apply(before)
    np.testing.assert_allclose(after, turned, atol=1e-3)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("first", [(45.0, 45.0), (0.0, 60.0)], ids=["still", "moving"])
def test_a_second_turn_comes_on_top_of_the_first(
    tmp_path: Path, first: tuple[float, float], up_axis: str
) -> None:
    paths = [tmp_path / name for name in ("shot.usda", "once.usda", "twice.usda")]
    written_stages.put(of_every_kind(FRAMES), paths[0], dome_height=8, up_axis=up_axis)
    turns = [np.interp(TIMES, (1001, 1003), first), np.full(len(TIMES), 30.0)]
    for below, layer, turn in zip(paths, paths[1:], turns, strict=False):
        edits.write_edits(below, layer, "/AsgRig", replace(view_of(read(below)), turn=turn))
    before, after = (read(path).lamps[0].place.position.at(TIMES) for path in (paths[0], paths[2]))
    expected = [Rotation.from_euler("z", angle, degrees=True) for angle in sum(turns).tolist()]
    turned = [one.apply(place) for one, place in zip(expected, before, strict=True)]
    np.testing.assert_allclose(after, turned, atol=2 * SAG)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("placed", ["itself", "its parent", "tilted"])
def test_a_rig_turns_where_it_stands(tmp_path: Path, placed: str, up_axis: str) -> None:
    stage = tmp_path / "shot.usda"
    path = "/World/AsgRig"
    tracks = of_every_kind(FRAMES)
    written_stages.put(tracks, stage, dome_height=8, up_axis=up_axis, primary_path=path)
    opened = Usd.Stage.Open(str(stage))
    prim = opened.GetPrimAtPath(path if placed == "itself" else "/World")
    ops = UsdGeom.Xformable(prim)
    ops.AddTranslateOp(opSuffix="put").Set(Gf.Vec3d(300.0, 20.0, -100.0))
    if placed == "tilted":
        ops.AddRotateXOp(opSuffix="put").Set(35.0)
    opened.Save()
    layers = [stage, tmp_path / "once.usda", tmp_path / "twice.usda"]
    for below, layer in pairwise(layers):
        turn = np.full(len(TIMES), 40.0)
        edits.write_edits(below, layer, path, replace(view_of(read(below)), turn=turn))
    before, after = (read(layer) for layer in (layers[0], layers[2]))
    origin = before.place.position.at(TIMES)
    assert np.linalg.norm(origin[0]) > 300
    np.testing.assert_allclose(after.place.position.at(TIMES), origin, atol=1e-3)
    turned = Rotation.from_rotvec([0, 0, np.radians(80)])
    for was, now in zip(before.lamps, after.lamps, strict=True):
        due = origin + turned.apply(was.place.position.at(TIMES) - origin)
        np.testing.assert_allclose(now.place.position.at(TIMES), due, atol=2 * SAG)


def test_a_turn_goes_on_beyond_half_a_turn(stage: Path, tmp_path: Path) -> None:
    turn = np.interp(TIMES, (1001, 1003), (100.0, 420.0))
    seen = (turn + 180) % 360 - 180  # as a matrix tells it
    target = tmp_path / "edits.usda"
    edits.write_edits(stage, target, "/AsgRig", replace(view_of(read(stage)), turn=seen))
    opened = Usd.Stage.Open(str(target))
    for time in np.linspace(1001, 1003, 33).tolist():
        world = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(opened.GetDefaultPrim()))
        due = Rotation.from_euler("y", np.interp(time, (1001, 1003), (100, 420)), degrees=True)
        np.testing.assert_allclose(world[:3, :3].T, due.as_matrix(), atol=1e-5)


def test_a_deleted_light_is_dark(stage: Path, tmp_path: Path) -> None:
    view = view_of(read(stage))
    view = replace(view, lights=[one for one in view.lights if not one.path.endswith("lobe_02")])
    target = tmp_path / "edits.usda"
    words = edits.write_edits(stage, target, "/AsgRig", view)
    assert words == ["/AsgRig/Lobes/lobe_02: deleted, so invisible"]
    assert list(read_stage(target).changes) == ["/AsgRig/Lobes/lobe_02: invisible"]


def test_the_stage_itself_is_never_written(stage: Path) -> None:
    before = stage.read_bytes()
    with pytest.raises(ValueError, match="is the stage itself; expected another name"):
        edits.write_edits(stage, stage, "/AsgRig", view_of(read(stage)))
    with pytest.raises(ValueError, match="has no /Other any more; import it again"):
        edits.write_edits(stage, stage.with_name("e.usda"), "/Other", view_of(read(stage)))
    assert stage.read_bytes() == before


def test_what_a_stage_is_made_of_is_never_written(stage: Path) -> None:
    layers = [stage, stage.with_name("once.usda"), stage.with_name("twice.usda")]
    for below, layer in pairwise(layers):
        turned = replace(view_of(read(below)), turn=np.full(len(TIMES), 30.0))
        edits.write_edits(below, layer, "/AsgRig", turned)
    packed = stage.with_name("packed.usdz")
    UsdUtils.CreateNewUsdzPackage(str(stage), str(packed))
    layers.append(stage.with_name("of_package.usda"))
    edits.write_edits(packed, layers[3], "/AsgRig", turned)
    before = {path: path.read_bytes() for path in stage.parent.iterdir() if path.is_file()}
    over = "^lies over {}; expected another name for the layer$"
    images = "^has images in shot_dome, which goes with shot.usdc; expected another name for the l"
    for source, target, said in (
        (layers[2], layers[0], over.format("shot.usda")),
        (layers[2], layers[1], over.format("once.usda")),
        (layers[3], packed, over.format("packed.usdz")),
        (layers[1], stage.with_suffix(".usdc"), images),
    ):
        with pytest.raises(ValueError, match=said):
            edits.write_edits(source, target, "/AsgRig", turned)
    assert {path: path.read_bytes() for path in stage.parent.iterdir() if path.is_file()} == before
    assert edits.write_edits(layers[1], layers[2], "/AsgRig", turned)  # over nothing but itself


def test_a_file_that_is_no_stage_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^no such file; expected a stage that asglight wrote$"):
        rigs.opened(str(tmp_path / "absent.usda"))
    (tmp_path / "torn.usda").write_text("#usda 1.0\ndef Xform {")
    with pytest.raises(ValueError, match=r"^is damaged, or no stage; USD cannot open it$"):
        rigs.opened(str(tmp_path / "torn.usda"))
