# SPDX-License-Identifier: Apache-2.0
"""Keys and rest for engines: numbers against sums over texels, quadrature, and what USD says."""

import json
from pathlib import Path

import moderngl
import numpy as np
import OpenEXR
import pytest
import torch
from include_shader import points, shown
from keyed_stages import FRAMES, images, write
from pxr import Usd, UsdGeom, UsdLux
from scipy import integrate
from torch import Tensor

from asglight.cli.main import main
from asglight.export import read_json
from asglight.export.environment import environment
from asglight.export.keyed import irradiance_terms, polynomials
from asglight.images import read_latlong, write_exr
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.lobes.rectangles import rectangles
from asglight.sphere import latlong
from asglight.usd import read_keys

ROWS = 64


def summed(radiance: Tensor, normals: Tensor) -> Tensor:
    """Return the irradiance of a map, a sum over its texels in float64.  [P, 3]."""
    height, width = radiance.shape[:2]
    directions = latlong.directions(height, width, dtype=torch.float64).view(-1, 3)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    flux = (radiance.double() * solid_angle[..., None]).view(-1, 3)
    return (normals @ directions.T).clamp(min=0) @ flux


def test_the_irradiance_of_broad_light_is_that_of_a_sum_over_texels() -> None:
    directions = latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64)
    weights = torch.tensor([3.0, 0.5, -0.4, 0.3, 0.6, -0.5, 0.2, 0.4, -0.3], dtype=torch.float64)
    radiance = (polynomials(directions) @ weights)[..., None] * torch.tensor([1.0, 0.5, 2.0])
    normals = points()[0]
    found = polynomials(normals) @ irradiance_terms(radiance)
    # what is constant within texels of 2.8 degrees is off by a thousandth
    torch.testing.assert_close(found, summed(radiance, normals), rtol=2e-3, atol=2e-3)


def test_the_irradiance_of_an_even_sphere_is_pi() -> None:
    terms = irradiance_terms(torch.ones(ROWS, 2 * ROWS, 3))
    np.testing.assert_allclose(terms[0], np.pi, rtol=1e-6)
    np.testing.assert_allclose(terms[1:], 0, atol=1e-3)


@pytest.mark.parametrize("size", [(0.01, 0.02), (0.5, 0.2), (3.0, 1.0)])
def test_the_irradiance_of_a_card_is_its_integral(size: tuple[float, float]) -> None:
    p, q = size
    wanted = integrate.dblquad(lambda y, x: (1 + x * x + y * y) ** -2, -p, p, -q, q)[0]
    extent, eye = torch.tensor(size, dtype=torch.float64), torch.eye(3, dtype=torch.float64)
    assert float(rectangles(eye, extent, None).irradiance()) == pytest.approx(wanted, rel=1e-7)


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    images(tmp_path, FRAMES[:2])
    write(tmp_path, frames=FRAMES[:2])
    monkeypatch.chdir(tmp_path)
    return tmp_path / "shot.usda"


