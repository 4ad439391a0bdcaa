# SPDX-License-Identifier: Apache-2.0
"""A rig as shots use it is read as USD composes it: the lights give what the lobes give."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom, UsdUtils
from shot_lights import irradiance, irradiance_of_lobes, relative_rms
from usd_tracks import of_every_kind, write_every

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.lobes import LobeTracks, asg
from asglight.usd import read_stage, read_usd, write_edit_layer
from asglight.usd.options import OF_LOBES
from asglight.usd.read.read_options import read_options

FRAMES = (1001, 1002, 1003, 1004, 1005)

AS_WRITTEN = {"cards": 0.02, "distant": 0.12, "dome": 0.02}
"""Relative error of the lights of these three lobes, one of them broad, in a stage by itself; the
lights of a shot may add a hundredth."""

RIG = "/World/Env"


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a rig for each up axis, moving and still."""
    folder = tmp_path_factory.mktemp("rigs")
    for axis in "YZ":
        path = folder / f"rig_{axis.lower()}.usda"
        write_every(of_every_kind(FRAMES), path, up_axis=axis, dome_height=64)
    return folder


@pytest.fixture
def folder(rigs: Path, tmp_path: Path) -> Path:
    for entry in rigs.iterdir():
        (tmp_path / entry.name).symlink_to(entry) if entry.is_dir() else None
        if entry.is_file():
            (tmp_path / entry.name).write_bytes(entry.read_bytes())
    return tmp_path


def shot(
    folder: Path,
    arc: str = "prepend references = @./rig_y.usda@",
    body: str = "",
    *,
    up: str = "Y",
    head: str = "",
    more: str = "",
    start: int = 1001,
    end: int = 1005,
) -> Path:
    """Write a shot with a rig at RIG."""
    path = folder / "shot.usda"
    # a prim begins and ends a line
    body = re.sub(r"\} (?=\})", "}\n", body.replace("{ over", "{\nover"))
    path.write_text(
        f'#usda 1.0\n(\n defaultPrim = "World"\n upAxis = "{up}"\n startTimeCode = {start}\n'
        f" endTimeCode = {end}\n {head}\n)\n"
        f'def Xform "World" {{\n def Xform "Env" (\n  {arc}\n ) {{\n{body}\n }}\n}}\n{more}\n'
    )
    return path


def op(kind: str, value: str) -> str:
    name = f"xformOp:{kind}"
    types = {"rotateX": "double", "rotateY": "double", "transform": "matrix4d"}
    return (
        f'{types.get(kind, "double3")} {name} = {value}\nuniform token[] xformOpOrder = ["{name}"]'
    )


def under(body: str) -> str:
    return f'over "Lobes" {{ over "lobe_02" {{\n{body}\n}} }}'


UNEVEN = op("scale", "(1, 2, 0.5)")
SHEARED = op("transform", "( (1, .4, 0, 0), (0, 1, .3, 0), (0, 0, 1.5, 0), (0, 0, 0, 1) )")

