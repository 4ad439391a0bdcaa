# SPDX-License-Identifier: Apache-2.0
"""What a renderer that follows UsdLux sees of the authored lights, against the lobes themselves.

Only pxr reads the stage here; lights are integrated from their authored values and world matrices.
"""

import math
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux
from usd_tracks import SHAPES, moving, of_every_kind, still
from written_stages import calm

from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions
from asglight.usd import StageOptions, lint_stage, write_usd
from asglight.usd.lights import cards
from asglight.usd.write import layer

NODES = 64
"""Gauss-Legendre nodes an axis: the clamped cosine's kink costs 1e-4 of irradiance at most."""

DIRECTIONS = fibonacci_directions(200_000, dtype=torch.float64)
STERADIANS = 4 * math.pi / len(DIRECTIONS)
NORMALS = fibonacci_directions(30, dtype=torch.float64)

X, WEIGHT = np.polynomial.legendre.leggauss(NODES)


def written(tracks: LobeTracks, path: Path, representation: str, **options: int) -> Usd.Stage:
    """Write a stage of the one representation that is looked at, and open it."""
    write_usd(tracks, path, representations=(representation,), **options)
    return Usd.Stage.Open(str(path))


def lights_of(prim: Usd.Prim) -> list[Usd.Prim]:
    return [light for light in Usd.PrimRange(prim) if light.HasAPI(UsdLux.LightAPI)]


def emitted(light: Usd.Prim, frame: float) -> NDArray[np.float64]:
    api = UsdLux.LightAPI(light)
    color = np.array(api.GetColorAttr().Get(frame), dtype=np.float64)
    return api.GetIntensityAttr().Get(frame) * 2.0 ** api.GetExposureAttr().Get(frame) * color


def world(light: Usd.Prim, frame: float) -> NDArray[np.float64]:
    """Return the matrix that multiplies row vectors (x, y, z, 1)."""
    return np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(light))


def card_seen(light: Usd.Prim, frame: float) -> tuple[NDArray, NDArray]:
    """Return directions from the origin to a card [P, 3] and solid angles of its pieces [P]."""
    rect = UsdLux.RectLight(light)
    assert not UsdLux.LightAPI(light).GetNormalizeAttr().Get(frame)
    half_width = rect.GetWidthAttr().Get(frame) / 2
    half_height = rect.GetHeightAttr().Get(frame) / 2
    px, py = np.meshgrid(X * half_width, X * half_height, indexing="ij")
    area = np.outer(WEIGHT * half_width, WEIGHT * half_height).ravel()
    points = np.stack([px.ravel(), py.ravel(), 0 * area, 1 + 0 * area], axis=-1)
    matrix = world(light, frame)
    seen = (points @ matrix)[:, :3]
    shines_along = np.array([0, 0, -1, 0]) @ matrix
    distance = np.linalg.norm(seen, axis=-1)
    directions = seen / distance[:, None]
    cosine = np.maximum(-(directions @ shines_along[:3]), 0)  # a card is dark from behind
    return directions, area * cosine / distance**2


def irradiance_of(lobes: Lobes) -> NDArray[np.float64]:
    """Return irradiance on the test normals, by quadrature over the sphere.  [P, 3]."""
    directions, radiance = radiance_of(lobes)
    lambert = (NORMALS @ directions.T).clamp(min=0) * STERADIANS
    return (lambert @ radiance).numpy()