def test_keys_in_the_file_are_those_that_usd_says(
    stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (stage.parent / "below").mkdir()
    assert main(["export", str(stage), "--to", "json", "-o", "below/a.json"]) == 0
    assert "3 lobes of form asg, 1 key and a rest, 2 frames" in capsys.readouterr().out
    document = json.loads(Path("below/a.json").read_text())
    opened = Usd.Stage.Open(str(stage))
    [prim] = opened.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    [row] = document["keys"]
    assert row["name"] == prim.GetName()
    for place, frame in enumerate(FRAMES[:2]):
        matrix = np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim))
        distance = np.linalg.norm(matrix[3, :3])
        rect, light = UsdLux.RectLight(prim), UsdLux.LightAPI(prim)
        size = [rect.GetWidthAttr().Get(frame), rect.GetHeightAttr().Get(frame)]
        radiance = light.GetIntensityAttr().Get(frame) * np.array(light.GetColorAttr().Get(frame))

        def of(name: str, place: int = place) -> np.ndarray:
            values = np.array(row[name])
            return values if values.ndim == 1 else values[place]

        np.testing.assert_allclose(of("center"), matrix[3, :3] / distance, atol=1e-5)
        assert abs(of("axis_x") @ matrix[0, :3]) == pytest.approx(1, rel=1e-5)
        assert abs(of("axis_y") @ matrix[1, :3]) == pytest.approx(1, rel=1e-5)
        np.testing.assert_allclose(of("half_size"), np.array(size) / 2 / distance, rtol=1e-4)
        np.testing.assert_allclose(of("radiance"), radiance, rtol=1e-4)
        image = Path("below") / document["rest"]["images"][place]
        assert image.resolve() == stage.parent / "shot_dome" / f"shot.rest.{frame}.exr"
        rest = read_latlong(image).radiance
        terms = document["rest"]["irradiance_sh"][place]
        np.testing.assert_allclose(terms, irradiance_terms(rest), rtol=1e-5, atol=1e-6)
    assert read_json("below/a.json").lobes.count == 3  # as without keys


def test_the_file_says_which_space_the_images_of_the_rest_are_in(tmp_path: Path) -> None:
    images(tmp_path, FRAMES[:1])
    write(tmp_path, frames=FRAMES[:1], colorspace="ACEScg")
    target = tmp_path / "a.json"
    assert main(["export", str(tmp_path / "shot.usda"), "--to", "json", "-o", str(target)]) == 0
    document = json.loads(target.read_text())
    [image] = document["rest"]["images"]
    with OpenEXR.File(str(tmp_path / image)) as file:
        assert file.header()["chromaticities"][:2] == pytest.approx([0.713, 0.293])
    assert "linear space that their chromaticities state" in document["keyed_convention"]


def test_the_file_says_that_no_surface_has_less_than_no_light(stage: Path) -> None:
    """Nine coefficients of a rest with one bright side are below zero beside the other."""
    side = torch.zeros(32, 64, 3)
    side[14:18, 30:34] = 1.0
    shown = polynomials(latlong.directions(32, 64, dtype=torch.float64)) @ irradiance_terms(side)
    assert float(shown.min()) < -0.02 * float(shown.max())
    assert main(["export", str(stage), "--to", "json", "-o", "a.json"]) == 0
    convention = json.loads(Path("a.json").read_text())["keyed_convention"]
    assert convention.endswith("+ c8 (x^2 - y^2), and 0 where that is negative.")


def test_keys_and_rest_light_a_matte_surface_as_the_image_does(stage: Path) -> None:
    truth = read_latlong(stage.parent / f"sky.{FRAMES[0]}.exr").radiance
    assert main(["export", str(stage), "--to", "json", "--frame", "1001", "-o", "a.json"]) == 0
    document = json.loads(Path("a.json").read_text())
    [row] = document["keys"]
    center = torch.tensor(row["center"], dtype=torch.float64)
    terms = torch.tensor(document["rest"]["irradiance_sh"][0], dtype=torch.float64)
    found = torch.tensor(row["irradiance"]).double() + polynomials(center) @ terms
    torch.testing.assert_close(found, summed(truth, center[None])[0], rtol=3e-3, atol=0)


def test_frames_are_chosen(stage: Path) -> None:
    assert main(["export", str(stage), "--to", "json", "--frame", "1002", "-o", "a.json"]) == 0
    document = json.loads(Path("a.json").read_text())
    assert document["frames"] == [1002]
    assert document["rest"]["images"] == ["shot_dome/shot.rest.1002.exr"]
    assert len(document["keys"][0]["center"]) == 3


def light_of(stage: Path) -> tuple[LobeTracks, Tensor]:
    keys = read_keys(stage)
    assert keys is not None
    assert keys.tracks is not None
    terms = [irradiance_terms(keys.rest.radiance(place)) for place in range(len(keys.times))]
    return keys.tracks, torch.stack(terms)


