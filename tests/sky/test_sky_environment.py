# SPDX-License-Identifier: Apache-2.0
"""The moving environment: energy, continuity in time, and the messages about bad configurations."""

import math
from dataclasses import replace

import pytest
import torch

from asglight.errors import InputError
from asglight.luminance import luminance
from asglight.sky import Lamp, SkyConfig, radiance
from asglight.sky.environment import KCD_PER_UNIT, clear_sky_illuminance, sun_direction, sun_map
from asglight.sky.sunlight import SUN_RADIUS, illuminance
from asglight.sphere import latlong

PLAIN = SkyConfig(cloud_depth=0.0, lamps=())
LAMP = Lamp(118.0, 22.0, 10.0, (1.0, 0.5, 0.2), 9.0, (0.0, 0.2, 0.8, 1.0))
NOON = 1025
HEIGHT = 48


def _flux(image: torch.Tensor) -> torch.Tensor:
    height, width = image.shape[:2]
    solid_angles = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    return torch.einsum("hw,hwc->c", solid_angles, image.double())


def _horizontal(image: torch.Tensor) -> float:
    """Return the illuminance of level ground, klx."""
    height, width = image.shape[:2]
    up = latlong.directions(height, width, dtype=torch.float64)[..., 1:2]
    return KCD_PER_UNIT * float(luminance(_flux(image.double() * up.clamp(min=0))))


def test_sun_gives_the_published_share_of_the_light_at_a_high_clear_noon() -> None:
    sun = _horizontal(sun_map(PLAIN, NOON, HEIGHT))
    sky = _horizontal(radiance(PLAIN, NOON, HEIGHT)) - sun
    assert 0.80 < sun / (sun + sky) < 0.87


@pytest.mark.parametrize("frame", [1001, 1012, NOON])
def test_sky_has_the_published_illuminance(frame: int) -> None:
    sky = _horizontal(radiance(PLAIN, frame, HEIGHT)) - _horizontal(sun_map(PLAIN, frame, HEIGHT))
    direction = sun_direction(PLAIN, (frame - 1001) / 47)
    # One percent: the cosine at texel centres, and two samples per texel beside the sun.
    assert sky == pytest.approx(clear_sky_illuminance(math.asin(float(direction[1]))), rel=0.01)


def test_published_clear_sky_illuminance_worked_by_hand() -> None:
    # 0.8 + 15.5 sqrt(sin 30 deg) = 0.8 + 15.5 * 0.707107
    assert clear_sky_illuminance(math.radians(30)) == pytest.approx(11.7602, abs=1e-4)


def test_flux_of_the_sun_is_smooth_as_it_crosses_texels() -> None:
    fluxes = torch.stack([_flux(sun_map(PLAIN, f, 32))[1] for f in PLAIN.frames])
    zeniths = [math.acos(float(sun_direction(PLAIN, i / 47)[1])) for i in range(48)]
    expected = torch.stack([illuminance(PLAIN.turbidity, z)[1] for z in zeniths]) / KCD_PER_UNIT
    assert float((fluxes / expected - 1).abs().max()) < 1e-6  # float32 map


def test_centroid_of_the_sun_follows_its_path_below_the_texel_size() -> None:
    for frame in (1003, 1010, 1030):
        image = sun_map(PLAIN, frame, 512).double()
        solid_angles = latlong.texel_solid_angles(512, 1024, dtype=torch.float64)
        grid = latlong.directions(512, 1024, dtype=torch.float64)
        centroid = torch.einsum("hw,hwc->c", image[..., 1] * solid_angles, grid)
        path = sun_direction(PLAIN, (frame - 1001) / 47)
        # Texels are 0.35 degrees; point sampling would be off by up to half of one.
        assert float((centroid / centroid.norm()) @ path) > math.cos(math.radians(0.08))


