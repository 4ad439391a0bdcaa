# SPDX-License-Identifier: Apache-2.0
"""Non-negative least squares against scipy's."""

import numpy as np
import pytest
from scipy.optimize import nnls

from asglight.fitting.steps.non_negative import non_negative_least_squares


@pytest.mark.parametrize("count", [1, 2, 15, 64])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("alike", [0.0, 0.99, 0.99999])
@pytest.mark.parametrize("begins", [0.0, 1.0])
def test_it_agrees_with_scipy(count: int, seed: int, alike: float, begins: float) -> None:
    """However alike the columns are, some of them bound in the minimum, wherever it begins."""
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(count + 8, count))
    matrix = alike * matrix.mean(1, keepdims=True) + (1 - alike) * matrix
    matrix /= np.linalg.norm(matrix, axis=0)
    gram = matrix.T @ matrix + 1e-5 * np.eye(count)
    right = matrix.T @ random.normal(size=count + 8)
    factor = np.linalg.cholesky(gram)
    wanted, _ = nnls(factor.T, np.linalg.solve(factor, right))
    start = begins * random.normal(size=count).clip(min=0.0)
    found = non_negative_least_squares(gram, right, start)
    assert found.min() >= 0
    # of the minimum; the condition of the matrix, 1e6 and more, decides how exact x itself is
    value, least = (x @ gram @ x / 2 - right @ x for x in (found, wanted))
    assert value <= least + 1e-12 * abs(least)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * (1 + wanted.max()))


def test_without_anything_to_gain_all_end_at_zero() -> None:
    assert (
        non_negative_least_squares(np.eye(3), np.array([-1.0, 0.0, -2.0]), np.ones(3)) == 0
    ).all()


def test_equal_columns_end() -> None:
    """The ridge alone tells them apart: they share."""
    gram = np.ones((6, 6)) + 1e-5 * np.eye(6)
    found = non_negative_least_squares(gram, np.ones(6), np.zeros(6))
    np.testing.assert_allclose(found, 1 / 6, atol=1e-5)
