# SPDX-License-Identifier: Apache-2.0
"""Card sizes against quadrature over the rectangle; which lobe gets which cards."""

import math

import numpy as np
import pytest
import torch
from scipy import integrate

from asglight.lobes import Form, Lobes, asg
from asglight.usd.lights import cards
from asglight.usd.lights.cards import Kind


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
    p, q = cards.half_extent(cards.mean_squares(asg.moments(lobe)))[0].tolist()
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
        extent = cards.half_extent(cards.mean_squares(asg.moments(lobes)))
        assert torch.isfinite(extent).all()
        assert (extent > 0).all()
        assert float(extent.max()) <= widest


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [(9.0, 6.0), (12.0, 40.0), (400.0, 30.0)])
def test_three_cards_have_the_flux_and_the_mean_squares_of_the_lobe(form, sharpness):
    lobe = one_lobe(form, (sharpness[0],) * 2 if form is Form.SG else sharpness)
    flux = x_squared = y_squared = 0.0
    for piece, values in cards.values(lobe, asg.moments(lobe), 1.0, Kind.SOFT).items():
        p, q = (
            float(values[f"inputs:{name}"]) / 2 / piece.distance for name in ("width", "height")
        )
        radiance = float(values["inputs:intensity"]) * (2 if form is Form.BINGHAM else 1)
        flux += radiance * over_card(p, q, 0)
        x_squared += radiance * over_card(p, q, 2)
        y_squared += radiance * over_card(q, p, 2)
    zeroth, _, second = asg.moments(lobe)
    assert flux == pytest.approx(float(zeroth[0]), rel=1e-6)
    # the two inner cards share a radiance, so their shares of the flux differ a little
    assert x_squared == pytest.approx(float(second[0, 0]), rel=0.02)
    assert y_squared == pytest.approx(float(second[0, 1]), rel=0.02)


def test_no_two_cards_of_a_lobe_coincide():
    lobes = frames_of(Form.ASG, [(20.0, 5.0)])
    lights = cards.lights(lobes, asg.moments(lobes.to(torch.float64)), 1000.0, [Kind.SOFT])[0]
    assert [light.name for light in lights] == ["tall", "wide", "outer"]
    places = [light.constants["xformOp:translate:dist"][2] for light in lights]
    assert places == pytest.approx([1000, 1001, 1002])


def frames_of(form: Form, sharpness: list[tuple[float, float]], flux: list[float] | None = None):
    """Return one lobe over as many frames, of the flux or, without one, of amplitude 1."""
    lobes = Lobes(
        torch.eye(3).expand(len(sharpness), 1, 3, 3),
        torch.tensor(sharpness)[:, None],
        torch.ones(len(sharpness), 1, 3),
        form,
    )
    if flux is not None:
        lobes.amplitude[:] = (torch.tensor(flux)[:, None] / asg.integral(lobes))[..., None]
    return lobes


@pytest.mark.parametrize(
    ("form", "sharpness", "kind"),
    [
        (Form.ASG, (2e4, 1e4), Kind.SINGLE),
        (Form.ASG, (2e4, 300.0), Kind.SOFT),
        (Form.ASG, (200.0, 20.0), Kind.SOFT),
        (Form.ASG, (3.0, 4.0), Kind.SOFT),
        (Form.ASG, (1.5, 1.5), Kind.FILL),
        (Form.ASG, (0.001, 40.0), Kind.FILL),
        (Form.ASG, (0.001, 800.0), Kind.FILL),  # narrower than the fill's texels
        (Form.SG, (8.0, 8.0), Kind.SOFT),
        (Form.SG, (4.0, 4.0), Kind.FILL),
        (Form.BINGHAM, (6.0, 6.0), Kind.SOFT),
        (Form.BINGHAM, (2.0, 6.0), Kind.FILL),
    ],
)
def test_the_kind_goes_by_the_width(form, sharpness, kind):
    assert cards.kinds(frames_of(form, [sharpness])) == [kind]


def test_the_kind_is_that_of_the_frames_that_shine():
    broad, sharp = (0.5, 0.5), (5e3, 5e3)
    assert cards.kinds(frames_of(Form.ASG, [broad, sharp], [1.0, 1e9])) == [Kind.SINGLE]
    assert cards.kinds(frames_of(Form.ASG, [broad, sharp], [1e9, 1.0])) == [Kind.FILL]
    assert cards.kinds(frames_of(Form.ASG, [broad, broad], [0.0, 0.0])) == [Kind.FILL]


def test_card_values_scale_with_distance_and_keep_the_radiance():
    lobe = one_lobe(Form.ASG, (20.0, 5.0))
    moments = asg.moments(lobe)
    near, far = (cards.values(lobe, moments, distance, Kind.SOFT) for distance in (1.0, 250.0))
    for piece, values in near.items():
        for name in ("inputs:width", "inputs:height"):
            np.testing.assert_allclose(far[piece][name], 250 * values[name], rtol=1e-12)
        assert torch.equal(far[piece]["inputs:intensity"], values["inputs:intensity"])