def test_energy_of_the_disc_is_its_radiance_times_its_solid_angle() -> None:
    # 1024 rows: a texel is 0.18 degrees, so texels inside the disc show its own radiance.
    image = sun_map(PLAIN, NOON, 1024)
    sun = sun_direction(PLAIN, (NOON - 1001) / 47)
    grid = latlong.directions(1024, 2048, dtype=torch.float64)
    half_texel = math.radians(180 / 1024) * 0.75
    inside = torch.acos((grid @ sun).clamp(-1, 1)) < SUN_RADIUS - half_texel
    inner = image[..., 1].double()[inside].mean()
    # Few texels are wholly inside, each even to about a percent.
    solid_angle = 4 * math.pi * math.sin(SUN_RADIUS / 2) ** 2
    assert float(inner) * solid_angle == pytest.approx(float(_flux(image)[1]), rel=0.02)


def test_shot_has_no_pops() -> None:
    # The soil at the horizon shows the light on level ground; texel centres do not come into it.
    def ground(config: SkyConfig, frames: tuple[int, ...]) -> torch.Tensor:
        rows = [radiance(config, f, 24)[12:].double() for f in frames]
        return torch.stack([luminance(image).mean() for image in rows])

    light = ground(SkyConfig(), SkyConfig().frames)
    changes = light.diff().abs()
    largest = float(changes.max())
    assert largest < 0.35 * float(light.max() - light.min())
    # A quarter of the time step makes each large change much smaller: it is a slope, not a step.
    fine = SkyConfig(frames=tuple(range(2001, 2001 + 4 * 47 + 1)))
    for step in torch.nonzero(changes > 0.5 * largest).flatten().tolist():
        within = ground(fine, fine.frames[4 * step : 4 * step + 5])
        assert float((within[-1] - within[0]).abs()) == pytest.approx(float(changes[step]))
        assert float(within.diff().abs().max()) < 0.5 * largest


def test_cloud_takes_most_of_the_sun_and_gives_it_back() -> None:
    config = SkyConfig()
    share = [
        float(_flux(sun_map(config, f, 32))[1] / _flux(sun_map(PLAIN, f, 32))[1])
        for f in (1001, 1030, 1048)
    ]
    assert share[0] == pytest.approx(1, abs=1e-6)
    assert share[1] < 0.2
    assert share[2] == pytest.approx(1, abs=1e-6)


def test_lamps_are_off_at_both_ends_and_coloured_between() -> None:
    config = SkyConfig(cloud_depth=0.0)
    for frame, (low, high) in {1012: (2, 0), 1038: (0, 2)}.items():
        lamps = _flux(radiance(config, frame, HEIGHT)) - _flux(radiance(PLAIN, frame, HEIGHT))
        assert lamps[high] > 1.5 * lamps[low]
    for frame in (1001, 1048):
        assert torch.equal(radiance(config, frame, HEIGHT), radiance(PLAIN, frame, HEIGHT))


def test_lamp_gives_its_illuminance() -> None:
    config = SkyConfig(cloud_depth=0.0, albedo=(0.0, 0.0, 0.0))
    plain = replace(PLAIN, albedo=(0.0, 0.0, 0.0))
    lamp = _flux(radiance(config, 1011, 32)) - _flux(radiance(plain, 1011, 32))
    # Frame 1011 is at 0.21 of the shot, where only the sodium lamp is on, fully. The difference of
    # two float32 maps with a sun in them is good to about 1e-4.
    assert KCD_PER_UNIT * float(luminance(lamp)) == pytest.approx(9.0, rel=1e-3)


