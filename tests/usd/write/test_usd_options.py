# SPDX-License-Identifier: Apache-2.0
"""Each way to write a stage: another path, unit, colour or package shows and reads the same."""

import itertools
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdUtils, UsdValidation
from usd_tracks import (
    assert_same,
    beginning,
    contents,
    edited,
    moving,
    of_every_kind,
    still,
    write_every,
)
from written_stages import calm, put_every

from asglight.errors import InputError
from asglight.images import read_latlong
from asglight.lobes import LobeTracks
from asglight.usd import (
    StageOptions,
    lint_stage,
    read_usd,
    write_edit_layer,
    write_usd,
)
from asglight.usd.options import OF_LOBES
from asglight.usd.read.read_options import read_options

FRAMES = (1001, 1002, 1005)
EVERYTHING = {
    "representations": ("distant", "cards", "dome"),
    "distance": 50.0,
    "dome_height": 8,
    "meters_per_unit": 0.01,
    "up_axis": "Z",
    "primary_path": "/World/Lights/Env",
    "colorspace": "lin_ap1_scene",
    "distant_lights": 3,
}


def validated(path: Path) -> list[str]:
    """Return what USD's validators and the own lint say, for every representation."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = lint_stage(path)
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    rig = stage.GetPrimAtPath(read_options(path).primary_path)
    for representation in OF_LOBES:
        rig.GetVariantSet("representation").SetVariantSelection(str(representation))
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
        found += [error.GetErrorAsString() for error in errors]
    return found


def irradiance(path: Path, normal: Gf.Vec3d) -> np.ndarray:
    """Return what a patch at the origin gets from the distant lights, in the stage's numbers."""
    stage = Usd.Stage.Open(str(path))
    total = np.zeros(3)
    for prim in stage.Traverse():
        if prim.IsA(UsdLux.DistantLight):
            light, world = UsdLux.DistantLight(prim), UsdGeom.XformCache(1002)
            axis = world.GetLocalToWorldTransform(prim).TransformDir(Gf.Vec3d(0, 0, 1))
            share = max(axis * normal, 0.0) * light.GetIntensityAttr().Get(1002)
            total += share * np.array(light.GetColorAttr().Get(1002))
    return total


@pytest.mark.parametrize("extension", ["usda", "usdc", "usdz"])
def test_a_stage_with_every_option_comes_back_and_validates(extension, tmp_path):
    path = tmp_path / f"shot.{extension}"
    tracks = calm(moving, FRAMES)
    write_every(tracks, path, **EVERYTHING)
    assert_same(read_usd(path), tracks)
    assert read_options(path) == StageOptions(**EVERYTHING)
    assert validated(path) == []


def test_the_primary_path_holds_the_lobes_below_xforms(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(of_every_kind, FRAMES), path, primary_path="/World/Lights/Env")
    stage = Usd.Stage.Open(str(path))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    above = [stage.GetPrimAtPath(p).GetTypeName() for p in ("/World", "/World/Lights")]
    assert above == ["Xform", "Xform"]
    lobes = stage.GetPrimAtPath("/World/Lights/Env/Lobes").GetChildren()
    assert [lobe.GetTypeName() for lobe in lobes] == ["Xform", "Xform", "RectLight"]
    assert stage.GetPrimAtPath("/World/Lights/Env/Fill").GetTypeName() == "DomeLight"
    assert not stage.GetPrimAtPath("/AsgRig")


def test_a_rig_is_found_where_a_shot_refers_to_it(tmp_path):
    chosen = {"representations": ("distant", "dome"), "dome_height": 2}
    write_usd(calm(moving, FRAMES), tmp_path / "env.usdc", primary_path="/World/Env", **chosen)
    (tmp_path / "shot.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "Shot"\n startTimeCode = 1001\n endTimeCode = 1005\n)\n'
        'def Xform "Shot"\n{\ndef "Set" (prepend references = @./env.usdc@</World>)\n{\n}\n}\n'
    )
    assert_same(read_usd(tmp_path / "shot.usda"), calm(moving, FRAMES))
    assert read_options(tmp_path / "shot.usda").primary_path == "/Shot/Set/Env"


