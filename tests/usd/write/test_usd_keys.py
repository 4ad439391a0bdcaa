# SPDX-License-Identifier: Apache-2.0
"""Keys and the rest as a representation: what pxr reads of it, and what the images are."""

from pathlib import Path

import numpy as np
import pytest
import torch
from bench_scripts import module
from key_cases import corner_error, with_lamps
from keyed_stages import ROWS, images, lamp_at, tracks_of, write
from pxr import Usd, UsdGeom, UsdLux, UsdValidation

from asglight.errors import InputError
from asglight.images import read_latlong, write_exr
from asglight.lobes import asg
from asglight.sphere import latlong
from asglight.usd import lint_stage, read_stage, write_usd
from asglight.usd.options import KeyLights
from asglight.usd.read.keys import read_keys

judge = module("keyed.seen")
rows = module("keyed.rows")

FRAMES = (1003, 1004, 1005)
"""Before, at and behind the seam."""


def opened(path: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(path))


def light_types(stage: Usd.Stage) -> dict[str, str]:
    return {
        str(prim.GetPath()): str(prim.GetTypeName())
        for prim in stage.Traverse()
        if prim.HasAPI(UsdLux.LightAPI)
    }


@pytest.mark.parametrize(("extension", "texture"), [("usda", True), ("usdc", False)])
def test_lights_and_rest_are_the_image(tmp_path: Path, extension: str, texture: bool) -> None:
    frames = FRAMES if extension == "usdc" else FRAMES[::2]  # one as other tests have it
    truth = images(tmp_path, frames)
    write(tmp_path, f"shot.{extension}", frames, texture=texture)
    stage = opened(tmp_path / f"shot.{extension}")
    [key] = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    assert light_types(stage) == {str(key.GetPath()): "RectLight", "/AsgRig/Rest": "DomeLight"}
    for frame in FRAMES[::2]:
        errors = rows.frame_row(tmp_path / f"shot.{extension}", frame, truth[frame])
        assert errors["flux"] < 1e-4
        assert errors["irr"] < 0.003
        assert errors["r0.5"] < 0.006
        assert errors["r0.25"] < 0.02
        # texels that the lamp's edge divides have no place in a card of one radiance
        assert errors["env"] < (0.03 if texture else 0.1)


def test_the_key_is_the_lamp_in_every_frame_and_one_track(tmp_path: Path) -> None:
    images(tmp_path, FRAMES)
    write(tmp_path, "shot.usdc", FRAMES, texture=False)
    stage = opened(tmp_path / "shot.usdc")
    [prim] = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    for frame in FRAMES:
        rect = UsdLux.RectLight(prim)
        half = rect.GetWidthAttr().Get(frame) / 2, rect.GetHeightAttr().Get(frame) / 2
        matrix = np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim))
        p, q = half
        corners = np.array([[p, q, 0, 1], [-p, q, 0, 1], [-p, -q, 0, 1], [p, -q, 0, 1]])
        seen = (corners @ matrix)[:, :3]
        seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
        assert corner_error(seen, lamp_at(frame).corners()) < 0.1 * np.radians(9)


def test_validators_and_the_own_lint_are_content(tmp_path: Path) -> None:
    images(tmp_path, FRAMES[:2])
    options = [
        {"representations": ("keys", "cards", "distant"), "texture": True},
        {"lights": KeyLights.DISTANT, "up_axis": "Z", "meters_per_unit": 0.01},
    ]
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for index, chosen in enumerate(options):
        path = tmp_path / f"shot{index}.usda"
        write(tmp_path, path.name, FRAMES[:2], **chosen)
        assert lint_stage(path) == []
        errors = UsdValidation.ValidationContext(validators).Validate(opened(path))
        assert [error.GetErrorAsString() for error in errors] == []


def test_a_rig_elsewhere_in_other_units_and_colours_shows_the_same(tmp_path: Path) -> None:
    truth = images(tmp_path, FRAMES[:1])[FRAMES[0]]
    path = tmp_path / "shot.usda"
    write(
        tmp_path,
        path.name,
        FRAMES[:1],
        up_axis="Z",
        meters_per_unit=0.01,
        primary_path="/World/Lights/Env",
        colorspace="ACEScg",
        texture=True,
    )
    stage = opened(path)
    assert stage.GetPrimAtPath("/World/Lights/Env/Rest")
    # Z up: seen from the origin all is turned by 90 degrees about x
    [light] = judge.lights(stage, FRAMES[0])
    middle = np.linalg.inv(light.to_local)[3, :3]
    x, y, z = lamp_at(FRAMES[0]).axes[2]
    np.testing.assert_allclose(middle / np.linalg.norm(middle), [x, -z, y], atol=0.02)
    assert np.linalg.norm(middle) == pytest.approx(1e5, rel=1e-6)
    # the rest states ACEScg, so that it is read as what it was
    rest = read_latlong(judge.rest_image(stage, FRAMES[0]))
    assert not rest.header.colour.is_rec709
    keys = read_keys(path)
    assert keys is not None
    assert keys.tracks is not None
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)[..., None]
    flux = (rest.radiance.double() * weight).sum((0, 1)) + asg.flux(keys.tracks.lobes)[0, 0]
    torch.testing.assert_close(flux, (truth.double() * weight).sum((0, 1)), rtol=1e-3, atol=0)


def test_a_package_holds_the_rest_and_the_textures(tmp_path: Path) -> None:
    images(tmp_path, FRAMES[:2])
    report = write(tmp_path, "shot.usdz", FRAMES[:2], texture=True)
    assert [file.name for file in report.files] == ["shot.usdz"]
    assert lint_stage(tmp_path / "shot.usdz") == []
    keys = read_keys(tmp_path / "shot.usdz")
    assert keys is not None
    assert len(keys.rest.images) == 2