SHOTS: dict[str, Callable[[Path], Path]] = {
    "referenced": lambda folder: shot(folder),
    "payload": lambda folder: shot(folder, "prepend payload = @./rig_y.usda@"),
    "instance": lambda folder: shot(
        folder, "instanceable = true\n prepend references = @./rig_y.usda@"
    ),
    "class": lambda folder: shot(
        folder,
        "inherits = </_Rig>",
        more='class Xform "_Rig" (prepend references = @./rig_y.usda@) {}',
    ),
    "specialized": lambda folder: shot(
        folder,
        "specializes = </_Rig>",
        more='class Xform "_Rig" (prepend references = @./rig_y.usda@) {}',
    ),
    "turned": lambda folder: shot(folder, body=op("rotateXYZ", "(20, 30, 40)")),
    "scaled": lambda folder: shot(folder, body=op("scale", "(0.01, 0.01, 0.01)")),
    "mirrored": lambda folder: shot(folder, body=op("scale", "(-1, 1, 1)")),
    "mirrored through": lambda folder: shot(folder, body=op("scale", "(-2, -2, -2)")),
    "moved": lambda folder: shot(folder, body=op("translate", "(5000, 20, -3000)")),
    "turning": lambda folder: shot(
        folder,
        body="double xformOp:rotateY.timeSamples = { 1001: 0, 1005: 90 }\n"
        'uniform token[] xformOpOrder = ["xformOp:rotateY"]',
    ),
    "z-up, corrected": lambda folder: shot(folder, body=op("rotateX", "90"), up="Z"),
    "z-up, on its side": lambda folder: shot(folder, up="Z"),
    "z-up rig, corrected": lambda folder: shot(
        folder, "prepend references = @./rig_z.usda@", op("rotateX", "-90")
    ),
    "z-up rig, on its side": lambda folder: shot(folder, "prepend references = @./rig_z.usda@"),
    "z-up rig in z-up": lambda folder: shot(folder, "prepend references = @./rig_z.usda@", up="Z"),
    "centimetres": lambda folder: shot(folder, head="metersPerUnit = 0.01"),
    "later and slower": lambda folder: shot(
        folder,
        "prepend references = @./rig_y.usda@ (offset = -1000; scale = 2)",
        start=1000,
        end=1012,
    ),
    "backwards": lambda folder: shot(
        folder, "prepend references = @./rig_y.usda@ (offset = 2006; scale = -1)"
    ),
    "another rate": lambda folder: shot(
        folder, head="timeCodesPerSecond = 48", start=2002, end=2010
    ),
    "warm": lambda folder: shot(
        folder,
        body=under("bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 2500"),
    ),
    "warmer": lambda folder: shot(
        folder,
        body=under(
            "bool inputs:enableColorTemperature = 1\n"
            "float inputs:colorTemperature.timeSamples = { 1001: 2500, 1005: 9000 }"
        ),
    ),
    "warm fill": lambda folder: shot(
        folder,
        body='over "Fill" (active = true) {\nbool inputs:enableColorTemperature = 1\n'
        "float inputs:colorTemperature = 3000\n}",
    ),
    "exposed": lambda folder: shot(folder, body=under("float inputs:exposure = 1.5")),
    "blinking": lambda folder: shot(
        folder,
        body=under('token visibility.timeSamples = { 1001: "inherited", 1003: "invisible" }'),
    ),
    "hidden": lambda folder: shot(folder, body='token visibility = "invisible"'),
    "normalised": lambda folder: shot(
        folder,
        body=op("scale", "(3, 3, 3)") + "\n" + under("bool inputs:normalize = 1"),
    ),
    "without fill": lambda folder: shot(folder, body='over "Fill" (active = false) {}'),
    "without a card": lambda folder: shot(
        folder, body='over "Lobes" { over "lobe_01" { over "outer" (active = false) {} } }'
    ),
    "without cards": lambda folder: shot(
        folder,
        body='over "Lobes" { over "lobe_01" { over "outer" (active = false) {}\n'
        'over "tall" (active = false) {}\nover "wide" (active = false) {} } }',
    ),
    "a lobe off": lambda folder: shot(
        folder, body='over "Lobes" { over "lobe_01" (active = false) {} }'
    ),
    "turned away": lambda folder: shot(
        folder,
        body=under(
            "double xformOp:rotateX:away = 60\nuniform token[] xformOpOrder = "
            '["xformOp:orient", "xformOp:translate:dist", "xformOp:rotateX:away"]'
        ),
    ),
    "seen from behind": lambda folder: shot(
        folder,
        body=under(
            "double xformOp:rotateX:away = 180\nuniform token[] xformOpOrder = "
            '["xformOp:orient", "xformOp:translate:dist", "xformOp:rotateX:away"]'
        ),
    ),
    "not with the rig": lambda folder: shot(
        folder,
        body=op("rotateY", "50")
        + "\n"
        + under(
            'uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:orient", '
            '"xformOp:translate:dist"]'
        ),
    ),
    "three rigs deep": lambda folder: (
        shot(folder, body=op("rotateY", "30"), up="Z").rename(folder / "set.usda"),
        shot(
            folder,
            "prepend references = @./set.usda@</World/Env> (offset = 10)",
            op("rotateXYZ", "(80, 5, -20)"),
            up="Z",
            start=1011,
            end=1015,
        ),
    )[1],
}


