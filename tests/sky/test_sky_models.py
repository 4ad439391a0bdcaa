# SPDX-License-Identifier: Apache-2.0
"""Sky, sunlight, cloud and discs against published values and closed forms."""

import math

import numpy as np
import pytest
import scipy.integrate
import torch

from asglight.luminance import luminance
from asglight.sky import discs, preetham, sunlight
from asglight.sky.cloud import Cloud, optical_depth, scattered, two_stream_transmittance
from asglight.sky.colour import colour_matching, rec709_from_xyz
from asglight.sphere import latlong


def _towards(elevation: float, azimuth: float = 0.0) -> torch.Tensor:
    return torch.tensor(
        [
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
            math.cos(elevation) * math.cos(azimuth),
        ],
        dtype=torch.float64,
    )


def test_zenith_luminance_agrees_with_the_formula_worked_by_hand() -> None:
    # T = 3, sun at 45 degrees: chi = (4/9 - 3/120) pi/2 = 0.658861, tan chi = 0.774283,
    # 7.1649 * 0.774283 - 0.6465 + 2.4192 = 7.32036 kcd/m^2. Six digits were kept.
    assert preetham.zenith_luminance(3.0, math.pi / 4) == pytest.approx(7.32036, abs=2e-5)


def test_zenith_chromaticity_is_the_constant_column_for_an_overhead_sun() -> None:
    # All powers of the sun's angle vanish: x = 0.00394 T + 0.25886, y = 0.00516 T + 0.26688.
    assert preetham.zenith_chromaticity(2.0, 0.0) == pytest.approx((0.26674, 0.27720), abs=1e-9)


def test_radiance_at_the_zenith_has_the_zenith_luminance_and_a_clear_sky_blue() -> None:
    zenith = torch.tensor([[0.0, 1.0, 0.0]], dtype=torch.float64)
    rgb = preetham.radiance(zenith, _towards(math.pi / 4), 3.0)[0]
    # Both colour matrices are published with four digits.
    assert float(luminance(rgb)) == pytest.approx(7.3204, rel=5e-4)
    assert rgb[2] > rgb[1] > rgb[0]


def test_sky_is_brightest_beside_the_sun() -> None:
    grid = latlong.directions(64, 128, dtype=torch.float64)
    sun = _towards(math.radians(40), math.radians(30))
    level = luminance(preetham.radiance(grid, sun, 2.5))
    brightest = grid.reshape(-1, 3)[int(level.argmax())]
    # The texel whose centre is nearest lies within one texel (2.8 degrees) of the sun.
    assert float(brightest @ sun) > math.cos(math.radians(2.9))


def test_equal_energy_white_converts_to_equal_tristimulus_values() -> None:
    wavelength = torch.arange(360.0, 831.0, 1.0, dtype=torch.float64)
    sums = colour_matching(wavelength).sum(0)
    # CIE 1931 2 degree observer: 106.865, 106.857, 106.892; the fit is good to about one percent.
    assert sums.numpy() == pytest.approx([106.87, 106.86, 106.89], rel=0.012)


def test_white_of_rec709_converts_to_grey() -> None:
    white = torch.tensor([0.95047, 1.0, 1.08883], dtype=torch.float64)
    assert rec709_from_xyz(white).numpy() == pytest.approx([1, 1, 1], abs=5e-4)  # 4-digit matrix


@pytest.mark.parametrize("elevation_deg", [15, 30, 45, 60, 75])
def test_sun_illuminance_agrees_with_the_published_clear_day(elevation_deg: float) -> None:
    # IES RP-21 1984: 127.5 exp(-0.21 m) klx with m = 1 / sin(elevation). Turbidity 2.2 is a clear
    # day; the published curve has no turbidity, so agreement to a tenth is all there is.
    elevation = math.radians(elevation_deg)
    published = 127.5 * math.exp(-0.21 / math.sin(elevation))
    ours = float(luminance(sunlight.illuminance(2.2, math.pi / 2 - elevation)))
    assert ours == pytest.approx(published, rel=0.1)


def test_air_mass_is_one_overhead_and_two_at_thirty_degrees() -> None:
    assert sunlight.air_mass(0.0) == pytest.approx(1.0, abs=1e-3)
    assert sunlight.air_mass(math.radians(60)) == pytest.approx(1.995, abs=5e-3)  # Kasten's table