def test_cards_stand_a_kilometre_away_in_any_unit(tmp_path):
    for unit in (1.0, 0.01, 0.0254):
        path = tmp_path / f"shot_{unit}.usda"
        write_usd(calm(of_every_kind, FRAMES), path, meters_per_unit=unit)
        stage = Usd.Stage.Open(str(path))
        lobe = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_02")
        place = UsdGeom.XformCache(1002).GetLocalToWorldTransform(lobe).ExtractTranslation()
        # float32 quaternions
        assert place.GetLength() * unit == pytest.approx(1000.0, rel=1e-6)
        angle = UsdLux.RectLight(lobe).GetWidthAttr().Get(1002) * unit
        if unit == 1.0:
            first = angle
        assert angle == pytest.approx(first, rel=1e-6)


def test_the_rig_says_which_asset_it_is(tmp_path):
    path = tmp_path / "shot.v3.usdc"
    write_usd(calm(moving, FRAMES), path, representations=("dome",), dome_height=2)
    stage = Usd.Stage.Open(str(path))
    rig = Usd.ModelAPI(stage.GetDefaultPrim())
    assert rig.GetAssetName() == "shot.v3"
    assert Path(rig.GetAssetIdentifier().resolvedPath).samefile(path)
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(path)))
    assert [Path(layer.realPath).name for layer in layers] == ["shot.v3.usdc"]
    assert sorted(Path(asset).name for asset in assets) == [f"shot.v3.{f}.exr" for f in FRAMES]
    assert unresolved == []


# ---- colour ----

PRIMARIES = {
    "lin_ap1_scene": ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767)),
    "lin_ap0_scene": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), (0.32168, 0.33767)),
    "lin_rec2020_scene": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290)),
    "lin_p3d65_scene": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.3127, 0.3290)),
    "lin_adobergb_scene": ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), (0.3127, 0.3290)),
}
REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def xyz_matrix(primaries) -> np.ndarray:
    """Return RGB to XYZ after SMPTE RP 177: columns scaled so that they sum to the white."""
    columns = np.array([[x / y, 1.0, (1 - x - y) / y] for x, y in primaries]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])


def closed_form(space: str) -> np.ndarray:
    """Return Rec.709 to a space, the whites adapted with Bradford's cone responses (Lam 1985)."""
    source, target = xyz_matrix(REC709), xyz_matrix(PRIMARIES[space])
    white = [BRADFORD @ matrix.sum(1) for matrix in (source, target)]
    adapt = np.linalg.inv(BRADFORD) @ np.diag(white[1] / white[0]) @ BRADFORD
    return np.linalg.inv(target) @ adapt @ source


@pytest.mark.parametrize("space", PRIMARIES)
def test_the_stage_shows_the_same_light_in_the_primaries_asked_for(space, tmp_path):
    tracks = calm(moving, FRAMES)
    chosen = {"representations": ("distant", "dome"), "dome_height": 8}
    for path, name in (("plain.usda", "Rec.709"), ("other.usda", space)):
        put_every(tracks, tmp_path / path, colorspace=name, **chosen)
    stage = Usd.Stage.Open(str(tmp_path / "other.usda"))
    found = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_01").GetAttribute("asg:amplitude").Get(1002)
    wanted = closed_form(space) @ tracks.at(1002).amplitude[1].double().numpy()
    # OpenColorIO's matrices are float32, and so are the samples
    np.testing.assert_allclose(found, wanted, rtol=2e-6)
    normal = Gf.Vec3d(0.36, 0.48, 0.8)
    plain, other = (irradiance(tmp_path / f"{stem}.usda", normal) for stem in ("plain", "other"))
    # each of intensity, colour and their samples left out may be off by 2e-5
    np.testing.assert_allclose(other, closed_form(space) @ plain, rtol=1e-4)
    images = [tmp_path / f"{stem}_dome" / f"{stem}.1002.exr" for stem in ("plain", "other")]
    plain, other = (read_latlong(image) for image in images)
    assert plain.header.colour.is_rec709
    assert not other.header.colour.is_rec709
    # two half floats, one of them of a component that others cancel in; they step by 6e-8 at 0
    scale = plain.radiance.amax(-1, keepdim=True).expand_as(plain.radiance)
    assert bool(((other.radiance - plain.radiance).abs() <= 4e-3 * scale + 3e-7).all())