def gap(path: Path, reading_frames: tuple[int, ...] = ()) -> float:
    """Return the relative error of the lights against the lobes, the worst of the frames."""
    tracks, stage = read_usd(path), Usd.Stage.Open(str(path))
    worst = 0.0
    for frame in reading_frames or (tracks.frames[0], tracks.frames[2], tracks.frames[-1]):
        found = irradiance(stage, frame, RIG)
        wanted = irradiance_of_lobes(tracks.at(frame))
        if not found.any():
            assert not wanted.any()
            continue
        worst = max(worst, relative_rms(wanted, found))
    return worst


@pytest.mark.parametrize("name", SHOTS)
def test_the_lights_give_what_the_lobes_give(name, folder):
    assert gap(SHOTS[name](folder)) < AS_WRITTEN["cards"] + 0.01


@pytest.mark.parametrize("representation", OF_LOBES)
@pytest.mark.parametrize("name", ["turned", "mirrored", "z-up, corrected", "z-up, on its side"])
def test_it_does_so_in_every_representation(name, representation, folder):
    path = SHOTS[name](folder)
    text = path.read_text()
    chosen = f'variants = {{ string representation = "{representation}" }}\n'
    path.write_text(text.replace(" prepend references", f" {chosen} prepend references"))
    assert gap(path) < AS_WRITTEN[representation] + 0.01


@pytest.mark.parametrize("body", [UNEVEN, SHEARED], ids=["uneven", "sheared"])
@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_lights_of_a_rig_scaled_unevenly_are_read_as_they_are_seen(body, representation, tmp_path):
    tracks = of_every_kind(FRAMES)
    tracks.lobes.sharpness[:] = torch.tensor([[400.0, 150.0], [60.0, 90.0], [5000.0, 9000.0]])
    write_every(tracks, tmp_path / "rig_y.usda", representation=representation, dome_height=8)
    path = shot(tmp_path, body=body)
    # three cards of a lobe are taken together, and each is sheared in another way
    assert gap(path) < AS_WRITTEN["cards"] + 0.01
    assert any("is scaled unevenly" in line for line in read_stage(path).unread)


def test_a_layer_that_only_sublayers_a_rig_has_its_frames(folder):
    path = folder / "over.usda"
    path.write_text("#usda 1.0\n(\n subLayers = [@./rig_y.usda@ (offset = 10; scale = 2)]\n)\n")
    reading = read_stage(path)
    rig = read_usd(folder / "rig_y.usda")
    assert reading.tracks.frames == tuple(range(2012, 2021))
    assert reading.changes == reading.unread == ()
    for frame in FRAMES:
        found = reading.tracks.at(2 * frame + 10)
        np.testing.assert_allclose(found.amplitude, rig.at(frame).amplitude, rtol=1e-6)


def test_frames_that_a_rig_lists_are_moved_with_it(tmp_path):
    twos = (1001, 1003, 1005, 1009)
    write_every(of_every_kind(twos), tmp_path / "rig_y.usda", dome_height=2)
    arc = "prepend references = @./rig_y.usda@ (offset = -1000)"
    path = shot(tmp_path, arc, start=2, end=20)
    assert read_usd(path).frames == (3, 5, 9)
    between = shot(tmp_path, "prepend references = @./rig_y.usda@ (offset = 0.5)")
    assert read_usd(between).frames == FRAMES  # none of its frames is whole: all of the shot's


def test_a_flattened_shot_is_the_same(folder):
    path = SHOTS["later and slower"](folder)
    flat = folder / "flat.usda"
    Usd.Stage.Open(str(path)).Flatten().Export(str(flat))
    assert_alike(read_usd(flat), read_usd(path))
    twos = of_every_kind((1001, 1003, 1005))
    write_every(twos, folder / "rig_y.usda", dome_height=64)
    Usd.Stage.Open(str(SHOTS["later and slower"](folder))).Flatten().Export(str(flat))
    assert read_usd(flat).frames == tuple(range(1000, 1013))  # its list is not moved with it