def test_low_sun_is_redder_than_high_sun() -> None:
    low, high = (sunlight.illuminance(2.5, math.radians(90 - e)) for e in (8, 60))
    assert low[0] / low[2] > 3 * high[0] / high[2]


@pytest.mark.parametrize("height", [1, 7, 64, 700])
def test_disc_keeps_its_flux_at_every_resolution(height: int) -> None:
    points, _ = discs.cap_points(_towards(0.9, math.pi), 0.05, discs.point_count(0.05, height))
    flux = torch.full((len(points), 3), 2.0 / len(points), dtype=torch.float64)
    image = discs.deposit(points, flux, height)
    solid_angles = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64)
    assert float((image[..., 0] * solid_angles).sum()) == pytest.approx(2.0, rel=1e-12)


def test_cap_points_fill_the_cap_evenly() -> None:
    centre, radius = _towards(0.3, 2.0), 0.4
    points, distance = discs.cap_points(centre, radius, 20000)
    angle = torch.acos((points @ centre).clamp(-1, 1))
    assert float(angle.max()) < radius
    # Equal areas: half of the points lie inside the cap of half the solid angle.
    half = math.acos(1 - (1 - math.cos(radius)) / 2)
    assert float((angle < half).double().mean()) == pytest.approx(0.5, abs=1e-4)
    assert float((distance < math.sqrt(0.5)).double().mean()) == pytest.approx(0.5, abs=1e-4)
    # The centroid of a cap is cos^2(radius / 2) along its axis; a spiral of P points is off by
    # much less than 1 / P^(3/4).
    centroid = points.mean(0)
    assert centroid.numpy() == pytest.approx(
        (math.cos(radius / 2) ** 2 * centre).numpy(), abs=20000**-0.75
    )


def test_cloud_scatters_what_it_takes_from_the_sun() -> None:
    # Integrated over all directions, once-scattered light is tau exp(-tau) of the beam.
    tau = 0.7
    dark = 2 / (2 + 0.2 * tau) - math.exp(-tau) * (1 + 0.9 * tau)

    def once(cosine: float) -> float:
        both = scattered(
            torch.tensor(tau, dtype=torch.float64),
            torch.tensor(cosine, dtype=torch.float64),
            torch.ones(3, dtype=torch.float64),
            1.0,
        )[0]
        return 2 * math.pi * (float(both) - dark / math.pi)

    total, _ = scipy.integrate.quad(once, -1, 1, points=[0.9, 0.99])
    assert total == pytest.approx(tau * math.exp(-tau), rel=1e-7)


def test_cloud_of_no_depth_changes_nothing() -> None:
    zero = torch.zeros(4, dtype=torch.float64)
    light = scattered(zero, torch.linspace(-1, 1, 4).double(), torch.ones(3).double(), 0.5)
    assert light.abs().max() == 0
    assert two_stream_transmittance(zero).tolist() == [1.0] * 4


def test_scattered_light_is_never_negative() -> None:
    tau = torch.tensor(np.geomspace(1e-6, 50, 200))
    assert (scattered(tau, torch.tensor(-1.0), torch.ones(3).double(), 1.0) >= 0).all()


def test_cloud_is_soft_and_lies_where_it_is_put() -> None:
    cloud = Cloud(centre=(0.3, 0.4), size=(0.5, 0.4), depth=3.0, age=0.2, seed=3)
    grid = latlong.directions(512, 1024, dtype=torch.float64)
    tau = optical_depth(cloud, grid)
    weight = tau * latlong.texel_solid_angles(512, 1024, dtype=torch.float64)
    mean = (weight[..., None] * grid).sum((0, 1))
    plane = mean / mean[1]
    # The ragged shape moves the centroid by a part of the semi-axes.
    assert float(plane[0]) == pytest.approx(0.3, abs=0.15)
    assert float(plane[2]) == pytest.approx(0.4, abs=0.15)
    assert tau.max() <= 3.0
    assert (tau[256:] == 0).all()
    # No step between neighbours: the whole depth takes at least four texels of 0.35 degrees.
    assert float(tau.diff(dim=1).abs().max()) < 3.0 / 4
