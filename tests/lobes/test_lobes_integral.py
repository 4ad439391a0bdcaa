# SPDX-License-Identifier: Apache-2.0
"""Integrals and moments of every form against quadrature that shares nothing with the code.

The code integrates over the angle in the lobe's disc. Here a lobe is cut instead by planes across
one of its axes; what is left in a plane has a closed form (error function, Bessel functions), and
scipy integrates over the planes. All terms are positive, so no digits cancel. A few integrals are
also done over the sphere directly, from the definition.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import lobe_samples
import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.special
import torch
from lobe_samples import ANISOTROPIC, FORMS, double, lobes_of, value_of

from asglight.lobes import Form, asg

SHARPNESS = [1e-3, 9.9e-3, 1.01e-2, 0.3, 1.0, 2.0, 10.0, 100.0, 1e4, 1e6]
RATIOS = [1.0, 1.01, 4.0, 50.0, 400.0]

ACCURACY = 1e-11
"""Relative. Measured: 4e-16 for the integral, 7e-12 for the first moment at sharpness 1e-3, where
1 - D(x)/x has lost four digits; the angular quadrature itself is exact to rounding."""

Moments = dict[str, float]


def _over_graded_panels(function: Callable[[float], float]) -> float:
    """Integrate over [0, pi/2] by panels that shrink towards both ends, where features are."""
    ends = [0.0, *np.geomspace(1e-6, 0.3, 12)]
    edges = [*ends, *(math.pi / 2 - e for e in reversed(ends))]
    return math.fsum(
        scipy.integrate.quad(function, a, b, epsabs=0, epsrel=1e-12)[0]
        for a, b in itertools.pairwise(edges)
    )


def _across(power: int, s: float, inner: Callable[[float], float]) -> float:
    """Integrate x^power exp(-s x^2) inner(sqrt(1 - x^2)) over x in [-1, 1], by x = sin t."""
    return 2 * _over_graded_panels(
        lambda t: (
            math.sin(t) ** power
            * math.exp(-s * math.sin(t) ** 2)
            * inner(math.cos(t))
            * math.cos(t)
        )
    )


def _reference(form: Form, sx: float, sy: float) -> Moments:
    """Return zeroth, first, xx, yy, zz of an anisotropic form over the sphere."""
    smooth = form is Form.ASG

    def chord(s: float) -> Callable[[float], float]:
        """Integrate exp(-s y^2) dy, over z for the sharp hemisphere, for |y| < b."""
        if smooth:
            return lambda b: math.sqrt(math.pi / s) * math.erf(math.sqrt(s) * b)
        return lambda b: 2 * math.pi * float(scipy.special.ive(0, s * b * b / 2))

    def weighted_chord(b: float) -> float:
        """Integrate sqrt(b^2 - y^2) exp(-sy y^2) dy for |y| < b."""
        h = sy * b * b / 2
        return math.pi / 2 * b * b * float(scipy.special.ive(0, h) + scipy.special.ive(1, h))

    def ring(t: float) -> float:
        """Integrate z^2 times the lobe over the circle at the angle t from the axis."""
        r2, low, gap = math.sin(t) ** 2, min(sx, sy), abs(sx - sy)
        power = math.cos(t) ** (3 if smooth else 2) * math.sin(t) * (1 if smooth else 2)
        circle = math.exp(-r2 * low) * float(scipy.special.ive(0, r2 * gap / 2))
        return 2 * math.pi * power * circle

    return {
        "zeroth": _across(0, sx, chord(sy)),
        "first": _across(0, sx, weighted_chord) if smooth else 0.0,
        "xx": _across(2, sx, chord(sy)),
        "yy": _across(2, sy, chord(sx)),
        "zz": _over_graded_panels(ring),
    }


def _found(form: Form, sx: float, sy: float) -> Moments:
    lobes = lobes_of(lobe_samples.random_axes(1), (sx, sy), form)
    zeroth, first, second = asg.moments(lobes)
    assert zeroth.shape == first.shape == (1,)
    xx, yy, zz = second[0].tolist()
    return {"zeroth": zeroth.item(), "first": first.item(), "xx": xx, "yy": yy, "zz": zz}


def _accuracy(form: Form, sharpness: float) -> float:
    # the sharp hemisphere's x^2 and y^2 are differences that lose a factor of q, the sharpness
    return max(ACCURACY, 2e-16 * sharpness) if form is Form.BINGHAM else ACCURACY


@pytest.mark.parametrize("form", ANISOTROPIC)
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("larger", SHARPNESS)
def test_moments_equal_slice_quadrature(form: Form, ratio: float, larger: float) -> None:
    if larger / ratio < asg.SHARPNESS_MIN:
        larger *= ratio  # the pair that has this smaller sharpness instead
    sx, sy = larger, larger / ratio
    expected, found = _reference(form, sx, sy), _found(form, sx, sy)
    assert found == pytest.approx(expected, rel=_accuracy(form, larger), abs=0)


@pytest.mark.parametrize("form", ANISOTROPIC)
@pytest.mark.parametrize("pair", [(1e-3, 1e7), (1e7, 1e7), (1e-3, 10.0), (1.0, 1e7)])
def test_moments_hold_at_the_limits_of_sharpness_and_any_ratio(
    form: Form, pair: tuple[float, float]
) -> None:
    expected, found = _reference(form, *pair), _found(form, *pair)
    assert found == pytest.approx(expected, rel=_accuracy(form, max(pair)), abs=0)


@pytest.mark.parametrize("form", ANISOTROPIC)
def test_swapping_the_sharpnesses_swaps_the_second_moments(form: Form) -> None:
    one, other = _found(form, 3.0, 70.0), _found(form, 70.0, 3.0)
    assert one["xx"] == other["yy"]
    assert one["yy"] == other["xx"]
    assert one["zeroth"] == other["zeroth"]


@pytest.mark.parametrize("sharpness", [*SHARPNESS, 0.0499, 0.0501, 1e7])
def test_sg_moments_equal_forty_digit_closed_forms(sharpness: float) -> None:
    with mpmath.workdps(40):
        s = mpmath.mpf(sharpness)
        zeroth = 2 * mpmath.pi * (1 - mpmath.exp(-2 * s)) / s
        mean = mpmath.coth(s) - 1 / s
        closed = {
            "zeroth": zeroth,
            "first": zeroth * mean,
            "xx": zeroth * mean / s,
            "yy": zeroth * mean / s,
            "zz": zeroth * (1 - 2 * mean / s),
        }
        expected = {name: float(value) for name, value in closed.items()}
    # the series below 0.05 is cut at s^6 / 4725, 2e-11 of zz
    assert _found(Form.SG, sharpness, sharpness) == pytest.approx(expected, rel=3e-11, abs=0)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("pair", [(0.5, 0.5), (6.0, 1.5)])
def test_moments_are_the_integrals_over_the_sphere(form: Form, pair: tuple[float, float]) -> None:
    axes, s = np.eye(3), np.array(pair)
    weights: dict[str, Callable[[np.ndarray], float]] = {
        "zeroth": lambda d: 1.0,
        "first": lambda d: d[2],
        "xx": lambda d: d[0] ** 2,
        "yy": lambda d: d[1] ** 2,
        "zz": lambda d: d[2] ** 2,
    }

    def integrate(weight: Callable[[np.ndarray], float], theta_from: float, to: float) -> float:
        def integrand(phi: float, theta: float) -> float:
            sine = math.sin(theta)
            d = np.array([sine * math.cos(phi), sine * math.sin(phi), math.cos(theta)])
            return weight(d) * float(value_of(form, axes, s, d)) * sine

        # every form is even in x and in y, so a quarter of the azimuths is enough
        quarter = scipy.integrate.dblquad(
            integrand, theta_from, to, 0, math.pi / 2, epsabs=1e-10, epsrel=1e-10
        )
        return 4 * quarter[0]

    half = math.pi / 2
    expected = {
        name: integrate(w, 0, half) + (0.0 if form is Form.ASG else integrate(w, half, math.pi))
        for name, w in weights.items()
    }
    assert _found(form, *pair) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("pair", [(1e-3, 1e-3), (0.5, 0.5), (6.0, 1.5), (2.0, 900.0), (1e6, 1e3)])
def test_slopes_are_differences_of_the_logarithm_of_the_integral(
    form: Form, pair: tuple[float, float]
) -> None:
    step = 1e-3  # differences are exact to its square
    lobes = lobes_of(lobe_samples.random_axes(1), pair, form)

    def stretched(along: list[float]) -> float:
        sharpness = lobes.sharpness * torch.exp(torch.tensor(along, dtype=torch.float64))
        return math.log(float(asg.integral(replace(lobes, sharpness=sharpness))))

    expected = [
        (stretched(one) - stretched([-each for each in one])) / (2 * step)
        for one in ([step, 0.0], [0.0, step])
    ]
    found = asg.log_slopes(lobes, asg.moments(lobes))[0].tolist()
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("s", [1e-3, 0.5, 1.0, 4.0, 30.0, 1e6])
def test_isotropic_asg_has_the_closed_form(s: float) -> None:
    closed = math.pi * -math.expm1(-s) / s
    assert _found(Form.ASG, s, s)["zeroth"] == pytest.approx(closed, rel=1e-14)


def test_the_usual_approximation_is_as_wrong_as_documented() -> None:
    """docs/method/asg.md gives these numbers for pi / sqrt(sx sy)."""
    for pair, percent in {(1, 1): 58.2, (4, 4): 1.9, (8, 8): 0.03, (50, 2): 4.9}.items():
        simple = math.pi / math.sqrt(pair[0] * pair[1])
        excess = 100 * (simple / _found(Form.ASG, *pair)["zeroth"] - 1)
        assert excess == pytest.approx(percent, abs=0.05)


@pytest.mark.parametrize("ratio", [1.0, 20.0, 400.0])
def test_narrow_lobes_reach_the_gaussian_limit(ratio: float) -> None:
    sx, sy = 1e6, 1e6 / ratio
    limit = math.pi / math.sqrt(sx * sy)
    assert _found(Form.ASG, sx, sy)["zeroth"] == pytest.approx(limit, rel=1e-14)
    # both hemispheres; 1 / z = 1 + (x^2 + y^2) / 2 + ..., with mean x^2 = 1 / (2 sx)
    next_order = 1 + 1 / (4 * sx) + 1 / (4 * sy)
    bingham = _found(Form.BINGHAM, sx, sy)["zeroth"]
    assert bingham == pytest.approx(2 * limit * next_order, rel=3 / sy**2)
    assert _found(Form.SG, sx, sx)["zeroth"] == pytest.approx(2 * math.pi / sx, rel=1e-14)


def test_wide_lobes_reach_the_constant_limit() -> None:
    s = asg.SHARPNESS_MIN
    # cosine: pi; constant: 4 pi; each less a mean of the exponent below 2 s
    assert _found(Form.ASG, s, s)["zeroth"] == pytest.approx(math.pi, rel=s)
    assert _found(Form.BINGHAM, s, s)["zeroth"] == pytest.approx(4 * math.pi, rel=s)
    assert _found(Form.SG, s, s)["zeroth"] == pytest.approx(4 * math.pi, rel=2 * s)


@pytest.mark.parametrize("form", FORMS)
def test_second_moments_add_up_to_the_integral(form: Form) -> None:
    found = _found(form, 12.0, 0.7)
    assert found["xx"] + found["yy"] + found["zz"] == pytest.approx(found["zeroth"], rel=1e-14)


@pytest.mark.parametrize("form", FORMS)
def test_integral_and_flux_are_the_zeroth_moment(form: Form) -> None:
    lobes = lobe_samples.random_lobes(6, form, seed=2)
    zeroth = asg.moments(lobes).zeroth
    assert torch.equal(asg.integral(lobes), zeroth)
    expected = lobes.amplitude.numpy() * zeroth.numpy()[:, None]
    np.testing.assert_allclose(asg.flux(lobes).numpy(), expected, rtol=1e-15)


@pytest.mark.parametrize("form", FORMS)
def test_float32_lobes_have_float64_integrals_rounded_once(form: Form) -> None:
    lobes = lobe_samples.random_lobes(20, form, seed=3).to(torch.float32)
    exact = asg.integral(lobes.to(torch.float64))
    assert torch.equal(asg.integral(lobes), exact.float())


@pytest.mark.parametrize("form", FORMS)
def test_moments_keep_the_batch_shape(form: Form) -> None:
    axes = lobe_samples.random_axes(6).reshape(2, 3, 3, 3)
    sharpness = double(np.geomspace(0.1, 100, 12).reshape(2, 3, 2))
    zeroth, first, second = asg.moments(lobes_of(axes, sharpness, form))
    assert zeroth.shape == first.shape == (2, 3)
    assert second.shape == (2, 3, 3)