def test_a_package_of_a_shot_is_the_same(folder):
    path = SHOTS["z-up, corrected"](folder)
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(folder / "shot.usdz"))
    assert_alike(read_usd(folder / "shot.usdz"), read_usd(path))


def assert_alike(found: LobeTracks, wanted: LobeTracks) -> None:
    assert found.frames == wanted.frames
    assert found.names == wanted.names
    for name in ("axes", "sharpness", "amplitude"):
        values = [getattr(tracks.lobes, name).numpy() for tracks in (found, wanted)]
        np.testing.assert_allclose(*values, rtol=2e-5, atol=2e-5)


SAYS = {
    "light linking": (
        under("prepend rel collection:lightLink:excludes = </World>"),
        "/World/Env/Lobes/lobe_02: lights some prims only (light linking); read as if it lit all",
    ),
    "included only": (
        under("uniform bool collection:lightLink:includeRoot = 0"),
        "/World/Env/Lobes/lobe_02: lights some prims only (light linking); read as if it lit all",
    ),
    "shadow linking": (
        under("prepend rel collection:shadowLink:excludes = </World>"),
        "/World/Env/Lobes/lobe_02: gets shadows from some prims only (shadow linking)",
    ),
    "filters": (
        under("rel light:filters = </World/Blocker>"),
        "/World/Env/Lobes/lobe_02: has light filters (/World/Blocker), which are not read",
    ),
    "portals": (
        'over "Fill" {\nrel portals = </World/Window>\n}',
        "/World/Env/Fill: shines through portals only (/World/Window); read as if open",
    ),
    "diffuse": (
        under("float inputs:diffuse = 0.5"),
        "/World/Env/Lobes/lobe_02: has multipliers of 0.5 on diffuse and 1 on specular reflection; "
        "a lobe lights both alike, and is read without them",
    ),
    "shaping": (
        under("float inputs:shaping:cone:angle = 10"),
        "/World/Env/Lobes/lobe_02: is shaped by a cone, focus or IES profile; read as it shines "
        "without",
    ),
    "missing image": (
        'over "Fill" {\nasset inputs:texture:file = @./rig_y_dome/gone.exr@\n}',
        "/World/Env/Fill: has the image ./rig_y_dome/gone.exr, which is not there; read as its "
        "lobes say",
    ),
    "another image": (
        'over "Fill" {\nasset inputs:texture:file = @./shot.usda@\n}',
        "/World/Env/Fill: has an image of another origin (./shot.usda); read as its lobes say",
    ),
    "normalised dome": (
        'over "Fill" {\nbool inputs:normalize = 1\n}',
        "/World/Env/Fill: is a normalised dome, which programs show differently; read as if it "
        "were not",
    ),
    "purpose": (
        'uniform token purpose = "guide"',
        "/World/Env: has the purpose guide, which renderers leave out",
    ),
    "a lobe of the fill off": (
        'over "Lobes" { over "lobe_00" (active = false) {} }',
        "/World/Env/Lobes/lobe_00: is off, and its light is in the image of Fill; read without it",
    ),
    "a lobe of the fill hidden": (
        'over "Lobes" { over "lobe_00" {\ntoken visibility = "invisible"\n} }',
        "/World/Env/Lobes/lobe_00: is off, and its light is in the image of Fill; read without it",
    ),
}


@pytest.mark.parametrize("name", SAYS)
def test_what_lobes_cannot_hold_is_said(name, folder, capsys):
    body, line = SAYS[name]
    path = shot(folder, body=body)
    assert read_stage(path).unread == (line,)
    assert main(["info", str(path)]) == 0
    assert f"not read: {line}" in capsys.readouterr().out
    assert main(["export", str(path), "--to", "json", "-o", str(folder / "lobes.json")]) == 0
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith(f"asglight: {path}: not read: {line}")


def test_multipliers_of_all_reflection_are_light(folder):
    half = shot(folder, body=under("float inputs:diffuse = 0.5\nfloat inputs:specular = 0.5"))
    reading, rig = read_stage(half), read_usd(folder / "rig_y.usda")
    assert reading.unread == ()
    ratio = reading.tracks.lobes.amplitude[:, 2] / rig.lobes.amplitude[:, 2]
    np.testing.assert_allclose(ratio, 0.5, rtol=1e-4)


