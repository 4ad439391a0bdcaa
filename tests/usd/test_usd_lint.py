# SPDX-License-Identifier: Apache-2.0
"""Each rule of the stage contract, broken once: the lint says exactly that and nothing else."""

import re
from pathlib import Path

import pytest
from pxr import Gf, Sdf
from usd_tracks import edited, moving, write_every

from asglight.errors import InputError
from asglight.usd import lint_stage

LOBE = "/AsgRig/Lobes/lobe_01"
CARD = "/AsgRig{representation=cards}Lobes/lobe_02"
DISTANT = "/AsgRig{representation=distant}Lobes/lobe_01"
DOME = "/AsgRig{representation=dome}Dome"


def value(path: str, new: object):
    """Return an edit that sets an attribute's default."""

    def edit(layer: Sdf.Layer) -> None:
        layer.GetAttributeAtPath(path).default = new

    return edit


def sample(path: str, frame: int, new: object):
    return lambda layer: layer.SetTimeSample(path, frame, new)


def author(prim: str, name: str, kind: Sdf.ValueTypeName, new: object):
    def edit(layer: Sdf.Layer) -> None:
        Sdf.AttributeSpec(layer.GetPrimAtPath(prim), name, kind).default = new

    return edit


def set_field(name: str, new: object):
    return lambda layer: setattr(layer, name, new)


def clear(name: str):
    return lambda layer: layer.pseudoRoot.ClearInfo(name)


def scale(layer: Sdf.Layer) -> None:
    author("/AsgRig", "xformOp:scale", Sdf.ValueTypeNames.Float3, Gf.Vec3f(2))(layer)
    rig = layer.GetPrimAtPath("/AsgRig")
    order = Sdf.AttributeSpec(
        rig, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform
    )
    order.default = ["xformOp:scale"]


def remove_default(layer: Sdf.Layer) -> None:
    layer.GetAttributeAtPath(f"{CARD}.inputs:intensity").ClearDefaultValue()


def remove_api(layer: Sdf.Layer) -> None:
    layer.GetPrimAtPath(LOBE).ClearInfo("apiSchemas")


def remove_selection(layer: Sdf.Layer) -> None:
    del layer.GetPrimAtPath("/AsgRig").variantSelections["representation"]


def remove_variant(layer: Sdf.Layer) -> None:
    variants = layer.GetPrimAtPath("/AsgRig").variantSets["representation"]
    for name in ("cards", "distant", "dome"):
        variants.RemoveVariant(variants.variants[name])


def remove_lobes(layer: Sdf.Layer) -> None:
    layer.GetPrimAtPath("/AsgRig/Lobes").name = "Lights"


def empty_lobes(layer: Sdf.Layer) -> None:
    for scope in ("/AsgRig/", *(f"/AsgRig{{representation={v}}}" for v in ("cards", "distant"))):
        lobes = layer.GetPrimAtPath(f"{scope}Lobes")
        for name in list(lobes.nameChildren.keys()):
            del lobes.nameChildren[name]


def second_light(layer: Sdf.Layer) -> None:
    variant = layer.GetPrimAtPath("/AsgRig{representation=dome}")
    Sdf.PrimSpec(variant, "Sun", Sdf.SpecifierDef, "DistantLight")


def no_light(layer: Sdf.Layer) -> None:
    layer.GetPrimAtPath(CARD).typeName = "Xform"
    del layer.GetPrimAtPath(CARD).properties["inputs:normalize"]


