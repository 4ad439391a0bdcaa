# SPDX-License-Identifier: Apache-2.0
"""Quaternions of frames against scipy's rotations, in every branch and over time."""

import math

import lobe_samples
import numpy as np
import pytest
import torch
from lobe_samples import double
from scipy.spatial.transform import Rotation

from asglight.lobes import frames

HALF_TURNS = {
    "none": ((1.0, 0, 0), 0.0, [1, 0, 0, 0]),
    "about x": ((1.0, 0, 0), math.pi, [0, 1, 0, 0]),
    "about y": ((0, 1.0, 0), math.pi, [0, 0, 1, 0]),
    "about z": ((0, 0, 1.0), math.pi, [0, 0, 0, 1]),
}
"""One for each component that can be the largest, and so the divisor."""


def _axes(rotation: Rotation) -> torch.Tensor:
    """Rows are the images of +X, +Y, +Z."""
    matrix = rotation.as_matrix()
    return double(np.swapaxes(matrix, -1, -2))


def _wxyz(rotation: Rotation) -> np.ndarray:
    quaternion = np.roll(rotation.as_quat(), 1, axis=-1)
    return quaternion * np.where(quaternion[..., :1] < 0, -1, 1)


def test_a_quarter_turn_about_y_takes_x_to_minus_z() -> None:
    root = math.sqrt(0.5)
    axes = frames.axes_from_quaternion(double([root, 0, root, 0]))
    np.testing.assert_allclose(axes.numpy(), [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-15)
    back = frames.quaternion_from_axes(axes)
    np.testing.assert_allclose(back.numpy(), [root, 0, root, 0], atol=1e-15)


@pytest.mark.parametrize("name", HALF_TURNS)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_each_branch_keeps_all_digits(name: str, dtype: torch.dtype) -> None:
    axis, angle, exact = HALF_TURNS[name]
    generator = np.random.default_rng(31)
    nearby = Rotation.from_rotvec(generator.normal(size=(200, 3)) * 0.1)
    rotations = nearby * Rotation.from_rotvec(np.asarray(axis) * angle)
    found = frames.quaternion_from_axes(_axes(rotations).to(dtype))
    assert (found[:, 0] >= 0).all()
    # where w is next to 0 either sign is right
    sign = np.sign((found.numpy() * _wxyz(rotations)).sum(-1, keepdims=True))
    epsilon = torch.finfo(dtype).eps
    np.testing.assert_allclose(found.numpy() * sign, _wxyz(rotations), atol=4 * epsilon)
    literal = frames.quaternion_from_axes(
        _axes(Rotation.from_rotvec(np.asarray(axis) * angle)).to(dtype)
    )
    np.testing.assert_allclose(literal.abs().numpy(), exact, atol=epsilon)


def test_random_rotations_equal_scipy_and_return() -> None:
    rotations = lobe_samples.random_rotations(2000, seed=32)
    axes = _axes(rotations)
    found = frames.quaternion_from_axes(axes)
    np.testing.assert_allclose(found.norm(dim=-1).numpy(), 1, atol=1e-15)
    np.testing.assert_allclose(found.numpy(), _wxyz(rotations), atol=2e-15)
    np.testing.assert_allclose(frames.axes_from_quaternion(found).numpy(), axes.numpy(), atol=3e-15)


def test_quaternions_return_through_frames_whatever_their_length() -> None:
    quaternion = double(np.random.default_rng(33).normal(size=(3, 50, 4)))
    expected = quaternion / quaternion.norm(dim=-1, keepdim=True)
    expected = expected * torch.where(expected[..., :1] < 0, -1.0, 1.0)
    axes = frames.axes_from_quaternion(quaternion * 5)
    assert axes.shape == (3, 50, 3, 3)
    found = frames.quaternion_from_axes(axes)
    np.testing.assert_allclose(found.numpy(), expected.numpy(), atol=3e-15)


def test_continuous_quaternions_follow_two_whole_turns_without_a_jump() -> None:
    angles = np.linspace(0, 4 * math.pi, 61)
    spin = Rotation.from_rotvec(angles[:, None] * np.array([0.48, 0.6, 0.64]))
    other = Rotation.from_rotvec(-0.5 * angles[:, None] * np.array([0.0, 1.0, 0.0]))
    axes = torch.stack([_axes(spin), _axes(other)], dim=1)  # [F, 2, 3, 3]
    jumping = frames.quaternion_from_axes(axes)
    assert ((jumping[1:] * jumping[:-1]).sum(-1) < 0).any(), "the plain ones do jump"
    found = frames.continuous_quaternions(jumping)
    assert torch.equal(found[0], jumping[0])
    assert torch.equal(found.abs(), jumping.abs())
    # neighbours 12 degrees of rotation apart are 6 degrees apart as quaternions
    dots = (found[1:] * found[:-1]).sum(-1)
    np.testing.assert_allclose(dots[:, 0].numpy(), math.cos(angles[1] / 2), atol=1e-14)
    np.testing.assert_allclose(dots[:, 1].numpy(), math.cos(angles[1] / 4), atol=1e-14)
    exact = np.cos(angles / 2)
    np.testing.assert_allclose(found[:, 0, 0].numpy(), exact, atol=1e-14)


def test_continuous_quaternions_of_one_frame_are_those() -> None:
    one = double([[[-0.5, 0.5, 0.5, 0.5]]])
    assert torch.equal(frames.continuous_quaternions(one), one)


def _swing_and_twist(start: Rotation, turn: Rotation) -> tuple[np.ndarray, float]:
    """Return the rotation vector that turns z along the great circle, and the angle about it."""
    ends = [one.apply([0.0, 0, 1]) for one in (start, turn * start)]
    cross = np.cross(*ends)
    swing = cross / np.linalg.norm(cross) * np.arctan2(np.linalg.norm(cross), np.dot(*ends))
    left = start.inv() * Rotation.from_rotvec(swing).inv() * turn * start
    return swing, float(left.as_rotvec()[2])


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
def test_frames_turn_along_the_great_circle_and_evenly_about_their_direction(part: float) -> None:
    turns = np.random.default_rng(2).uniform(-1.5, 1.5, size=(50, 3))  # by up to 150 degrees
    for seed, vector in enumerate(turns):
        start, turn = Rotation.random(rng=seed), Rotation.from_rotvec(vector)
        swing, twist = _swing_and_twist(start, turn)
        spun = start * Rotation.from_rotvec([0, 0, part * twist])
        expected = Rotation.from_rotvec(part * swing) * spun
        parts = torch.tensor(part, dtype=torch.float64)
        found = frames.between(_axes(start), _axes(turn * start), parts)
        np.testing.assert_allclose(found.numpy(), _axes(expected).numpy(), atol=1e-12)


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
def test_frames_that_do_not_turn_or_turn_round_end_where_they_should(part: float) -> None:
    start = lobe_samples.random_rotations(20, seed=1)
    tiny = Rotation.from_rotvec(np.random.default_rng(3).uniform(-1e-14, 1e-14, (20, 3))) * start
    parts = torch.full((20,), part, dtype=torch.float64)
    for end in (start, tiny):
        found = frames.between(_axes(start), _axes(end), parts)
        np.testing.assert_allclose(found.numpy(), _axes(end).numpy(), atol=1e-13)
    opposite = start * Rotation.from_rotvec([math.pi, 0, 0])  # z to -z, about x
    found = frames.between(_axes(start), _axes(opposite), parts)
    expected = start * Rotation.from_rotvec([part * math.pi, 0, 0])
    np.testing.assert_allclose(found.numpy(), _axes(expected).numpy(), atol=1e-12)