def test_the_representation_that_is_not_there_is_said(folder):
    arc = 'variants = {\n string representation = "cubes"\n}\nprepend references = @./rig_y.usda@'
    assert read_stage(shot(folder, arc)).unread == (
        "/World/Env: selects the representation cubes, which has no lights; read as its lobes say",
    )


def test_lights_beside_the_rig_are_said(folder):
    more = 'def SphereLight "Key" {}\ndef SphereLight "Rim" {}\ndef DistantLight "Sun" {}'
    assert read_stage(shot(folder, more=more)).unread == (
        "/World/Env: lights beside it are not read (1 DistantLight, 2 SphereLight)",
    )


def test_a_rig_in_a_point_instancer_is_said(folder):
    path = shot(folder)
    path.write_text(path.read_text().replace('def Xform "World"', 'def PointInstancer "World"'))
    (line,) = read_stage(path).unread
    assert line == "/World/Env: stands in a PointInstancer: read once, where it is written"


def refused(path: Path | Usd.Stage) -> str:
    with pytest.raises(InputError) as caught:
        read_usd(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


NONE = {
    "gone": ("prepend references = @./gone.usda@", "", "refers to ./gone.usda, which is not there"),
    "payload gone": ("prepend payload = @./gone.usda@", "", "refers to ./gone.usda, which is not"),
    "deactivated": (
        "active = false\nprepend references = @./rig_y.usda@",
        "",
        "has /World/Env deactivated and shows no lobes; expected an active rig. Activate it.",
    ),
    "lobes deactivated": (
        "prepend references = @./rig_y.usda@",
        'over "Lobes" (active = false) {}',
        "has /World/Env/Lobes deactivated and shows no lobes",
    ),
}


@pytest.mark.parametrize("name", NONE)
def test_a_shot_without_lobes_says_why(name, folder, capfd):
    arc, body, message = NONE[name]
    assert message in refused(shot(folder, arc, body))
    assert capfd.readouterr().err == ""  # USD's own warnings are in the message


def test_a_class_that_nothing_inherits_says_so(folder):
    path = folder / "class.usda"
    path.write_text('#usda 1.0\nclass "_Rig" (\n references = @./rig_y.usda@\n) {}\n')
    assert "has lobes at /_Rig, which is a class, and USD shows none of it" in refused(path)
    path.write_text('#usda 1.0\nover "AsgRig" (\n references = @./rig_y.usda@\n) {}\n')
    assert read_usd(path).lobes.count == 3  # the reference defines it


def test_an_open_stage_is_read_as_it_is(folder):
    path = shot(folder, "prepend payload = @./rig_y.usda@")
    stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    assert refused(stage).endswith(
        "has a payload at /World/Env that is not loaded; expected lobes. Load it: stage.Load()."
    )
    stage.Load()
    assert_alike(read_usd(stage), read_usd(folder / "rig_y.usda"))
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath(RIG)).SetRotate((0, 90, 0))
    x, y, z = read_usd(folder / "rig_y.usda").lobes.axis_z.unbind(-1)
    np.testing.assert_allclose(read_usd(stage).lobes.axis_z, torch.stack([z, y, -x], -1), atol=1e-6)
    stage.MuteLayer(str(folder / "rig_y.usda"))
    assert "rig_y.usda is muted; expected them. Unmute the layer." in refused(stage)


def test_of_several_rigs_one_is_named(folder, capsys):
    path = shot(
        folder, more='def "Other" (\n instanceable = true\n references = @./rig_z.usda@\n) {}'
    )
    message = refused(path)
    assert "holds 2 rigs (/World/Env, /Other), whose light adds up; expected one." in message
    assert message.endswith("Name the one to read: --rig /World/Env.")
    with pytest.raises(InputError, match="/World holds no lobes; /World/Env, /Other does"):
        read_usd(path, "/World")
    for command in (["info", "--json"], ["export", "--to", "json", "-o", str(folder / "l.json")]):
        assert main([command[0], str(path), *command[1:], "--rig", RIG]) == 0
    assert "lights beside it are not read (1 DomeLight, 4 RectLight)" in capsys.readouterr().err
    assert_alike(read_usd(path, RIG), read_usd(folder / "rig_y.usda"))