@pytest.mark.parametrize("space", ["lin_rec709_scene", *PRIMARIES])
def test_usd_is_told_the_space_and_knows_it(space, tmp_path):
    path = tmp_path / "shot.usda"
    tracks = still()
    write_usd(tracks, path, colorspace=space, representations=("distant",))
    stage = Usd.Stage.Open(str(path))
    lobe = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00")
    amplitude = lobe.GetAttribute("asg:amplitude")
    assert Usd.ColorSpaceAPI.ComputeColorSpaceName(amplitude, None) == space
    assert Gf.ColorSpace.IsValid(space)
    back = read_usd(path).lobes.amplitude
    # to the rounding of each lobe's largest component, for the small ones cancel
    scale = tracks.lobes.amplitude.amax(-1, keepdim=True).expand_as(back)
    assert bool(((back - tracks.lobes.amplitude).abs() <= 1e-6 * scale).all())
    assert float(back.min()) >= 0


@pytest.mark.parametrize(
    ("name", "space"),
    [
        ("ACEScg", "lin_ap1_scene"),
        ("acescg", "lin_ap1_scene"),
        ("ACES - ACEScg", "lin_ap1_scene"),
        ("ACES2065-1", "lin_ap0_scene"),
        ("Rec.2020", "lin_rec2020_scene"),
        ("lin_rec2020", "lin_rec2020_scene"),
        ("p3-d65", "lin_p3d65_scene"),
        ("lin_displayp3", "lin_p3d65_scene"),
        ("Linear AdobeRGB", "lin_adobergb_scene"),
        ("Utility - Linear - sRGB", "lin_rec709_scene"),
    ],
)
def test_a_space_has_many_names(name, space, tmp_path, monkeypatch):
    monkeypatch.setenv("OCIO", str(tmp_path / "of-the-studio.ocio"))  # not there, and not asked
    write_usd(still(), tmp_path / "shot.usda", colorspace=name, representations=("dome",))
    assert read_options(tmp_path / "shot.usda").colorspace == space


def test_an_unknown_space_in_a_stage_is_named(tmp_path):
    path = tmp_path / "shot.usda"
    write_every(still(), path, dome_height=2)
    place = "/AsgRig.colorSpace:name"
    edited(path, lambda layer: setattr(layer.GetAttributeAtPath(place), "default", "g22_ap1"))
    with pytest.raises(InputError, match=rf"shot.usda: {place} is g22_ap1; expected one of lin_re"):
        read_usd(path)


def test_a_light_outside_rec709_comes_back_without_its_negative_part(tmp_path):
    path = tmp_path / "shot.usda"
    write_every(still(), path, colorspace="ACEScg", dome_height=2)
    place = "/AsgRig/Lobes/lobe_00.asg:amplitude"
    green = Gf.Vec3f(0, 1, 0)
    edited(path, lambda layer: setattr(layer.GetAttributeAtPath(place), "default", green))
    red, _, blue = read_usd(path).lobes.amplitude[0, 0].tolist()
    assert (red, blue) == (0, 0)


# ---- packages ----


def test_a_package_holds_its_images_and_nothing_lies_beside_it(tmp_path):
    path = tmp_path / "shot.usdz"
    report = write_usd(
        calm(moving, FRAMES), path, representations=("dome", "distant"), dome_height=8
    )
    assert list(contents(tmp_path)) == ["shot.usdz"]
    assert report.files == (path,)
    assert report.bytes == path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        assert archive.testzip() is None
    images = [f"shot_dome/shot.{frame}.exr" for frame in FRAMES]
    # the format's rules: the layer first, nothing compressed, data aligned to 64 bytes
    assert [entry.filename for entry in entries] == ["shot.usdc", *images]
    assert {entry.compress_type for entry in entries} == {zipfile.ZIP_STORED}
    data = path.read_bytes()
    for entry in entries:
        lengths = data[entry.header_offset + 26 : entry.header_offset + 30]
        name, extra = (int.from_bytes(lengths[k : k + 2], "little") for k in (0, 2))
        assert (entry.header_offset + 30 + name + extra) % 64 == 0
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    path.rename(moved / "other.usdz")
    assert lint_stage(moved / "other.usdz") == []


def test_a_package_is_replaced_whole(tmp_path):
    path = tmp_path / "shot.usdz"
    chosen = {"representations": ("distant", "dome"), "dome_height": 2}
    write_usd(calm(moving, range(5)), path, **chosen)
    held = Usd.Stage.Open(str(path))
    write_usd(calm(moving, FRAMES, seed=1), path, **chosen)
    assert_same(read_usd(path), calm(moving, FRAMES, seed=1))
    assert held.GetDefaultPrim()


