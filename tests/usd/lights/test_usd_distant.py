# SPDX-License-Identifier: Apache-2.0
"""Distant lights against quadrature over the sphere and over the disc."""

import math

import numpy as np
import pytest
import torch
from scipy import integrate

from asglight.lobes import Form, Lobes, asg
from asglight.usd.lights import distant
from asglight.usd.lights.emission import intensity_and_color


def one_lobe(form: Form, sharpness: tuple[float, float]) -> Lobes:
    return Lobes(
        torch.eye(3, dtype=torch.float64)[None],
        torch.tensor([sharpness], dtype=torch.float64),
        torch.tensor([[1.0, 2.0, 0.5]], dtype=torch.float64),
        form,
    )


def facing(form: Form, sx: float, sy: float) -> float:
    """Integrate z times the lobe over z > 0 in polar coordinates about the lobe's axis."""

    def integrand(theta: float, phi: float) -> float:
        x, y = math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi)
        z = math.cos(theta)
        gaussian = math.exp(-sx * x * x - sy * y * y)
        value = {
            Form.ASG: z * gaussian,
            Form.BINGHAM: gaussian,
            Form.SG: math.exp(sx * (z - 1)),
            Form.FLAT: z * (1 - (1 - gaussian) ** 3),
        }[form]
        return value * z * math.sin(theta)

    quadrant = integrate.dblquad(integrand, 0, math.pi / 2, 0, math.pi / 2, epsrel=1e-10)
    return 4 * quadrant[0]


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [(1e-3, 1e-3), (0.04, 0.06), (5.0, 2.0), (200.0, 20.0)])
def test_facing_irradiance_is_the_integral_over_the_front(form, sharpness):
    if form is Form.SG:
        sharpness = (sharpness[0],) * 2
    wanted = facing(form, *sharpness)
    found = asg.facing_irradiance(one_lobe(form, sharpness))[0]
    np.testing.assert_allclose(found, wanted * np.array([1.0, 2.0, 0.5]), rtol=1e-8)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [(5.0, 2.0), (300.0, 40.0), (9e6, 3e6)])
def test_the_disc_has_the_spread_of_the_lobe(form, sharpness):
    lobe = one_lobe(form, (sharpness[0],) * 2 if form is Form.SG else sharpness)
    radius = math.radians(float(distant.angle_deg(lobe))) / 2
    cap = 2 * math.pi * (1 - math.cos(radius))
    spread = 2 * math.pi * integrate.quad(lambda t: math.sin(t) ** 3, 0, radius)[0] / cap
    zeroth, _, second = asg.moments(lobe)
    # 1 - cos of the narrowest disc, of 1e-3 radians, keeps nine digits
    assert spread == pytest.approx(float(second[0, :2].sum() / zeroth[0]), rel=1e-6)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [1e-3, 1.0, 1e7])
def test_the_angle_is_never_beyond_the_hemisphere(form, sharpness):
    angle = distant.angle_deg(one_lobe(form, (sharpness, sharpness))).float()
    assert 0 < float(angle) <= 180


def test_color_has_a_largest_component_of_one_and_black_is_white_of_no_intensity():
    light = torch.tensor([[3.0, 6.0, 1.5], [0.0, 0.0, 0.0], [0.0, 1e-30, 0.0]])
    intensity, color = intensity_and_color(light)
    assert intensity.tolist() == [6.0, 0.0, pytest.approx(1e-30)]
    assert color.tolist() == [[0.5, 1.0, 0.25], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]]