def radiance_of(lobes: Lobes) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the directions of the sphere where lobes shine [D, 3], and their radiance [D, 3]."""
    radiance = asg.evaluate(lobes.to(torch.float64), DIRECTIONS)
    # the rest of the sphere has less than 1e-9 of the light
    lit = radiance.sum(-1) > 1e-14 * radiance.sum()
    return DIRECTIONS[lit], radiance[lit]


def rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def single(tracks: LobeTracks, frame: int, index: int) -> Lobes:
    return tracks.at(frame).select(torch.tensor([index]))


def irradiance_by(lights: list[Usd.Prim], frame: float) -> NDArray[np.float64]:
    """Return what cards give the test normals.  [P, 3]."""
    found = np.zeros((len(NORMALS), 3))
    for light in lights:
        directions, solid_angles = card_seen(light, frame)
        lambert = np.maximum(NORMALS.numpy() @ directions.T, 0) @ solid_angles
        found += lambert[:, None] * emitted(light, frame)
    return found


def image_of(dome: Usd.Prim, frame: float) -> NDArray[np.float64]:
    """Return the texels of a dome.  [H, W, 3]."""
    asset = UsdLux.DomeLight(dome).GetTextureFileAttr().Get(frame)
    return OpenEXR.File(asset.resolvedPath).channels()["RGB"].pixels.astype(np.float64)


@pytest.mark.parametrize("form", Form)
def test_cards_carry_the_flux_of_the_lobes_at_every_frame(form, tmp_path):
    tracks = moving(range(1001, 1021), form=form)
    tracks.lobes.sharpness[:] *= torch.tensor([3.0, 1e3, 3.0])[:, None]  # none in the fill
    stage = written(tracks, tmp_path / "shot.usdc", "cards")
    for index, lobe in enumerate(stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()):
        for frame in (1001, 1008, 1020):
            flux = sum(
                card_seen(light, frame)[1].sum() * emitted(light, frame)
                for light in lights_of(lobe)
            )
            wanted = asg.flux(single(tracks, frame, index).to(torch.float64))[0].numpy()
            np.testing.assert_allclose(flux, wanted, rtol=1e-4)


def test_frames_whose_samples_were_left_out_keep_their_flux(tmp_path):
    tracks = moving(range(1, 1201))
    tracks.lobes.sharpness[:, 0] *= 500  # one card
    kinds = cards.kinds(tracks.lobes)
    images = layer.Images(["./sky.exr"])
    built, author = layer.build(tracks, StageOptions(), images, "shot.usdc", kinds)
    assert author.left_out > 0.3 * author.written
    built.Export(str(tmp_path / "shot.usdc"))
    stage = Usd.Stage.Open(str(tmp_path / "shot.usdc"))
    lobe = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00")
    width = lobe.GetAttribute("inputs:width")
    between = sorted(set(tracks.frames) - set(map(int, width.GetTimeSamples())))
    assert len(between) > 100
    for frame in between[:: len(between) // 20]:
        flux = card_seen(lobe, frame)[1].sum() * emitted(lobe, frame)
        wanted = asg.flux(single(tracks, frame, 0).to(torch.float64))[0].numpy()
        # four attributes, 1e-4 each
        np.testing.assert_allclose(flux, wanted, rtol=4e-4)


# A single rectangle costs 0.9 to 2.3 % where light is diffuse and 8 to 12 % where it is glossy.
@pytest.mark.parametrize(("index", "diffuse", "glossy"), [(0, 0.005, 0.03), (1, 0.002, 0.015)])
def test_soft_cards_light_a_patch_as_the_lobe_does(index, diffuse, glossy, tmp_path):
    tracks = still(((50.0, 4.0), (20.0, 5.0)))
    stage = written(tracks, tmp_path / "shot.usda", "cards")
    lights = lights_of(stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_0{index}"))
    assert len(lights) == 3
    lobe = single(tracks, 1001, index)
    wanted = irradiance_of(lobe)
    assert rms(irradiance_by(lights, 1001) - wanted) < diffuse * rms(wanted)
    lit, radiance = (one.numpy() for one in radiance_of(lobe))
    wanted = shine(NORMALS.numpy() @ lit.T) @ radiance * STERADIANS
    found = sum(
        (shine(NORMALS.numpy() @ directions.T) @ solid_angles)[:, None] * emitted(light, 1001)
        for light in lights
        for directions, solid_angles in [card_seen(light, 1001)]
    )
    assert rms(found - wanted) < glossy * rms(wanted)


def shine(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a reflection as broad as that of a surface of roughness 0.5, of no one's model."""
    return np.exp(20 * (cosine - 1))


@pytest.mark.parametrize("form", Form)
def test_cards_and_fill_together_light_a_patch_as_the_lobes_do(form, tmp_path):
    tracks = calm(of_every_kind, (1001, 1002, 1003), form)
    stage = written(tracks, tmp_path / "shot.usda", "cards")
    fill = stage.GetPrimAtPath("/AsgRig/Fill")
    cards = [light for light in lights_of(stage.GetPrimAtPath("/AsgRig")) if light != fill]
    height = 64
    solid_angles = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64).numpy()
    directions = latlong.directions(height, 2 * height, dtype=torch.float64).numpy()
    lambert = np.maximum(np.einsum("pk,hwk->phw", NORMALS, directions), 0) * solid_angles
    for frame in (1001, 1003):
        image = image_of(fill, frame)
        found = irradiance_by(cards, frame) + np.einsum("phw,hwc->pc", lambert, image)
        wanted = irradiance_of(tracks.at(frame))
        assert rms(found - wanted) < 0.006 * rms(wanted)


def test_a_bingham_lobe_lights_both_sides_alike(tmp_path):
    tracks = still(((20.0, 5.0), (200.0, 20.0), (9e3, 3e3)), Form.BINGHAM)
    stage = written(tracks, tmp_path / "shot.usda", "cards")
    for index, lobe in enumerate(stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()):
        found = irradiance_by(lights_of(lobe), 1001)
        wanted = irradiance_of(single(tracks, 1001, index))
        # without the factor z the lobe has more light at its rim: (20, 5) costs most
        assert rms(found - wanted) < 0.005 * rms(wanted)


