# SPDX-License-Identifier: Apache-2.0
"""The camera's rotation, by where it puts the axes."""

import math

import numpy as np
import pytest

from asglight.viewer.state.camera import PITCH_MAX_DEG, Camera


def test_at_rest_the_camera_has_the_axes_of_the_world() -> None:
    np.testing.assert_allclose(Camera().from_environment(), np.eye(3), atol=1e-15)


@pytest.mark.parametrize("camera", [Camera(40, 20, 70), Camera(-170, -80, 3)])
def test_it_is_a_rotation(camera: Camera) -> None:
    matrix = camera.from_environment()
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)  # rounding of float64
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_from_plus_x_the_plus_x_axis_comes_towards_the_camera() -> None:
    matrix = Camera(yaw_deg=90).from_environment()
    np.testing.assert_allclose(matrix @ [1, 0, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(matrix @ [0, 1, 0], [0, 1, 0], atol=1e-12)


def test_from_above_the_zenith_comes_towards_the_camera() -> None:
    towards = Camera(pitch_deg=60).from_environment() @ [0, 1, 0]
    np.testing.assert_allclose(towards, [0, 0.5, math.sqrt(3) / 2], atol=1e-12)


def test_turning_the_environment_takes_its_front_to_plus_x() -> None:
    matrix = Camera(environment_deg=90).from_environment()
    np.testing.assert_allclose(matrix @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_a_drag_to_the_right_turns_the_front_of_the_balls_to_the_right() -> None:
    camera = Camera()
    camera.orbit(10, 0)
    assert (camera.from_environment() @ [0, 0, 1])[0] > 0.05
    camera.orbit(0, 10)  # down: the top comes to the front
    assert (camera.from_environment() @ [0, 1, 0])[2] > 0.05


def test_the_camera_stops_at_the_poles_and_goes_round_the_equator() -> None:
    camera = Camera()
    camera.orbit(0, 1e4)
    assert camera.pitch_deg == PITCH_MAX_DEG
    camera.orbit(1e4, 0)
    camera.turn_environment(540)
    assert -180 <= camera.yaw_deg < 180
    assert camera.environment_deg == -180
    camera.reset()
    assert camera == Camera()
