# SPDX-License-Identifier: Apache-2.0
"""The stage as other programs meet it: layout, validators, size, no plugin."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdValidation
from usd_tracks import beginning, contents, moving, of_every_kind, still, write_every
from written_stages import calm, selected

from asglight.lobes import Form
from asglight.usd import StageOptions, lint_stage, read_usd, write_usd
from asglight.usd.lights import cards
from asglight.usd.options import OF_LOBES
from asglight.usd.write import layer


@pytest.mark.parametrize(
    ("form", "extension"), [*((form, "usda") for form in Form), (Form.ASG, "usdc")]
)
def test_all_usd_validators_and_the_own_lint_are_content(extension, form, tmp_path):
    path = tmp_path / f"shot.{extension}"
    write_every(calm(of_every_kind, range(1001, 1004), form), path, dome_height=4)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    for representation in OF_LOBES:
        stage = selected(path, representation)
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
        assert [error.GetErrorAsString() for error in errors] == []
    assert lint_stage(path) == []  # of every representation


@pytest.mark.parametrize("representation", OF_LOBES)
def test_the_stage_shows_the_representation_asked_for(representation, tmp_path):
    path = tmp_path / "shot.usdc"
    write_every(
        calm(of_every_kind, range(3)), path, representation=str(representation), dome_height=4
    )
    stage = Usd.Stage.Open(str(path))
    lights = {
        str(prim.GetPath().MakeRelativePath("/AsgRig")): prim.GetTypeName()
        for prim in stage.Traverse()
        if prim.HasAPI(UsdLux.LightAPI)
    }
    soft = [f"Lobes/lobe_01/{name}" for name in ("tall", "wide", "outer")]
    wanted = {
        "cards": dict.fromkeys([*soft, "Lobes/lobe_02"], "RectLight") | {"Fill": "DomeLight"},
        "distant": {f"Lobes/lobe_0{index}": "DistantLight" for index in range(3)},
        "dome": {"Dome": "DomeLight"},
    }
    assert lights == wanted[representation]


@pytest.fixture(scope="module")
def in_motion(tmp_path_factory):
    """Return tracks and a stage of every representation."""
    tracks = calm(moving, range(1001, 1005))
    path = tmp_path_factory.mktemp("motion") / "shot.usda"
    write_every(tracks, path, dome_height=4)
    return tracks, path


@pytest.mark.parametrize("representation", OF_LOBES)
def test_the_lobes_are_the_same_in_every_representation(representation, in_motion):
    tracks, path = in_motion
    stage = selected(path, representation)
    lobes = stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()
    assert [lobe.GetName() for lobe in lobes] == ["lobe_00", "lobe_01", "lobe_02"]
    for index, lobe in enumerate(lobes):
        matrix = UsdGeom.XformCache(1003).GetLocalToWorldTransform(lobe).ExtractRotationMatrix()
        axis_z = tracks.at(1003).axis_z[index]
        np.testing.assert_allclose(np.array(matrix)[2], axis_z, atol=1e-6)
        amplitude = lobe.GetAttribute("asg:amplitude").Get(1003)
        np.testing.assert_allclose(amplitude, tracks.at(1003).amplitude[index], rtol=1e-6)
        assert lobe.GetAttribute("asg:form").Get() == "asg"


def test_cards_stand_at_the_distance_and_the_unit_asked_for(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(still(), path, distance=50.0, meters_per_unit=0.01)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    lights = [prim for prim in stage.Traverse() if prim.GetTypeName() == "RectLight"]
    assert len(lights) > 3
    for light in lights:
        place = UsdGeom.XformCache(1001).GetLocalToWorldTransform(light).ExtractTranslation()
        # the second and the third card of a lobe stand 1 and 2 thousandths behind the first
        assert 50 * (1 - 1e-6) < place.GetLength() < 50 * 1.0021


def test_black_lobes_are_lights_of_no_intensity(tmp_path):
    tracks = still(((5e3, 4e3), (20.0, 5.0)))
    tracks.lobes.amplitude[0, 0] = 0
    write_usd(tracks, tmp_path / "shot.usda", representations=("cards",))
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    light = UsdLux.LightAPI(stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00"))
    assert light.GetIntensityAttr().Get() == 0
    assert light.GetColorAttr().Get() == (1, 1, 1)


def test_a_track_that_never_moves_has_no_samples_and_one_image(tmp_path):
    frozen = moving([1001, 1001 + 1])
    for values in (frozen.lobes.axes, frozen.lobes.sharpness, frozen.lobes.amplitude):
        values[1] = values[0]
    report = write_every(frozen, tmp_path / "shot.usda", dome_height=4)
    assert "timeSamples" not in (tmp_path / "shot.usda").read_text()
    assert [file.name for file in report.files] == ["shot.usda", "shot.1001.exr"]
    assert report.samples_written == 0


def test_the_dome_has_one_image_a_frame_beside_the_stage(tmp_path):
    held = ("cards", "dome")
    report = write_usd(
        moving([8, 9, 12]), tmp_path / "shot.v2.usda", representations=held, dome_height=4
    )
    names = ["shot.v2.0008.exr", "shot.v2.0009.exr", "shot.v2.0012.exr"]
    assert sorted(contents(tmp_path)) == ["shot.v2.usda", *(f"shot.v2_dome/{n}" for n in names)]
    assert [str(file.relative_to(tmp_path)) for file in report.files] == [
        "shot.v2.usda",
        *(f"shot.v2_dome/{name}" for name in names),
    ]
    assert report.bytes == sum(map(len, contents(tmp_path).values()))
    opened = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "shot.v2.usda"))
    texture = "/AsgRig{representation=dome}Dome.inputs:texture:file"
    assert opened.ListTimeSamplesForPath(texture) == [8, 9, 12]
    assert opened.QueryTimeSample(texture, 12).path == "./shot.v2_dome/shot.v2.0012.exr"


def test_the_report_counts_the_samples_of_the_stage(tmp_path):
    report = write_every(moving(range(20)), tmp_path / "shot.usda", dome_height=2)
    opened = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "shot.usda"))
    found = 0

    def count(path: Sdf.Path) -> None:
        nonlocal found
        found += opened.GetNumTimeSamplesForPath(path)

    opened.Traverse("/", count)
    assert report.samples_written == found
    attributes = 3 * (3 + 3 * 4 + 3) + 1
    at_frames = report.samples_written - report.samples_between
    assert at_frames + report.samples_left_out == 20 * attributes


@pytest.mark.parametrize("name", ["SHOT.USDA", "sh ot@1 größe 50%.usdc", "a[1].usd", ".usdx.usda"])
def test_names_of_every_kind_work(name, tmp_path):
    path = tmp_path / name
    write_usd(moving(range(3)), path, representations=("dome",), dome_height=2)
    stage = Usd.Stage.Open(str(path))
    texture = stage.GetPrimAtPath("/AsgRig/Dome").GetAttribute("inputs:texture:file")
    assert Path(texture.Get(2).resolvedPath).samefile(
        tmp_path / f"{path.stem}_dome" / f"{path.stem}.0002.exr"
    )
    assert read_usd(path).frames == (0, 1, 2)


@pytest.mark.parametrize(("jitter", "megabytes"), [(0.0, 0.22), (0.1, 1.3)])
def test_a_long_shot_stays_small(jitter, megabytes, tmp_path):
    """15 lobes in 200 of 1000 frames, with both kinds of light and the paths of the dome's images.

    All lobes have three cards, the most there is. Where every sample is needed, such a lobe takes
    160 bytes a frame (docs/reference/stage.md), which no tolerance below the noise makes less; a
    tenth of noise in every size and light of every frame takes 1.5 times as much between frames.
    """
    whole = moving(range(1000), lobes=15, jitter=jitter)
    tracks = beginning(whole, 200)
    images = layer.Images([f"./shot_dome/shot.{frame:04d}.exr" for frame in tracks.frames])
    kinds = cards.kinds(whole.lobes)
    options = StageOptions(representations=OF_LOBES)
    built, _ = layer.build(tracks, options, images, "shot.usdc", kinds)
    built.Export(str(tmp_path / "shot.usdc"))
    assert (tmp_path / "shot.usdc").stat().st_size < megabytes * 1e6


def test_without_the_plugin_the_stage_opens_in_silence(tmp_path):
    path = tmp_path / "shot.usdc"
    write_usd(calm(moving, range(3)), path, representations=("distant", "dome"), dome_height=2)
    code = (
        "from pxr import Usd; import sys; s = Usd.Stage.Open(sys.argv[1]);"
        "lobe = s.GetPrimAtPath('/AsgRig/Lobes/lobe_00');"
        "print(lobe.GetAttribute('asg:sharpness').Get(1)[0] > 0)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
    result = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert (result.stdout.strip(), result.stderr) == ("True", "")


def test_the_other_rooms_never_load_usd():
    code = (
        "import sys, asglight.lobes, asglight.lobes.asg, asglight.lobes.texels, asglight.images,"
        "asglight.sphere.latlong; print('pxr' in sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"