def test_black_ground_is_black_and_lit_ground_is_lambertian() -> None:
    black = radiance(replace(PLAIN, albedo=(0.0, 0.0, 0.0)), NOON, HEIGHT)
    assert (black[HEIGHT // 2 :] == 0).all()
    grey = radiance(replace(PLAIN, albedo=(0.3, 0.3, 0.3)), NOON, HEIGHT)
    horizon = luminance(grey[HEIGHT // 2].double()).mean() * KCD_PER_UNIT
    # Patches are faded out near the horizon; E of this coarse map is good to about one percent.
    assert float(horizon) == pytest.approx(0.3 * _horizontal(grey) / math.pi, rel=0.03)


@pytest.mark.parametrize("height", [1, 5, 16])
def test_any_size_has_the_same_flux(height: int) -> None:
    config = SkyConfig()
    small, large = _flux(radiance(config, 1015, height)), _flux(radiance(config, 1015, 64))
    # Sky and soil are sampled at two points per texel each way, which one row hardly resolves.
    assert small.numpy() == pytest.approx(large.numpy(), rel={1: 0.5, 5: 0.06, 16: 0.03}[height])


def test_frames_are_repeatable_finite_and_not_negative() -> None:
    image = radiance(SkyConfig(), 1027, HEIGHT)
    assert image.shape == (HEIGHT, 2 * HEIGHT, 3)
    assert image.dtype == torch.float32
    assert image.isfinite().all()
    assert (image >= 0).all()
    assert torch.equal(image, radiance(SkyConfig(), 1027, HEIGHT))


def test_shot_of_one_frame_is_its_middle() -> None:
    one = replace(PLAIN, frames=(7,))
    assert float(sun_direction(one, 0.5)[1]) == pytest.approx(math.sin(math.radians(55)))
    assert radiance(one, 7, 8).isfinite().all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turbidity": 1.5}, r"turbidity: 1.5; expected 2 \(very clear\) to 6"),
        ({"sun_elevation_deg": (2.0, 50.0)}, r"sun_elevation_deg: .*expected 5 to 85"),
        ({"albedo": (0.2, 0.2, 1.4)}, r"albedo: .*expected three numbers from 0 to 0.69"),
        ({"cloud_depth": -1.0}, r"cloud_depth: -1; expected 0"),
        ({"cloud_depth": math.nan}, r"cloud_depth: nan; expected 0"),
        ({"frames": ()}, r"frames: none; expected ascending"),
        ({"frames": (3, 2)}, r"frames: 3 to 2 \(2 frames\); expected ascending"),
    ],
)
def test_configuration_outside_the_model_is_refused(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        SkyConfig(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fade": (0.0, 0.2, 0.1, 1.0)}, r"fade: .*expected four shot fractions"),
        ({"colour": (0.0, 0.0, 0.0)}, r"colour: .*expected three numbers from 0, not all 0"),
        ({"colour": (1.0, math.nan, 0.5)}, r"colour: .*expected three numbers"),
        ({"klx": -3.0}, r"klx: -3; expected 0 \(none\) or more"),
        ({"radius_deg": 0.0}, r"radius_deg: 0; expected more than 0, up to 90"),
    ],
)
def test_a_lamp_that_is_no_light_is_refused(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(LAMP, **change)


def test_a_lamp_may_go_on_and_off_at_once() -> None:
    def shown(lamp: Lamp, frame: int) -> torch.Tensor:
        return radiance(replace(PLAIN, lamps=(lamp,)), frame, 8) - radiance(PLAIN, frame, 8)

    frames = PLAIN.frames
    always = replace(LAMP, fade=(0.0, 0.0, 1.0, 1.0))
    assert shown(always, frames[0]).max() > 0.1
    assert shown(always, frames[-2]).max() > 0.1
    assert shown(always, frames[-1]).max() == 0  # as it says: off at the end
    later = replace(LAMP, fade=(0.5, 0.5, 1.0, 1.0))
    assert shown(later, frames[len(frames) // 2 - 1]).max() == 0
    assert shown(later, frames[len(frames) // 2]).max() > 0.1


def test_frame_outside_the_shot_is_refused() -> None:
    with pytest.raises(InputError, match=r"frame: 900; expected one of 1001 to 1048 \(48 frames\)"):
        radiance(SkyConfig(), 900, 8)


def test_map_without_rows_is_refused() -> None:
    with pytest.raises(InputError, match="height: 0; expected 1 or more"):
        radiance(SkyConfig(), 1001, 0)
