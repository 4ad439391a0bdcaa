# SPDX-License-Identifier: Apache-2.0
"""A stage with +Z up shows the same light to a scene that stands upright in it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdValidation
from usd_tracks import assert_same, moving, write_every
from written_stages import calm, put_every

from asglight.lobes import Form
from asglight.usd import (
    Representation,
    lint_stage,
    read_stage,
    read_usd,
    write_edit_layer,
    write_usd,
)
from asglight.usd.options import OF_LOBES

FRAMES = (1001, 1002, 1005)

TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From a scene with +Y up to the same one with +Z up: what pointed up does, +X stays."""


def written(folder: Path, form: Form = Form.ASG) -> tuple[Path, Path]:
    paths = folder / "y.usda", folder / "z.usda"
    for path, up_axis in zip(paths, ("Y", "Z"), strict=True):
        put_every(calm(moving, FRAMES, form=form), path, up_axis=up_axis, dome_height=8)
    return paths


def lights(path: Path, representation: Representation) -> dict[str, np.ndarray]:
    """Return the place and orientation of every light at a frame, as pxr composes them."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    rig = stage.GetDefaultPrim()
    rig.GetVariantSet("representation").SetVariantSelection(str(representation))
    cache = UsdGeom.XformCache(FRAMES[1])
    return {
        str(prim.GetPath()): np.array(cache.GetLocalToWorldTransform(prim))
        for prim in stage.Traverse()
        if prim.HasAPI(UsdLux.LightAPI)
    }


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])  # of one side and of two
def test_every_light_is_turned_with_the_scene(form, tmp_path):
    paths = written(tmp_path, form)
    for representation in OF_LOBES:
        y_up, z_up = (lights(path, representation) for path in paths)
        assert y_up.keys() == z_up.keys() != set()
        for name, matrix in y_up.items():  # rows are the images of the local axes, then the place
            np.testing.assert_allclose(
                z_up[name][:, :3],
                matrix[:, :3] @ TO_Z_UP.T,
                # float32 quaternions, and a place 1000 away
                atol=1e-6 * max(1.0, np.abs(matrix[3]).max()),
            )


def test_the_dome_stands_as_usd_itself_would_place_it(tmp_path):
    _, path = written(tmp_path)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    other = UsdLux.DomeLight.Define(stage, "/Other")
    other.OrientToStageUpAxis()
    rig = stage.GetDefaultPrim()
    rig.GetVariantSet("representation").SetVariantSelection("dome")
    dome = UsdGeom.Xformable(stage.GetPrimAtPath("/AsgRig/Dome"))
    assert dome.GetPrim().GetTypeName() == "DomeLight"
    assert Gf.IsClose(dome.GetLocalTransformation(), other.GetLocalTransformation(), 1e-12)
    ops = [[op.GetOpName() for op in light.GetOrderedXformOps()] for light in (dome, other)]
    assert ops[0] == ops[1]


def test_the_dome_images_are_the_same(tmp_path):
    written(tmp_path)
    for frame in FRAMES:
        images = [tmp_path / f"{stem}_dome" / f"{stem}.{frame}.exr" for stem in "yz"]
        assert images[0].read_bytes() == images[1].read_bytes()


@pytest.mark.parametrize(
    ("form", "extension"), [*((form, "usda") for form in Form), (Form.ASG, "usdc")]
)
def test_the_same_tracks_come_back(form, extension, tmp_path):
    tracks = moving(range(1001, 1008), form=form, jitter=0.1)
    path = tmp_path / f"shot.{extension}"
    write_usd(tracks, path, up_axis="Z", representations=("cards",))
    assert_same(read_usd(path), tracks)


def test_a_layer_over_the_stage_that_forgot_the_axis_is_read_as_usd_reads_it(tmp_path):
    written(tmp_path)
    over = tmp_path / "over.usda"
    over.write_text(
        '#usda 1.0\n(\n defaultPrim = "AsgRig"\n startTimeCode = 1001\n endTimeCode = 1005\n'
        " subLayers = [@./z.usda@]\n)\n"
    )
    reading = read_stage(over)
    x, y, z = calm(moving, FRAMES).lobes.axis_z.unbind(-1)
    np.testing.assert_allclose(reading.tracks.lobes.axis_z, torch.stack([x, -z, y], -1), atol=1e-6)
    assert reading.changes == (
        "/AsgRig: turned by 90 degrees with all its lobes (it was written Z-up, and the shot is "
        "Y-up, as it states no upAxis)",
    )
    assert "/: upAxis is 'Y'; expected an explicit Z, as the lobes have" in lint_stage(over)


def test_validators_and_lint_are_content(tmp_path):
    _, path = written(tmp_path, Form.BINGHAM)
    assert lint_stage(path) == []
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    assert [error.GetErrorAsString() for error in errors] == []


def test_a_layer_of_edits_keeps_the_axis(tmp_path):
    _, path = written(tmp_path)
    tracks = read_usd(path)
    lobes = tracks.lobes.clone()
    lobes.axes[:, 0] = lobes.axes[:, 1]
    edited = tmp_path / "edit.usda"
    write_edit_layer(edited, path, replace(tracks, lobes=lobes), [0])
    assert lint_stage(edited) == []
    direct = tmp_path / "direct.usda"
    write_every(replace(tracks, lobes=lobes), direct, up_axis="Z", dome_height=8)
    for representation in OF_LOBES:
        wanted = lights(direct, representation)
        for name, matrix in lights(edited, representation).items():
            np.testing.assert_allclose(matrix, wanted[name], atol=1e-6 * np.abs(matrix).max())