@pytest.mark.parametrize("form", Form)
def test_distant_lights_give_the_irradiance_that_faces_the_lobe(form, tmp_path):
    tracks = moving(range(1001, 1021), form=form)
    stage = written(tracks, tmp_path / "shot.usdc", "distant")
    for index, lobe in enumerate(stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()):
        for frame in (1001, 1008, 1020):
            truth = single(tracks, frame, index)
            lights = lights_of(lobe)
            assert len(lights) == (2 if form is Form.BINGHAM else 1)
            for light, side in zip(lights, (1, -1), strict=False):
                towards = (np.array([0, 0, 1, 0]) @ world(light, frame))[:3]
                axis_z = truth.axis_z[0].double().numpy()
                turn = abs(towards @ axis_z) if form is Form.BINGHAM else side * towards @ axis_z
                assert turn == pytest.approx(1, abs=1e-6)
                facing = (DIRECTIONS @ torch.from_numpy(towards)).clamp(min=0) * STERADIANS
                wanted = facing @ asg.evaluate(truth.to(torch.float64), DIRECTIONS)
                assert UsdLux.LightAPI(light).GetNormalizeAttr().Get(frame)
                # the spiral's quadrature of the narrowest lobe, and 4e-5 for samples left out
                np.testing.assert_allclose(emitted(light, frame), wanted, rtol=2e-4)


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_three_distant_lights_face_a_patch_as_the_lobe_does_and_spread_along_it(form, tmp_path):
    # the long side changes from y to x between the frames
    tracks = moving((1001, 1002), lobes=2, form=form)
    tracks.lobes.sharpness[:] = torch.tensor([[[60.0, 9.0]], [[9.0, 60.0]]])
    stage = written(tracks, tmp_path / "shot.usda", "distant", distant_lights=3)
    assert lint_stage(tmp_path / "shot.usda") == []
    for index, prim in enumerate(stage.GetPrimAtPath("/AsgRig/Lobes").GetChildren()):
        for frame in tracks.frames:
            lobe = single(tracks, frame, index).to(torch.float64)
            front = [one for one in lights_of(prim) if "back" not in one.GetName()]
            assert len(front) == 3
            axes = lobe.axes[0].numpy()
            local = [axes @ (np.array([0, 0, 1, 0]) @ world(one, frame))[:3] for one in front]
            # a bingham lobe's front may be either of its sides
            facing = sum(
                abs(at[2]) * emitted(one, frame) for at, one in zip(local, front, strict=True)
            )
            cosine = (DIRECTIONS @ lobe.axis_z[0]).clamp(min=0) * STERADIANS
            # the spiral's quadrature, and 4e-5 for samples left out
            wanted = (cosine @ asg.evaluate(lobe, DIRECTIONS)).numpy()
            np.testing.assert_allclose(facing, wanted, rtol=2e-4)
            spread = np.abs(np.array(local)).max(axis=0)
            long, short = (1, 0) if frame == 1001 else (0, 1)
            assert spread[short] < 1e-5 < 0.3 < spread[long] < 0.5


@pytest.mark.parametrize("form", Form)
def test_the_dome_carries_the_flux_and_points_at_the_lobe(form, tmp_path):
    height = 64
    solid_angles = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64).numpy()
    directions = latlong.directions(height, 2 * height, dtype=torch.float64).numpy()
    for index in range(len(SHAPES)):
        tracks = still((SHAPES[index],), form)
        path = tmp_path / f"shot{index}.usda"
        stage = written(tracks, path, "dome", dome_height=height)
        texture = UsdLux.DomeLight(stage.GetPrimAtPath("/AsgRig/Dome")).GetTextureFileAttr()
        pixels = OpenEXR.File(texture.Get().resolvedPath).channels()["RGB"].pixels
        flux = np.einsum("hw,hwc->c", solid_angles, pixels.astype(np.float64))
        wanted = asg.flux(tracks.lobes[0].to(torch.float64))[0].numpy()
        np.testing.assert_allclose(flux, wanted, rtol=0.005)
        brightest = np.unravel_index(pixels.sum(-1).argmax(), pixels.shape[:2])
        cosine = float(directions[brightest] @ tracks.lobes.axis_z[0, 0].double().numpy())
        cosine = abs(cosine) if form is Form.BINGHAM else cosine
        assert math.acos(min(cosine, 1)) < 1.5 * math.pi / height  # within the nearest texels
