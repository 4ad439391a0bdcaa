# SPDX-License-Identifier: Apache-2.0
"""What cannot be read is refused in one line that names the file and the place."""

import re
from pathlib import Path

import pytest
from pxr import Gf, Sdf, Usd, Vt
from usd_tracks import edited, moving, write_every

from asglight.errors import InputError
from asglight.usd import read_usd, write_usd
from asglight.usd.read.between import samples_between
from asglight.usd.read.read_options import read_options

LOBE = "/AsgRig/Lobes/lobe_01"


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "shot.usda"
    write_every(moving([1001, 1003, 1005], jitter=0.1), path, dome_height=2)
    return path


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_usd(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_a_missing_file_is_named(tmp_path):
    assert "no such file; expected a USD stage" in refused(tmp_path / "shot.usda")


def test_a_folder_is_no_stage(tmp_path):
    assert "is a folder; expected a USD stage" in refused(tmp_path)


@pytest.mark.parametrize("name", ["shot.usda", "shot.usdc", "shot.usd", "shot.exr"])
@pytest.mark.parametrize("data", [b"", b"hello", b"PXR-USDC" + bytes(200)])
def test_a_file_that_is_not_usd_is_named(name, data, tmp_path):
    (tmp_path / name).write_bytes(data)
    assert "not readable as USD" in refused(tmp_path / name)


def test_a_truncated_crate_is_named(tmp_path):
    path = tmp_path / "shot.usdc"
    write_usd(moving(range(10)), path, representations=("distant",))
    path.write_bytes(path.read_bytes()[:-2000])
    assert "not readable as USD" in refused(path)


def test_a_stage_without_lobes_is_named(tmp_path):
    path = tmp_path / "other.usda"
    Sdf.Layer.CreateAnonymous().Export(str(path))
    assert "holds no AsgLobeAPI prim; expected the lobes of a stage that asglight" in refused(path)


def drop(name: str):
    def edit(layer: Sdf.Layer) -> None:
        del layer.GetPrimAtPath(LOBE).properties[name]

    return edit


def change(name: str, value: object):
    return lambda layer: layer.SetTimeSample(f"{LOBE}.{name}", 1003, value)


def retype(layer: Sdf.Layer) -> None:
    drop("asg:sharpness")(layer)
    Sdf.AttributeSpec(layer.GetPrimAtPath(LOBE), "asg:sharpness", Sdf.ValueTypeNames.Double)


def no_api(layer: Sdf.Layer) -> None:
    for lobe in layer.GetPrimAtPath("/AsgRig/Lobes").nameChildren:
        lobe.ClearInfo("apiSchemas")


def form(value: str):
    def edit(layer: Sdf.Layer) -> None:
        layer.GetAttributeAtPath(f"{LOBE}.asg:form").default = value

    return edit


def custom(**values: object):
    def edit(layer: Sdf.Layer) -> None:
        rig = layer.GetPrimAtPath("/AsgRig")
        data = dict(rig.customData["asglight"])
        rig.SetInfo("customData", {"asglight": {**data, **values}})

    return edit


def block(layer: Sdf.Layer) -> None:
    layer.SetTimeSample(f"{LOBE}.asg:amplitude", 1005, Sdf.ValueBlock())


NAN = float("nan")
DAMAGES = {
    "api": (no_api, "holds 9 RectLight, and no AsgLobeAPI prim; expected the lobes of a stage"),
    "missing": (drop("asg:amplitude"), f"{LOBE}.asg:amplitude is missing; expected type color3f"),
    "type": (retype, f"{LOBE}.asg:sharpness is of type double; expected type float2"),
    "blocked": (block, f"{LOBE}.asg:amplitude has no value at frame 1005"),
    "nan": (
        change("asg:sharpness", Gf.Vec2f(NAN, 2)),
        r"is \(nan, 2\) at frame 1003",
    ),
    "sharpness": (change("asg:sharpness", Gf.Vec2f(0, 2)), r"is \(0, 2\) .*numbers above 0"),
    "amplitude": (change("asg:amplitude", Gf.Vec3f(1, -2, 0)), r"is \(1, -2, 0\) .* from 0 up"),
    "orient": (change("xformOp:orient", Gf.Quatf(0)), r"is \(0, 0, 0, 0\) .* a unit quaternion"),
    "form": (form("cone"), "asg:form is asg, cone; expected one of asg, bingham, sg, flat for all"),
    "two forms": (form("sg"), "asg:form is asg, sg; expected one of"),
    "range": (
        lambda la: setattr(la, "endTimeCode", 1000.0),
        "frame range 1001 to 1000; expected startTimeCode at or before endTimeCode",
    ),
    "between": (
        lambda la: (setattr(la, "startTimeCode", 1001.25), setattr(la, "endTimeCode", 1001.5)),
        "frame range 1001.25 to 1001.5; expected .* a whole number from one to the other",
    ),
    "rate": (lambda la: setattr(la, "timeCodesPerSecond", 0.0), "0 time codes a second"),
    "huge": (lambda la: setattr(la, "endTimeCode", 1e9), r"frame range 1001 to 1e\+09"),
    "unit": (
        lambda la: la.pseudoRoot.SetInfo("metersPerUnit", 0.0),
        "metersPerUnit 0; expected a length above 0",
    ),
    "endless frames": (
        custom(frames=Vt.DoubleArray([1001.5, NAN, float("inf")])),
        "damaged frames in the rig's custom data; expected numbers",
    ),
    "no frames": (custom(frames="all"), "damaged frames in the rig's custom data"),
    "version": (custom(version=2), "layout version 2; expected a number up to 1"),
    "no version": (
        lambda la: la.GetPrimAtPath("/AsgRig").ClearInfo("customData"),
        "layout version None; expected a number up to 1",
    ),
    "metadata": (custom(metadata="{"), "the metadata of the rig is damaged"),
    "metadata list": (custom(metadata="[]"), "the metadata of the rig is damaged"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_value_is_named_with_its_place(name, sound):
    edit, message = DAMAGES[name]
    before = sound.read_bytes()
    try:
        found = refused(edited(sound, edit))
    finally:
        sound.write_bytes(before)
    assert re.search(message, found), found


@pytest.mark.parametrize(
    ("lights", "found"),
    [
        ([], "holds no AsgLobeAPI prim; expected the lobes of a stage that asglight wrote"),
        (["DistantLight"], "holds 1 DistantLight, and no AsgLobeAPI prim; expected the lobes"),
        (
            ["RectLight", "RectLight", "DomeLight"],
            "holds 1 DomeLight, 2 RectLight, and no AsgLobeAPI prim; expected the lobes of a",
        ),
    ],
)
def test_a_stage_by_others_is_told_by_what_it_holds(lights, found, tmp_path):
    path = tmp_path / "theirs.usda"
    stage = Usd.Stage.CreateNew(str(path))
    for index, kind in enumerate(lights):
        stage.DefinePrim(f"/World/light_{index}", kind)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError) as caught:
        read_usd(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: {found}")
    assert message.endswith("Fit the environment's images: asglight fit INPUT -o STAGE.")


def test_damaged_metadata_is_told_alike_whatever_is_read(sound):
    edits = {
        "metersPerUnit 0; expected a length above 0": DAMAGES["unit"][0],
        "frame range 1001 to 1000; expected": DAMAGES["range"][0],
    }
    before = sound.read_bytes()
    for message, edit in edits.items():
        path = edited(sound, edit)
        try:
            with pytest.raises(InputError, match=re.escape(message)):
                (samples_between if "range" in message else read_options)(path)
        finally:
            sound.write_bytes(before)
