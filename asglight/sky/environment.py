# SPDX-License-Identifier: Apache-2.0
"""The built-in moving environment: a day in one shot, with a cloud and two coloured lamps.

The sun climbs and sinks again, a cloud drifts past it, and two lamps fade in and out behind the
viewer. Every frame is a pure function of the configuration and the frame number, so frames can be
made in any order and at any size, and time never pops.

Unit of radiance: 10 kcd/m^2. The clear sky is then about 0.3, sunlit ground 0.5, and the sun's
disc up to 1.7e5. Its texels pass the largest half float from about 192 rows on: write such maps as
32-bit float. Nothing is clipped.

Level: the shape and colour of the sky are those of Preetham et al. 1999; its level is set to the
horizontal illuminance of a clear sky of IES RP-21 1984 (`clear_sky_illuminance`), because
Preetham's zenith luminance makes the sky 1.5 to 2.5 times too bright against the sun (Zotti et al.
2007 measured the same). The sun then gives 0.85 of the light on level ground at noon.
"""

import functools
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.luminance import luminance
from asglight.sky import discs, ground, preetham, sunlight
from asglight.sky.cloud import Cloud, optical_depth, scattered
from asglight.sphere import latlong

KCD_PER_UNIT = 10.0
"""kcd/m^2 in one unit of the map."""

_LIGHT_ROWS = 64
"""Rows of the grid that the light on the ground is summed on, the same for every output size, so
that the ground does not change with it."""

_ALBEDO_MAX = 1 / (1 + ground.CONTRAST)
"""The brightest patch then returns all the light that it gets, and not more."""


@dataclass(frozen=True)
class Lamp:
    """A round, even light far away.

    Attributes:
        azimuth_deg: From +Z towards +X.
        elevation_deg: Above the horizon.
        radius_deg: Angular radius.
        colour: Linear Rec.709; only its ratios count.
        klx: Illuminance at the viewer when fully on.
        fade: Shot fractions at which the lamp starts, is fully on, starts to dim, and is off.
    """

    azimuth_deg: float
    elevation_deg: float
    radius_deg: float
    colour: tuple[float, float, float]
    klx: float
    fade: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        """Refuse what is no light."""
        if not all(a <= b for a, b in zip(self.fade, self.fade[1:], strict=False)):
            raise InputError(f"fade: {self.fade}; expected four shot fractions, none descending.")
        if not (all(0 <= channel < math.inf for channel in self.colour) and any(self.colour)):
            raise InputError(f"colour: {self.colour}; expected three numbers from 0, not all 0.")
        if not 0 <= self.klx < math.inf:
            raise InputError(f"klx: {self.klx:g}; expected 0 (none) or more.")
        if not 0 < self.radius_deg <= 90:
            raise InputError(f"radius_deg: {self.radius_deg:g}; expected more than 0, up to 90.")


SODIUM = Lamp(118.0, 22.0, 10.0, (1.0, 0.36, 0.03), 9.0, (0.0, 0.15, 0.35, 0.6))
"""High-pressure sodium, on in the morning."""

CYAN = Lamp(-176.0, 32.0, 9.0, (0.05, 0.7, 1.0), 9.0, (0.4, 0.65, 0.85, 1.0))
"""A cyan panel across the seam of the map, on in the evening."""


@dataclass(frozen=True)
class SkyConfig:
    """What the shot shows; the defaults are the demo.

    Attributes:
        frames: Frame numbers, ascending.
        turbidity: 2 (very clear) to 6 (hazy).
        albedo: Mean albedo of the ground, linear Rec.709, 0 to 0.69.
        sun_elevation_deg: At the ends of the shot and at its middle; 5 to 85.
        sun_azimuth_deg: At the first and the last frame, from +Z towards +X.
        cloud_depth: Optical depth of the cloud; 0 for none.
        cloud_time: Shot fraction at which the cloud is centred on the sun.
        cloud_size: Semi-axes of the cloud across and along the view to +Z, plane heights.
        cloud_drift: How far the cloud moves over the shot, (x, z), plane heights.
        lamps: The lamps.
        seed: Seed of the cloud's shape.
    """

    frames: tuple[int, ...] = tuple(range(1001, 1049))
    turbidity: float = 2.2
    albedo: tuple[float, float, float] = (0.21, 0.19, 0.16)
    sun_elevation_deg: tuple[float, float] = (8.0, 55.0)
    sun_azimuth_deg: tuple[float, float] = (70.0, -70.0)
    cloud_depth: float = 4.0
    cloud_time: float = 0.62
    cloud_size: tuple[float, float] = (0.5, 0.36)
    cloud_drift: tuple[float, float] = (1.6, 0.5)
    lamps: tuple[Lamp, ...] = (SODIUM, CYAN)
    seed: int = 3

    def __post_init__(self) -> None:
        """Keep the configuration inside what the models describe."""
        if not self.frames or any(
            b <= a for a, b in zip(self.frames, self.frames[1:], strict=False)
        ):
            raise InputError(f"frames: {_brief(self.frames)}; expected ascending frame numbers.")
        if not 2 <= self.turbidity <= 6:
            raise InputError(
                f"turbidity: {self.turbidity:g}; expected 2 (very clear) to 6 (hazy). "
                "The sky model holds only there."
            )
        if not all(5 <= elevation <= 85 for elevation in self.sun_elevation_deg):
            raise InputError(
                f"sun_elevation_deg: {self.sun_elevation_deg}; expected 5 to 85 degrees. "
                "The sky model has no twilight."
            )
        if not all(0 <= channel <= _ALBEDO_MAX for channel in self.albedo):
            raise InputError(
                f"albedo: {self.albedo}; expected three numbers from 0 to {_ALBEDO_MAX:.2f}."
            )
        if not 0 <= self.cloud_depth < math.inf:
            raise InputError(f"cloud_depth: {self.cloud_depth:g}; expected 0 (none) or more.")