def test_a_package_can_be_edited_in_a_layer_over_it(tmp_path):
    path = tmp_path / "shot.usdz"
    write_every(calm(moving, FRAMES), path, **EVERYTHING)
    tracks = read_usd(path)
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 1] *= 2
    after = replace(tracks, lobes=lobes)
    layer = tmp_path / "edit.usda"
    write_edit_layer(layer, path, after, [1])
    assert_same(read_usd(layer), after)
    assert read_options(layer) == StageOptions(**EVERYTHING)
    assert validated(layer) == []


def test_an_image_missing_from_a_package_is_found(tmp_path):
    path = tmp_path / "shot.usdz"
    write_usd(calm(moving, FRAMES), path, representations=("distant", "dome"), dome_height=2)
    with zipfile.ZipFile(path) as archive:
        layer = archive.read("shot.usdc")
    (tmp_path / "shot.usdc").write_bytes(layer)
    with Sdf.ZipFileWriter.CreateNew(str(path)) as writer:
        writer.AddFile(str(tmp_path / "shot.usdc"), "shot.usdc")
    findings = lint_stage(path)
    assert len(findings) == 4  # the default and three frames
    assert "is ./shot_dome/shot.1001.exr, which is not there; expected an image" in findings[0]


# ---- a layer of edits ----


@pytest.mark.parametrize(
    "names",
    [
        ("representations", "primary_path", "colorspace", "distant_lights"),
        ("distance", "meters_per_unit", "up_axis", "dome_height"),
    ],
    ids=", ".join,
)
def test_a_layer_of_edits_keeps_the_options_of_its_stage(names, tmp_path):
    options = {"dome_height": 4, **{name: EVERYTHING[name] for name in names}}
    write_every(calm(moving, FRAMES), tmp_path / "fit.usda", **options)
    tracks = read_usd(tmp_path / "fit.usda")
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 1] *= torch.tensor([3.0, 2.0, 1.0])
    lobes.axes[:, 2] = lobes.axes[:, 0]
    after = replace(tracks, lobes=lobes)
    write_edit_layer(tmp_path / "edit.usda", tmp_path / "fit.usda", after, [1, 2])
    write_every(after, tmp_path / "direct.usda", **options)
    assert read_options(tmp_path / "edit.usda") == read_options(tmp_path / "fit.usda")
    assert_same(read_usd(tmp_path / "edit.usda"), after)
    assert validated(tmp_path / "edit.usda") == []
    stages = [Usd.Stage.Open(str(tmp_path / f"{stem}.usda")) for stem in ("edit", "direct")]
    for one, other in zip(*(stage.Traverse() for stage in stages), strict=True):
        assert one.GetPath() == other.GetPath()
        for name in one.GetPropertyNames():
            value, wanted = (p.GetAttribute(name).Get(1002) for p in (one, other))
            if isinstance(wanted, float | Gf.Vec3f | Gf.Vec2f):
                # twice the light's tolerance of samples left out, and rounding
                np.testing.assert_allclose(value, wanted, rtol=1e-4, err_msg=f"{one} {name}")


def test_every_pair_of_options_reads_back(tmp_path):
    """Six stages show every pair in each of its four ways, with either, both and neither.

    Each option is in three of five stages, no two of them in the same three: any two threes of five
    have one in common, and each has one that the other lacks (pairwise covering).
    """
    tracks = beginning(moving(range(1001, 1011)), 2)
    held = dict(zip(EVERYTHING, itertools.combinations(range(5), 3), strict=False))
    assert held.keys() == EVERYTHING.keys()
    for number in range(6):
        options = {name: EVERYTHING[name] for name in EVERYTHING if number in held[name]}
        chosen = {"dome_height": 2} | options
        write_every(tracks, tmp_path / "shot.usda", **chosen)
        assert_same(read_usd(tmp_path / "shot.usda"), tracks)


# ---- names ----


def test_names_of_lobes_are_kept(tmp_path):
    moved = calm(moving, FRAMES)
    names = ("lobe_07", "key", "lobe_00")
    tracks = LobeTracks(moved.frames, moved.fps, moved.lobes, moved.metadata, names)
    write_usd(tracks, tmp_path / "shot.usda", representations=("cards",))
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    prims = stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()
    assert tuple(prim.GetName() for prim in prims) == names
    assert read_usd(tmp_path / "shot.usda").names == names


def test_a_name_that_no_prim_can_have_is_refused(tmp_path):
    tracks = replace(calm(moving, FRAMES), names=("a b", "c", "d"))
    with pytest.raises(InputError, match="tracks: lobes are called a b, c, d; expected names of"):
        write_every(tracks, tmp_path / "shot.usda")
