# SPDX-License-Identifier: Apache-2.0
"""Frames that mean the same lobe: canonical order, alignment and continuity over time."""

import math

import lobe_samples
import numpy as np
import pytest
import torch
from lobe_samples import ANISOTROPIC, FORMS, double, lobes_of
from scipy.spatial.transform import Rotation

from asglight.lobes import Form, Lobes, asg, frames
from asglight.lobes.data import stack

QUARTER = double([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
FLIP = double(np.diag([1.0, -1, -1]))

ROUNDING = 1e-14


def _assert_same_frames(found: torch.Tensor, expected: torch.Tensor, atol: float = 1e-13) -> None:
    np.testing.assert_allclose(found.numpy(), expected.numpy(), rtol=0, atol=atol)


def _assert_right_handed(axes: torch.Tensor, atol: float = ROUNDING) -> None:
    gram = axes @ axes.mT
    np.testing.assert_allclose(gram.numpy(), np.broadcast_to(np.eye(3), gram.shape), atol=atol)
    np.testing.assert_allclose(torch.linalg.det(axes).numpy(), 1, atol=atol)


def _rewritten(lobes: Lobes, turns: np.ndarray, flips: np.ndarray) -> Lobes:
    """Rewrite each lobe by quarter turns (0..3) and, where flipped, with z reversed."""
    axes, sharpness = lobes.axes.clone(), lobes.sharpness.clone()
    for index in np.ndindex(turns.shape):
        equal = torch.linalg.matrix_power(QUARTER, int(turns[index]))
        if flips[index]:
            equal = equal @ FLIP
        axes[index] = equal @ axes[index]
        if turns[index] % 2:
            sharpness[index] = sharpness[index].flip(-1)
    return Lobes(axes, sharpness, lobes.amplitude, lobes.form)


def _moving_shot(form: Form, frame_count: int = 24, count: int = 5) -> Lobes:
    """Return lobes that each turn about their own line, some changing which sharpness is larger."""
    rng = np.random.default_rng(21)
    start = lobe_samples.random_rotations(count, seed=22)
    spin = rng.normal(size=(count, 3)) * 0.12  # radians a frame, below 45 degrees
    axes, sharpness = [], []
    for frame in range(frame_count):
        # rows are axes, and R d turns each axis: rows times the transpose
        turned = start.as_matrix() @ np.swapaxes(
            Rotation.from_rotvec(spin * frame).as_matrix(), 1, 2
        )
        mix = frame / (frame_count - 1)
        first = 30.0 ** (1 - mix) * 2.0**mix
        axes.append(turned)
        sharpness.append(np.stack([[first, 10.0]] * count))
    return lobes_of(double(np.stack(axes)), np.stack(sharpness), form)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, 1, 1), (0.3, -0.2, 0.9)])
def test_axes_around_a_direction_are_a_right_handed_frame(axis: tuple[float, ...]) -> None:
    z = double(np.asarray(axis) / np.linalg.norm(axis))
    found = frames.axes_around(z)
    assert torch.equal(found[2], z)
    _assert_right_handed(found)


def test_axes_around_many_directions_are_frames_in_float32() -> None:
    z = lobe_samples.random_directions(500).float()
    found = frames.axes_around(z)
    assert found.dtype == torch.float32
    _assert_right_handed(found.double(), atol=1e-6)


def test_orthonormal_repairs_a_frame_and_keeps_the_direction_of_z() -> None:
    exact = lobe_samples.random_axes(50)
    noise = torch.from_numpy(np.random.default_rng(1).normal(size=(50, 3, 3)))
    bent = 1.7 * (exact + 0.05 * noise)
    found = frames.orthonormal(bent)
    _assert_right_handed(found)
    unit_z = bent[:, 2] / bent[:, 2].norm(dim=-1, keepdim=True)
    _assert_same_frames(found[:, 2], unit_z)
    _assert_same_frames(frames.orthonormal(exact), exact)
    assert ((found - exact).abs().amax() < 0.5).item(), "x keeps its side"


@pytest.mark.parametrize("form", FORMS)
def test_canonical_puts_the_larger_sharpness_first_and_changes_no_radiance(form: Form) -> None:
    lobes = lobe_samples.random_lobes(20, form)
    ordered = frames.canonical(lobes)
    assert (ordered.sharpness[:, 0] >= ordered.sharpness[:, 1]).all()
    assert torch.equal(ordered.sharpness.sort(-1).values, lobes.sharpness.sort(-1).values)
    assert torch.equal(ordered.axis_z, lobes.axis_z)
    _assert_right_handed(ordered.axes)
    directions = lobe_samples.random_directions(100)
    torch.testing.assert_close(
        asg.evaluate(ordered, directions), asg.evaluate(lobes, directions), rtol=1e-13, atol=1e-15
    )
    again = frames.canonical(ordered)
    assert torch.equal(again.axes, ordered.axes)


@pytest.mark.parametrize("form", FORMS)
def test_align_changes_no_radiance_whatever_came_before(form: Form) -> None:
    lobes, previous = (lobe_samples.random_lobes(30, form, seed) for seed in (1, 2))
    aligned = frames.align(lobes, previous)
    directions = lobe_samples.random_directions(100)
    torch.testing.assert_close(
        asg.evaluate(aligned, directions), asg.evaluate(lobes, directions), rtol=1e-11, atol=1e-14
    )
    _assert_right_handed(aligned.axes)