def test_info_eval_and_export_agree(folder, capsys):
    path = SHOTS["z-up, on its side"](folder)
    lobes = folder / "lobes.json"
    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main(["export", str(path), "--to", "json", "-o", str(lobes)]) == 0
    tracks = read_usd(path)
    x, y, z = read_usd(folder / "rig_y.usda").lobes.axis_z.unbind(-1)
    wanted = torch.stack([x, z, -y], -1)
    np.testing.assert_allclose(tracks.lobes.axis_z, wanted, atol=1e-6)
    flux = asg.flux(tracks.lobes).sum(-1, keepdim=True)
    mean = torch.nn.functional.normalize((flux * tracks.lobes.axis_z).sum(0), dim=-1)
    for row, axis in zip(told["lobes"], mean, strict=True):
        np.testing.assert_allclose(row["direction"], axis, atol=1e-4)
    from asglight.export.track_file import read_json

    assert_alike(read_json(lobes), tracks)


@pytest.mark.parametrize("name", ["turned", "mirrored", "z-up, corrected", "z-up, on its side"])
def test_a_layer_of_edits_over_a_shot_is_what_was_edited(name, folder):
    path = SHOTS[name](folder)
    tracks = read_usd(path)
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 2] *= 3
    lobes.axes[:, 2] = lobes.axes[:, 1]
    edits = LobeTracks(tracks.frames, tracks.fps, lobes, tracks.metadata, tracks.names)
    write_edit_layer(folder / "edit.usda", path, edits, [2])
    found = read_usd(folder / "edit.usda")
    np.testing.assert_allclose(found.lobes.axis_z, lobes.axis_z, atol=1e-5)
    np.testing.assert_allclose(found.lobes.amplitude, lobes.amplitude, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "fault"),
    [("instance", "is an instance, in which USD heeds no edit"), ("uneven", "is scaled unevenly")],
)
def test_a_layer_of_edits_refuses_a_rig_that_takes_none(name, fault, folder):
    path = shot(folder, body=UNEVEN) if name == "uneven" else SHOTS[name](folder)
    tracks = read_usd(path)
    with pytest.raises(InputError, match=f"{RIG} {fault}.*Edit the stage that holds it"):
        write_edit_layer(folder / "edit.usda", path, tracks, [0])


def test_a_stage_made_of_a_shot_has_the_up_axis_of_the_shot(folder):
    path = SHOTS["z-up, corrected"](folder)
    assert read_options(path).up_axis == "Z"
    assert main(["stitch", str(path), "-o", str(folder / "anew.usda")]) == 0
    assert_alike(read_usd(folder / "anew.usda"), read_usd(path))


def test_a_rig_without_extent_is_refused(folder):
    path = shot(folder, body=op("scale", "(1, 0, 1)"))
    assert "/World/Env has no extent, or no end, at frame 1001" in refused(path)


def test_colours_that_a_light_states_otherwise_are_converted(folder):
    path = shot(
        folder,
        body=under(
            "float inputs:intensity = 1\nfloat inputs:width = 50\nfloat inputs:height = 50\n"
            'color3f inputs:color = (1, 0.5, 0.25) (\ncolorSpace = "lin_ap1_scene"\n)'
        ),
    )
    amplitude = read_usd(path).lobes.amplitude[0, 2].double().numpy()
    # AP1 to Rec.709 with white adapted by Bradford, as the ACES documents list it
    matrix = np.array(
        [
            [1.70505, -0.62179, -0.08326],
            [-0.13026, 1.14080, -0.01055],
            [-0.02400, -0.12897, 1.15297],
        ]
    )
    wanted = matrix @ [1, 0.5, 0.25]
    np.testing.assert_allclose(amplitude / amplitude[0], wanted / wanted[0], rtol=1e-3)
