# SPDX-License-Identifier: Apache-2.0
"""Fitted exponents: recovered from power laws, and equal to those of another program."""

import math

import numpy as np
import pytest
from scipy import stats

from asglight.judging.bench.power_law import power_law


@pytest.mark.parametrize("exponent", [-0.5, 0.0, 1.0, 2.5])
def test_a_power_law_is_recovered(exponent: float) -> None:
    sizes = [1, 4, 15, 60, 120]
    law = power_law(sizes, [3 * size**exponent for size in sizes])
    assert law is not None
    # 1e-12: float64 sums of five logarithms
    assert law.exponent == pytest.approx(exponent, abs=1e-12)
    assert law.coefficient == pytest.approx(3, rel=1e-12)
    assert law.standard_error == pytest.approx(0, abs=1e-7)
    assert law.spread == pytest.approx(1, abs=1e-7)
    assert law.at(30) == pytest.approx(3 * 30**exponent, rel=1e-12)


def test_a_noisy_one_has_the_slope_and_error_of_scipy() -> None:
    random = np.random.default_rng(5)
    sizes = np.array([10, 30, 100, 300, 1000])
    values = 0.2 * sizes**0.7 * np.exp(random.normal(0, 0.2, len(sizes)))
    law = power_law(sizes.tolist(), values.tolist())
    wanted = stats.linregress(np.log(sizes), np.log(values))
    assert law is not None
    assert law.exponent == pytest.approx(wanted.slope, rel=1e-12)
    assert law.standard_error == pytest.approx(wanted.stderr, rel=1e-9)
    assert law.coefficient == pytest.approx(math.exp(wanted.intercept), rel=1e-12)
    fitted = np.exp(wanted.intercept) * sizes**wanted.slope
    assert law.spread == pytest.approx(max((values / fitted).max(), (fitted / values).max()))


@pytest.mark.parametrize(
    ("sizes", "values"),
    [([10, 20], [1.0, 2.0]), ([10, 10, 20], [1.0, 1.0, 2.0]), ([1, 2, 3], [0.0, 1.0, 2.0])],
    ids=["two points", "two sizes", "a zero"],
)
def test_too_little_is_no_law(sizes: list[int], values: list[float]) -> None:
    assert power_law(sizes, values) is None