BREAKS = {
    "default prim": (clear("defaultPrim"), r"^/: defaultPrim is ''; expected AsgRig$"),
    "up axis": (clear("upAxis"), "^/: upAxis is 'Y'; expected an explicit Y, as the lobes have$"),
    "z up": (lambda la: la.pseudoRoot.SetInfo("upAxis", "Z"), "^/: upAxis is 'Z'; expected"),
    "unit": (clear("metersPerUnit"), "^/: metersPerUnit is not authored"),
    "frame rate": (
        set_field("framesPerSecond", 25.0),
        r"^/: timeCodesPerSecond and framesPerSecond are \(24.0, 25.0\)",
    ),
    "no frame rate": (clear("timeCodesPerSecond"), "^/: timeCodesPerSecond and framesPerSecond"),
    "no range": (clear("endTimeCode"), "^/: startTimeCode or endTimeCode is not authored"),
    "range": (
        set_field("endTimeCode", 1009),
        "^/: time codes run from 1001 to 1009, samples from 1001 to 1006; expected the same range",
    ),
    "default": (
        remove_default,
        f"^{CARD}.inputs:intensity: time samples without a default; expected both$",
    ),
    "nan": (
        sample(f"{LOBE}.asg:sharpness", 1003, Gf.Vec2f(float("nan"), 2)),
        rf"^{LOBE}.asg:sharpness: is \(nan, 2\); expected finite numbers$",
    ),
    "infinite default": (
        value(f"{DISTANT}.inputs:intensity", float("inf")),
        f"^{DISTANT}.inputs:intensity: is inf; expected finite numbers$",
    ),
    "nan in a quaternion": (
        sample(f"{LOBE}.xformOp:orient", 1002, Gf.Quatf(1, 0, float("nan"), 0)),
        f"^{LOBE}.xformOp:orient: is .*nan.*; expected finite numbers$",
    ),
    "color": (
        value(f"{CARD}.inputs:color", Gf.Vec3f(0, 1.5, 0)),
        rf"^{CARD}.inputs:color: is \(0, 1.5, 0\); expected 0 to 1$",
    ),
    "intensity": (
        sample(f"{DISTANT}.inputs:intensity", 1004, -1.0),
        f"^{DISTANT}.inputs:intensity: is -1.0; expected 0 to inf$",
    ),
    "angle": (
        sample(f"{DISTANT}.inputs:angle", 1004, 200.0),
        f"^{DISTANT}.inputs:angle: is 200.0; expected 0 to 180$",
    ),
    "scale": (scale, "^/AsgRig.xformOpOrder: xformOp:scale; expected translation and rotation"),
    "normalized card": (
        value(f"{CARD}.inputs:normalize", True),
        f"^{CARD}.inputs:normalize: is True; expected False on a RectLight$",
    ),
    "plain distant": (
        value(f"{DISTANT}.inputs:normalize", False),
        f"^{DISTANT}.inputs:normalize: is False; expected True on a DistantLight$",
    ),
    "exposure": (
        author(CARD, "inputs:exposure", Sdf.ValueTypeNames.Float, 1.0),
        f"^{CARD}.inputs:exposure: is 1.0; expected no exposure",
    ),
    "format": (
        value(f"{DOME}.inputs:texture:format", "automatic"),
        f"^{DOME}.inputs:texture:format: is 'automatic'; expected 'latlong'$",
    ),
    "absolute path": (
        value(f"{DOME}.inputs:texture:file", Sdf.AssetPath("/sky.exr")),
        f"^{DOME}.inputs:texture:file: is /sky.exr; expected a path relative to the stage$",
    ),
    "search path": (
        value(f"{DOME}.inputs:texture:file", Sdf.AssetPath("sky.exr")),
        f"^{DOME}.inputs:texture:file: is sky.exr; expected a path relative to the stage$",
    ),
    "missing image": (
        sample(f"{DOME}.inputs:texture:file", 1003, Sdf.AssetPath("./sky.exr")),
        f"^{DOME}.inputs:texture:file: is ./sky.exr at frame 1003, which is not there; expected",
    ),
    "api": (remove_api, f"^{LOBE}: without AsgLobeAPI; expected it on every lobe$"),
    "selection": (remove_selection, "^/AsgRig: selects ''; expected one representation$"),
    "variant": (remove_variant, "^/AsgRig: shows no representation; expected one of cards, "),
    "lobes": (remove_lobes, "^/: no prim with Lobes; expected /AsgRig$"),
    "no lobes": (empty_lobes, "^/AsgRig/Lobes: empty; expected lobes$"),
    "second light": (second_light, "^/AsgRig/Sun: is a DistantLight in dome; expected only DomeL"),
    "no light": (no_light, "^/AsgRig/Lobes/lobe_02: no light in cards; expected a RectLight$"),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "shot.usda"
    tracks = moving(range(1001, 1007), jitter=0.1)
    tracks.lobes.sharpness[:, 2] *= 500  # one card
    write_every(tracks, path, dome_height=2)
    assert lint_stage(path) == []
    return path


@pytest.mark.parametrize("name", BREAKS)
def test_a_broken_rule_is_the_one_finding(name, sound):
    edit, message = BREAKS[name]
    before = sound.read_bytes()
    try:
        findings = lint_stage(edited(sound, edit))
    finally:
        sound.write_bytes(before)
    assert len(findings) == 1, findings
    assert re.search(message, findings[0]), findings[0]
    assert "\n" not in findings[0]


def test_a_file_that_is_no_stage_cannot_be_checked(tmp_path):
    (tmp_path / "shot.usda").write_text("hello")
    with pytest.raises(InputError, match="not readable as USD"):
        lint_stage(tmp_path / "shot.usda")
