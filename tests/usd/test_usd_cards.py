# SPDX-License-Identifier: Apache-2.0
"""Card sizes against quadrature over the rectangle and over the sphere."""

import math

import numpy as np
import pytest
import torch
from scipy import integrate

from asglight.lobes import Form, Lobes, asg
from asglight.sphere.quadrature import fibonacci_directions
from asglight.usd import cards

DIRECTIONS = fibonacci_directions(100_000, dtype=torch.float64)
STERADIANS = 4 * math.pi / len(DIRECTIONS)


def one_lobe(form: Form, sharpness: tuple[float, float]) -> Lobes:
    return Lobes(
        torch.eye(3, dtype=torch.float64)[None],
        torch.tensor([sharpness], dtype=torch.float64),
        torch.ones(1, 3, dtype=torch.float64),
        form,
    )


def over_card(p: float, q: float, power_of_x: int) -> float:
    """Integrate x^k / (1 + x^2 + y^2)^((k + 3) / 2) over the card: unit directions' x^k dw."""

    def integrand(y: float, x: float) -> float:
        return x**power_of_x * (1 + x * x + y * y) ** (-(power_of_x + 3) / 2)

    return 4 * integrate.dblquad(integrand, 0, p, 0, q, epsabs=1e-13, epsrel=1e-11)[0]


@pytest.mark.parametrize("extent", [(0.01, 0.02), (0.5, 0.1), (1.0, 1.0), (4.0, 0.3), (11.0, 9.0)])
def test_solid_angle_is_the_integral_over_the_card(extent):
    exact = over_card(extent[0], extent[1], 0)
    assert float(cards.solid_angle(torch.tensor(extent).double())) == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [(5.0, 2.0), (3.5, 40.0), (800.0, 30.0), (9e6, 2e5)])
def test_the_card_has_the_mean_squares_of_the_lobe(form, sharpness):
    if form is Form.SG:
        sharpness = (sharpness[0],) * 2
    lobe = one_lobe(form, sharpness)
    p, q = cards.half_extent(lobe)[0].tolist()
    # the lobe's moments have tests of their own in tests/lobes; this one is about the card
    zeroth, _, second = asg.moments(lobe)
    wanted = (second[0, :2] / zeroth[0]).tolist()
    area = over_card(p, q, 0)
    # dblquad is good to 1e-11 of the integral; the mean square of the sharpest lobe is 1e-7
    assert over_card(p, q, 2) / area == pytest.approx(wanted[0], rel=1e-6)
    assert over_card(q, p, 2) / area == pytest.approx(wanted[1], rel=1e-6)


def test_every_sharpness_gives_a_finite_card_no_wider_than_the_widest():
    values = torch.logspace(-3, 7, 21, dtype=torch.float64)
    pairs = torch.cartesian_prod(values, values)
    widest = math.tan(math.radians(cards.HALF_ANGLE_MAX_DEG))
    for form in Form:
        chosen = pairs[:, :1].expand(-1, 2) if form is Form.SG else pairs
        lobes = Lobes(
            torch.eye(3, dtype=torch.float64).expand(len(pairs), 3, 3),
            chosen,
            torch.ones(len(pairs), 3, dtype=torch.float64),
            form,
        )
        extent = cards.half_extent(lobes)
        assert torch.isfinite(extent).all()
        assert (extent > 0).all()
        assert float(extent.max()) <= widest


def diffuse_error(lobe: Lobes) -> float:
    """Return the RMS error of irradiance over 200 normals, relative to the lobe's RMS."""
    normals = fibonacci_directions(200, dtype=torch.float64)
    lambert = (normals @ DIRECTIONS.T).clamp(min=0) * STERADIANS
    p, q = cards.half_extent(lobe)[0]
    x, y, z = DIRECTIONS.unbind(-1)
    # a bingham lobe has a second card behind
    depth = z.abs() if lobe.form is Form.BINGHAM else z
    card = ((x.abs() <= p * depth) & (y.abs() <= q * depth)).double()
    value = asg.unit_lobes(lobe, DIRECTIONS)[0]
    card *= value.sum() / card.sum()  # equal flux on the same directions
    error = lambert @ (card - value)
    return float(error.square().mean().sqrt() / (lambert @ value).square().mean().sqrt())


@pytest.mark.parametrize(
    ("form", "sharpness", "loss"),
    [
        (Form.ASG, (1e-3, 1e-3), 0.02),
        (Form.ASG, (1e-3, 50.0), 0.02),
        (Form.SG, (1.0, 1.0), 0.27),
        (Form.SG, (0.01, 0.01), 0.63),
        (Form.BINGHAM, (0.01, 0.01), 0.03),
        (Form.BINGHAM, (0.01, 50.0), 0.16),
    ],
)
def test_broad_lobes_lose_no_more_irradiance_than_documented(form, sharpness, loss):
    error = diffuse_error(one_lobe(form, sharpness))
    assert loss - 0.02 < error < loss


def test_card_values_scale_with_distance_and_keep_the_radiance():
    lobe = one_lobe(Form.ASG, (20.0, 5.0))
    near, far = cards.values(lobe, 1.0), cards.values(lobe, 250.0)
    np.testing.assert_allclose(far["inputs:width"], 250 * near["inputs:width"], rtol=1e-12)
    np.testing.assert_allclose(far["inputs:height"], 250 * near["inputs:height"], rtol=1e-12)
    assert torch.equal(far["inputs:intensity"], near["inputs:intensity"])