def test_the_include_has_keys_and_rest(opengl: moderngl.Context, stage: Path) -> None:
    assert main(["export", str(stage), "--to", "glsl", "--frame", "1001", "-o", "a.glsl"]) == 0
    text = Path("a.glsl").read_text()
    assert "as 1 key and a rest, frame 1001" in text
    normals = points()[0]
    _, terms = light_of(stage)
    rest = shown(opengl, text, "vec4(asglight_rest_irradiance(normal), 0.0)")()
    expected = (polynomials(normals) @ terms[0]).clamp(min=0)
    torch.testing.assert_close(rest[:, :3].double(), expected, rtol=1e-4, atol=1e-5)
    parts = "asglight_irradiance(normal) + asglight_rest_irradiance(normal)"
    both = shown(opengl, text, f"vec4(asglight_keyed_irradiance(normal) - ({parts}), 0.0)")()
    assert float(both.abs().max()) < 1e-5
    given = "normal, view, u_roughness, u_f0"
    layer = (
        f"asglight_reflection({given}) + albedo * vec3(2.0) + (1.0 - albedo) * vec3(0.5) / "
        "3.14159265 * asglight_keyed_irradiance(normal)"
    ).replace("albedo", "asglight_albedo(dot(normal, view), u_roughness, u_f0)")
    call = f"asglight_keyed_shade({given}, vec3(0.5), vec3(2.0))"
    off = shown(opengl, text, f"vec4({call} - ({layer}), 0.0)")(0.3, (0.04, 0.2, 0.9))
    assert float(off.abs().max()) < 1e-3
    assert "vec3 asglight_shade(" not in text


def test_a_shot_of_keys_has_the_rest_in_its_blocks(opengl: moderngl.Context, stage: Path) -> None:
    assert main(["export", str(stage), "--to", "glsl", "-o", "a.glsl"]) == 0
    tracks, terms = light_of(stage)
    blocks = np.fromfile("a.f32", "<f4").reshape(2, -1, 4)
    np.testing.assert_allclose(blocks[:, -9:, :3], terms, rtol=1e-5, atol=1e-6)
    run = shown(opengl, Path("a.glsl").read_text(), "vec4(asglight_rest_irradiance(normal), 0.0)")
    opengl.buffer(blocks[1].tobytes()).bind_to_uniform_block(0)
    expected = (polynomials(points()[0]) @ terms[1]).clamp(min=0)
    torch.testing.assert_close(run()[:, :3].double(), expected, rtol=1e-4, atol=1e-5)
    still = environment(
        LobeTracks((1, 2), 24.0, stack([tracks.lobes[0]] * 2)), "a.f32", terms[:1].repeat(2, 1, 1)
    )
    assert still.blocks is None


def test_a_sky_without_lamps_is_a_rest_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr(tmp_path / "sky.1001.exr", torch.ones(ROWS, 2 * ROWS, 3), half=False)
    write(tmp_path, frames=(1001,))
    assert main(["export", "shot.usda", "--to", "glsl", "-o", "a.glsl"]) == 0
    assert "0 keys and a rest" in capsys.readouterr().out
    assert main(["export", "shot.usda", "--to", "json", "-o", "a.json"]) == 0
    assert json.loads(Path("a.json").read_text())["keys"] == []


def test_a_rest_that_its_images_do_not_show_is_refused(
    stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = Usd.Stage.Open(str(stage))
    rest = UsdLux.LightAPI(opened.GetPrimAtPath("/AsgRig/Rest"))
    rest.GetExposureAttr().Set(-1.0)
    opened.GetRootLayer().Save()
    assert main(["export", str(stage), "--to", "json", "-o", "a.json"]) == 2
    error = capsys.readouterr().err
    assert "/AsgRig/Rest: light x 0.5, which the images of the rest do not show" in error
    assert not Path("a.json").exists()