def radiance(config: SkyConfig, frame: int, height: int) -> Tensor:
    """Return one frame of the environment.

    Args:
        config: What the shot shows.
        frame: One of `config.frames`.
        height: Rows; the map has twice as many columns.

    Returns:
        Linear Rec.709 radiance in units of 10 kcd/m^2, float32.  [H, 2 H, 3]

    Raises:
        InputError: The frame is not in the shot, or there are no rows.
    """
    if height < 1:
        raise InputError(f"height: {height}; expected 1 or more rows.")
    moment = _shot_fraction(config, frame)
    above = _sky_and_cloud(config, moment, 2 * height)  # two samples each way per texel
    soil = _ground_pattern(config.seed, 2 * height)[..., None] * _ground(config, moment)
    is_above = latlong.directions(2 * height, 4 * height, dtype=torch.float64)[..., 1:2] > 0
    fine = torch.where(is_above, above, soil)
    diffuse = latlong.reduce(fine, height, 2 * height)
    small = sun_map(config, frame, height) + _lamp_map(config, moment, height)
    return diffuse.float() / KCD_PER_UNIT + small


def sun_map(config: SkyConfig, frame: int, height: int) -> Tensor:
    """Return the sun's disc alone, seen through the cloud; units and shape as `radiance`."""
    moment = _shot_fraction(config, frame)
    count = discs.point_count(sunlight.SUN_RADIUS, height)
    points, _ = discs.cap_points(sun_direction(config, moment), sunlight.SUN_RADIUS, count)
    through = torch.exp(-optical_depth(_cloud(config, moment), points))  # [P]
    flux = through[:, None] * _sun_illuminance(config, moment) / count
    return (discs.deposit(points, flux, height) / KCD_PER_UNIT).float()


def sun_direction(config: SkyConfig, moment: float) -> Tensor:
    """Return the direction of the sun's centre at a shot fraction, float64.  [3]."""
    low, high = config.sun_elevation_deg
    start, end = config.sun_azimuth_deg
    elevation = low + (high - low) * math.sin(math.pi * moment)
    return _direction(start + (end - start) * moment, elevation)


def clear_sky_illuminance(sun_elevation: float) -> float:
    """Return the light of a clear sky, without the sun, on level ground, in klx (IES RP-21 1984).

    Args:
        sun_elevation: Radians.
    """
    return 0.8 + 15.5 * math.sqrt(math.sin(sun_elevation))


def _sky_and_cloud(config: SkyConfig, moment: float, height: int) -> Tensor:
    """Return the upper hemisphere without sun and lamps, kcd/m^2, float64.  [H, 2 H, 3]."""
    sun = sun_direction(config, moment)
    directions = latlong.directions(height, 2 * height, dtype=torch.float64)
    sky = _sky_scale(config, moment) * preetham.radiance(directions, sun, config.turbidity)
    if config.cloud_depth == 0:
        return sky
    tau = optical_depth(_cloud(config, moment), directions)
    direct = torch.exp(-tau)[..., None]
    # The cloud's own share of skylight: a white diffuser under an even sky of the same light.
    ambient = clear_sky_illuminance(math.asin(float(sun[1]))) / math.pi
    cos_gamma = (directions @ sun).clamp(-1, 1)
    lit = scattered(tau, cos_gamma, _sun_illuminance(config, moment), float(sun[1]))
    return direct * sky + (1 - direct) * ambient + lit


