# SPDX-License-Identifier: Apache-2.0
"""What engines make of the distant lights of a stage, by their rules as read, is the lobes' light.

The rules and their sources are in docs/guides/engines.md; no engine is run here. The reference is
the irradiance on a patch that faces a lobe, by quadrature over the sphere.
"""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdLux
from usd_tracks import moving
from written_stages import calm

from asglight.lobes import Form, LobeTracks
from asglight.usd import write_usd

FRAMES = (1001, 1002, 1003)
Rgb = NDArray[np.float64]


class Light:
    """The attributes of a DistantLight at a frame, evaluated as importers do.

    Attributes:
        intensity: `intensity` times 2 to the power of `exposure`.
        color: Linear RGB.  [3]
        angle: Diameter in degrees.
    """

    def __init__(self, prim: Usd.Prim, frame: int) -> None:
        light = UsdLux.DistantLight(prim)
        exposure = light.GetExposureAttr().Get(frame)
        self.intensity = light.GetIntensityAttr().Get(frame) * 2.0**exposure
        self.color = np.array(light.GetColorAttr().Get(frame), dtype=np.float64)
        self.angle = light.GetAngleAttr().Get(frame)


def unreal(light: Light) -> Rgb:
    """Return lux: Unreal takes intensity as such, and colour as 8 bits of sRGB (ToFColor)."""
    inside = light.color.clip(0, 1)
    encoded = np.where(inside <= 0.0031308, 12.92 * inside, 1.055 * inside ** (1 / 2.4) - 0.055)
    eighth = np.floor(encoded * 255.999) / 255
    decoded = np.where(eighth <= 0.04045, eighth / 12.92, ((eighth + 0.055) / 1.055) ** 2.4)
    return light.intensity * decoded


def unity_hdrp(light: Light) -> Rgb:
    """Return lux: the unit of a directional light, whose colour is linear."""
    return light.intensity * light.color


def unity_urp(light: Light, multiplier: float) -> Rgb:
    """Return irradiance: a matte surface of URP shows albedo times colour, without 1 / pi."""
    return np.pi * multiplier * light.intensity * light.color


def facing_irradiance(tracks: LobeTracks, frame: int) -> Rgb:
    """Integrate max(z, 0) times each lobe over the half of the sphere around it.  [N, 3]."""
    lobes = tracks.at(frame)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    z, weight = 0.5 * nodes + 0.5, 0.5 * weights  # over 0 to 1
    phi = (np.arange(256) + 0.5) * 2 * np.pi / 256
    x = np.sqrt(1 - z * z)[:, None] * np.cos(phi)
    y = np.sqrt(1 - z * z)[:, None] * np.sin(phi)
    result = []
    for (sx, sy), amplitude in zip(
        lobes.sharpness.double().numpy(), lobes.amplitude.double().numpy(), strict=True
    ):
        value = np.exp(-sx * x * x - sy * y * y)
        if lobes.form is Form.FLAT:
            value = z[:, None] * (1 - (1 - value) ** 3)
        elif lobes.form is Form.ASG:
            value = z[:, None] * value
        elif lobes.form is Form.SG:
            value = np.exp(sx * (z - 1))[:, None] * np.ones_like(x)
        result.append((weight * z) @ value.sum(1) * (2 * np.pi / 256) * amplitude)
    return np.array(result)


@pytest.fixture(params=list(Form), scope="module")
def shot(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[LobeTracks, Usd.Stage]:
    """Return tracks and a stage of them that shows its distant lights."""
    tracks = calm(moving, FRAMES, form=request.param)
    path = tmp_path_factory.mktemp("engines") / "shot.usda"
    write_usd(tracks, path, representations=("distant",))
    return tracks, Usd.Stage.Open(str(path))


def lights_of(stage: Usd.Stage, lobe: int) -> list[Usd.Prim]:
    """Return the distant lights of a lobe: one, or one for each side of a bingham lobe."""
    every = Usd.PrimRange(stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_{lobe:02d}"))
    return [prim for prim in every if prim.IsA(UsdLux.DistantLight)]


def assert_light(
    shot: tuple[LobeTracks, Usd.Stage], rule: Callable[[Light], Rgb], tolerance: float
) -> None:
    """Compare each light of each frame with its lobe, relative to the brightest channel."""
    tracks, stage = shot
    for frame in FRAMES:
        for lobe, expected in enumerate(facing_irradiance(tracks, frame)):
            lights = lights_of(stage, lobe)
            assert len(lights) == (2 if tracks.lobes.form is Form.BINGHAM else 1)
            for prim in lights:
                found = rule(Light(prim, frame))
                assert np.abs(found - expected).max() <= tolerance * expected.max()


def test_unreal_gets_the_irradiance_to_a_step_of_its_colours(
    shot: tuple[LobeTracks, Usd.Stage],
) -> None:
    # The step of 8 bits of sRGB is widest at 1: 2.4 / 1.055 / 255.
    assert_light(shot, unreal, 2.4 / 1.055 / 255)


def test_unity_hdrp_gets_the_irradiance(shot: tuple[LobeTracks, Usd.Stage]) -> None:
    assert_light(shot, unity_hdrp, 1e-6)  # float32 of intensity, colour and the lobe


def test_unity_urp_needs_a_multiplier_of_one_over_pi(shot: tuple[LobeTracks, Usd.Stage]) -> None:
    assert_light(shot, lambda light: unity_urp(light, 1 / np.pi), 1e-6)
    with pytest.raises(AssertionError):
        assert_light(shot, lambda light: unity_urp(light, 1.0), 1e-6)


def test_colours_fit_into_8_bits(shot: tuple[LobeTracks, Usd.Stage]) -> None:
    # Unreal cuts colours at 1, so that the magnitude must be in the intensity.
    tracks, stage = shot
    for lobe in range(tracks.lobes.count):
        for prim in lights_of(stage, lobe):
            for frame in FRAMES:
                assert Light(prim, frame).color.max() == pytest.approx(1, abs=1e-6)


def test_normalize_may_be_ignored(shot: tuple[LobeTracks, Usd.Stage]) -> None:
    # An importer that drops it and one that keeps it must mean the same: intensity in lux.
    tracks, stage = shot
    for lobe in range(tracks.lobes.count):
        for prim in lights_of(stage, lobe):
            assert UsdLux.DistantLight(prim).GetNormalizeAttr().Get() is True
            assert 0 < Light(prim, FRAMES[0]).angle <= 180
