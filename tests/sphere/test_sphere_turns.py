# SPDX-License-Identifier: Apache-2.0
"""The least turn between directions, against that of scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asglight.sphere.turns import turn_between


@pytest.mark.parametrize("angle_deg", [0.0, 1e-6, 0.3, 45.0, 90.0, 179.0])
def test_it_turns_by_the_angle_between_about_the_axis_across(angle_deg: float) -> None:
    before, axis = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    wanted = Rotation.from_rotvec(np.radians(angle_deg) * axis).as_matrix()
    found = turn_between(before, wanted @ before)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_several_directions_have_a_turn_each() -> None:
    before, now = np.array([0.0, 0.0, 1.0]), np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    found = turn_between(before, now)
    assert found.shape == (2, 3, 3)
    np.testing.assert_allclose(found @ before, now, atol=1e-15)


def test_opposite_directions_give_numbers() -> None:
    assert np.isfinite(turn_between(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))).all()