def _ground(config: SkyConfig, moment: float) -> Tensor:
    """Return the radiance of level, matte ground under everything above it, kcd/m^2.  [3]."""
    directions = latlong.directions(_LIGHT_ROWS, 2 * _LIGHT_ROWS, dtype=torch.float64)
    cosine = directions[..., 1].clamp(min=0) * _solid_angles()
    light = torch.einsum("hw,hwc->c", cosine, _sky_and_cloud(config, moment, _LIGHT_ROWS))
    small = _lamp_map(config, moment, _LIGHT_ROWS) * KCD_PER_UNIT
    light = light + torch.einsum("hw,hwc->c", cosine, small.double())
    sun = sun_direction(config, moment)
    points, _ = discs.cap_points(sun, sunlight.SUN_RADIUS, 256)
    through = torch.exp(-optical_depth(_cloud(config, moment), points)).mean()
    light = light + through * sun[1] * _sun_illuminance(config, moment)
    return light * torch.tensor(config.albedo, dtype=torch.float64) / math.pi


@functools.lru_cache(maxsize=2)
def _ground_pattern(seed: int, height: int) -> Tensor:
    """Return `ground.pattern` on a grid; kept, as it is the same in all frames.  [H, 2 H]."""
    return ground.pattern(latlong.directions(height, 2 * height, dtype=torch.float64), seed)


def _sky_scale(config: SkyConfig, moment: float) -> float:
    """Return the factor that gives Preetham's sky the published illuminance."""
    sun = sun_direction(config, moment)
    directions = latlong.directions(_LIGHT_ROWS, 2 * _LIGHT_ROWS, dtype=torch.float64)
    sky = luminance(preetham.radiance(directions, sun, config.turbidity))
    light = (sky * directions[..., 1].clamp(min=0) * _solid_angles()).sum()
    return clear_sky_illuminance(math.asin(float(sun[1]))) / float(light)


def _lamp_map(config: SkyConfig, moment: float, height: int) -> Tensor:
    """Return the lamps alone, in units of 10 kcd/m^2, float32.  [H, 2 H, 3]."""
    total = torch.zeros(height, 2 * height, 3)
    for lamp in config.lamps:
        start, full, dim, end = lamp.fade
        level = _smooth_step(start, full, moment) * (1 - _smooth_step(dim, end, moment))
        if level == 0:
            continue
        radius = math.radians(lamp.radius_deg)
        count = discs.point_count(radius, height)
        centre = _direction(lamp.azimuth_deg, lamp.elevation_deg)
        points, distance = discs.cap_points(centre, radius, count)
        # A bright middle and an edge that falls off over the outer fifth, as of a diffused panel.
        profile = 1 - torch.clamp((distance - 0.8) / 0.2, 0, 1) ** 2
        colour = torch.tensor(lamp.colour, dtype=torch.float64)
        light = level * lamp.klx * colour / luminance(colour)
        flux = (profile / profile.sum())[:, None] * light
        total += (discs.deposit(points, flux, height) / KCD_PER_UNIT).float()
    return total


def _cloud(config: SkyConfig, moment: float) -> Cloud:
    """Return the cloud, which meets the sun at `config.cloud_time`."""
    sun = sun_direction(config, config.cloud_time)
    since = moment - config.cloud_time
    x = float(sun[0] / sun[1]) + config.cloud_drift[0] * since
    z = float(sun[2] / sun[1]) + config.cloud_drift[1] * since
    return Cloud((x, z), config.cloud_size, config.cloud_depth, moment, config.seed)


def _sun_illuminance(config: SkyConfig, moment: float) -> Tensor:
    sun_zenith = math.acos(float(sun_direction(config, moment)[1]))
    return sunlight.illuminance(config.turbidity, sun_zenith)


def _solid_angles() -> Tensor:
    return latlong.texel_solid_angles(_LIGHT_ROWS, 2 * _LIGHT_ROWS, dtype=torch.float64)


def _shot_fraction(config: SkyConfig, frame: int) -> float:
    """Return 0 at the first frame and 1 at the last; 1/2 for a shot of one frame."""
    if frame not in config.frames:
        raise InputError(f"frame: {frame}; expected one of {_brief(config.frames)}.")
    first, last = config.frames[0], config.frames[-1]
    return 0.5 if first == last else (frame - first) / (last - first)


def _brief(frames: tuple[int, ...]) -> str:
    return f"{frames[0]} to {frames[-1]} ({len(frames)} frames)" if frames else "none"


def _direction(azimuth_deg: float, elevation_deg: float) -> Tensor:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return torch.tensor(
        [level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)],
        dtype=torch.float64,
    )


def _smooth_step(start: float, end: float, x: float) -> float:
    """Rise from 0 to 1 with zero slope and curvature at both ends; at once where they are one."""
    if start == end:
        return float(x >= end)
    x = min(max((x - start) / (end - start), 0.0), 1.0)
    return x**3 * (x * (6 * x - 15) + 10)