def test_keys_come_back_and_so_do_lobes_and_what_is_told_of_them(tmp_path: Path) -> None:
    images(tmp_path, FRAMES)
    write(tmp_path, frames=FRAMES, representations=("cards", "keys"))
    keys = read_keys(tmp_path / "shot.usda")
    assert keys is not None
    assert keys.tracks is not None
    assert keys.tracks.frames == FRAMES
    assert len(keys.rest.images) == len(FRAMES)
    assert not keys.changes
    reading = read_stage(tmp_path / "shot.usda")
    assert reading.tracks.lobes.count == 3
    told = reading.tracks.metadata["keys"]
    [row] = told["keys"]
    assert row["name"] == keys.tracks.names[0]
    assert row["frames"] == [FRAMES[0], FRAMES[-1]]
    assert 0 < row["share"] == pytest.approx(told["share"])
    np.testing.assert_allclose(row["size_deg"], [20, 9], rtol=0.1)


def test_a_key_dimmed_warmed_and_moved_elsewhere_is_read_so(tmp_path: Path) -> None:
    images(tmp_path, FRAMES)
    write(tmp_path, "shot.usdc", FRAMES, texture=False)
    before = read_keys(tmp_path / "shot.usdc")
    stage = opened(tmp_path / "shot.usdc")
    [prim] = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    light = UsdLux.LightAPI(prim)
    light.GetExposureAttr().Set(-1.0)
    after = read_keys(stage)
    assert before is not None
    assert before.tracks is not None
    assert after is not None
    assert after.tracks is not None
    torch.testing.assert_close(
        after.tracks.lobes.amplitude, before.tracks.lobes.amplitude / 2, rtol=1e-4, atol=0
    )
    assert after.changes == (f"{prim.GetPath()}: light x 0.5",)


def test_lobes_of_a_stage_that_shows_keys_are_not_the_keys(tmp_path: Path) -> None:
    images(tmp_path, FRAMES[:1])
    write(tmp_path, frames=FRAMES[:1])
    reading = read_stage(tmp_path / "shot.usda")
    assert reading.changes == ()
    torch.testing.assert_close(
        reading.tracks.lobes.sharpness,
        tracks_of(FRAMES[:1]).lobes.sharpness.float(),
        rtol=1e-5,
        atol=0,
    )


def test_distant_keys_have_the_irradiance_of_their_lamp(tmp_path: Path) -> None:
    truth = images(tmp_path, FRAMES[:1])[FRAMES[0]]
    write(tmp_path, "far.usda", FRAMES[:1], lights=KeyLights.DISTANT)
    stage = opened(tmp_path / "far.usda")
    [prim] = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    assert prim.GetTypeName() == "DistantLight"
    light = UsdLux.LightAPI(prim)
    assert light.GetNormalizeAttr().Get()
    rest = read_latlong(judge.rest_image(stage, FRAMES[0])).radiance.double()
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)[..., None]
    facing = latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64) @ torch.from_numpy(
        lamp_at(FRAMES[0]).axes[2].copy()
    )
    cosine = facing.clamp(min=0)[..., None]
    taken = ((truth.double() - rest) * cosine * weight).sum((0, 1))
    color = torch.tensor(list(light.GetColorAttr().Get()), dtype=torch.float64)
    torch.testing.assert_close(light.GetIntensityAttr().Get() * color, taken, rtol=5e-3, atol=0)


def test_a_sky_without_lamps_is_all_rest(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.1001.exr", with_lamps(ROWS), half=False)
    report = write(tmp_path, frames=(1001,))
    stage = opened(tmp_path / "shot.usda")
    assert set(light_types(stage).values()) == {"DomeLight"}
    truth = read_latlong(tmp_path / "sky.1001.exr").radiance
    rest = read_latlong(judge.rest_image(stage, 1001)).radiance
    torch.testing.assert_close(rest, truth, rtol=1e-3, atol=0)
    keys = read_keys(tmp_path / "shot.usda")
    assert keys is not None
    assert keys.tracks is None
    assert report.keys == {"share": 0, "share_min": 0, "share_max": 0, "keys": []}


def test_the_rest_far_from_lamps_is_the_image_to_the_bit(tmp_path: Path) -> None:
    frames = FRAMES[:2]
    truth = images(tmp_path, frames, half=True)
    write(tmp_path, frames=frames)
    stage = opened(tmp_path / "shot.usda")
    for frame in frames:
        rest = read_latlong(judge.rest_image(stage, frame)).radiance
        far = torch.from_numpy(~(lamp_grid() @ lamp_at(frame).axes[2] > np.cos(np.radians(30))))
        assert torch.equal(rest[far], truth[frame][far])


def lamp_grid() -> np.ndarray:
    return latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64).numpy()


def test_a_stage_without_keys_has_none(tmp_path: Path) -> None:
    write_usd(tracks_of(), tmp_path / "plain.usda", representations=("distant",))
    assert read_keys(tmp_path / "plain.usda") is None
    assert "keys" not in read_stage(tmp_path / "plain.usda").tracks.metadata


def test_keys_without_images_and_images_without_keys_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"keys are cut out of the images.*asglight keys"):
        write_usd(tracks_of(), tmp_path / "shot.usda", representations=("keys",))
    images(tmp_path, FRAMES[:1])
    with pytest.raises(InputError, match=r"given without their representation"):
        write(tmp_path, frames=FRAMES[:1], representations=("cards",))
    assert not (tmp_path / "shot.usda").exists()