def test_align_finds_the_nearest_of_the_four_equal_frames_however_far() -> None:
    lobes, previous = (lobe_samples.random_lobes(300, Form.ASG, seed) for seed in (3, 4))
    found = frames.align(lobes, previous)
    angle = _angles(found.axes, previous.axes)
    for turns in range(4):
        other = _rewritten(lobes, np.full(300, turns), np.zeros(300))
        assert (angle <= _angles(other.axes, previous.axes) + 1e-7).all()


def test_align_finds_the_nearest_of_the_eight_equal_bingham_frames_within_a_quarter_turn() -> None:
    previous = lobe_samples.random_lobes(300, Form.BINGHAM, seed=5)
    rng = np.random.default_rng(6)
    vector = rng.normal(size=(300, 3))
    vector *= rng.uniform(0, math.radians(60), (300, 1)) / np.linalg.norm(vector, axis=1)[:, None]
    moved = previous.axes @ double(Rotation.from_rotvec(vector).as_matrix())
    lobes = _rewritten(
        Lobes(moved, previous.sharpness, previous.amplitude, Form.BINGHAM),
        rng.integers(0, 4, 300),
        rng.integers(0, 2, 300),
    )
    angle = _angles(frames.align(lobes, previous).axes, previous.axes)
    for turns in range(4):
        for flip in (0, 1):
            other = _rewritten(lobes, np.full(300, turns), np.full(300, flip))
            assert (angle <= _angles(other.axes, previous.axes) + 1e-7).all()


def _angles(axes: torch.Tensor, other: torch.Tensor) -> np.ndarray:
    relative = Rotation.from_matrix((axes @ other.mT).numpy())
    return relative.magnitude()


@pytest.mark.parametrize("form", ANISOTROPIC)
def test_continuous_undoes_equal_frames_and_follows_the_sharpnesses_through_each_other(
    form: Form,
) -> None:
    smooth = _moving_shot(form)
    assert smooth.sharpness[0, 0, 0] > smooth.sharpness[0, 0, 1]
    assert smooth.sharpness[-1, 0, 0] < smooth.sharpness[-1, 0, 1], "they change places on the way"
    rng = np.random.default_rng(23)
    shape = smooth.axes.shape[:2]
    turns, flips = rng.integers(0, 4, shape), rng.integers(0, 2, shape)
    turns[0] = flips[0] = 0
    if form is Form.ASG:
        flips[:] = 0  # only the bingham form is the same with z reversed
    found = frames.continuous(_rewritten(smooth, turns, flips))
    _assert_same_frames(found.axes, smooth.axes)
    assert torch.equal(found.sharpness, smooth.sharpness)
    assert torch.equal(found.amplitude, smooth.amplitude)


def test_continuous_starts_in_canonical_order() -> None:
    smooth = _moving_shot(Form.ASG)
    shape = smooth.axes.shape[:2]
    found = frames.continuous(_rewritten(smooth, np.full(shape, 1), np.zeros(shape)))
    assert (found.sharpness[0, :, 0] > found.sharpness[0, :, 1]).all()
    # two quarter turns from where they were: x reversed
    _assert_same_frames(found.axis_x[0], -smooth.axis_x[0])
    _assert_same_frames(found.axis_z, smooth.axis_z)


@pytest.mark.parametrize("form", FORMS)
def test_continuous_changes_no_radiance(form: Form) -> None:
    shot = stack([lobe_samples.random_lobes(4, form, seed) for seed in range(6)])
    directions = lobe_samples.random_directions(60)
    torch.testing.assert_close(
        asg.evaluate(frames.continuous(shot), directions),
        asg.evaluate(shot, directions),
        rtol=1e-11,
        atol=1e-14,
    )


def test_continuous_of_sg_turns_each_frame_the_shortest_way() -> None:
    axis_z = [(math.sin(0.2 * f), 0.3, math.cos(0.2 * f)) for f in range(20)]
    shot = lobes_of(lobe_samples.pointing(axis_z, seed=24)[:, None], (5.0, 5.0), Form.SG)
    found = frames.continuous(shot).axes[:, 0]
    _assert_right_handed(found)
    _assert_same_frames(found[:, 2], shot.axis_z[:, 0])
    # a rotation's angle is at least that of the axis it moves; the shortest way has no more
    between = np.arccos((found[1:, 2] * found[:-1, 2]).sum(-1).numpy())
    np.testing.assert_allclose(_angles(found[1:], found[:-1]), between, atol=1e-7)


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 1.0, 60.0, 120.0, 179.0, 179.9])
def test_parallel_transport_is_the_rotation_about_the_common_normal(degrees: float) -> None:
    axes = lobe_samples.random_axes(10, seed=25)
    normal = (axes[:, 0] * 0.6 + axes[:, 1] * 0.8).numpy()
    rotation = Rotation.from_rotvec(normal * math.radians(degrees))
    expected = np.stack([rotation.apply(axes[:, row].numpy()) for row in range(3)], axis=1)
    found = frames.parallel_transport(axes, double(expected[:, 2]))
    # near the opposite direction the normal is a quotient of two small numbers
    from_opposite = 1 + math.cos(math.radians(degrees))
    _assert_same_frames(found, double(expected), atol=1e-14 + 2e-15 / from_opposite)


def test_parallel_transport_to_the_opposite_direction_is_a_half_turn() -> None:
    axes = lobe_samples.random_axes(10, seed=26)
    found = frames.parallel_transport(axes, -axes[:, 2])
    _assert_same_frames(found[:, 2], -axes[:, 2])
    _assert_right_handed(found)
    np.testing.assert_allclose(_angles(found, axes), math.pi, atol=1e-7)
