# SPDX-License-Identifier: Apache-2.0
"""Moves in local coordinates: what each one does to a lobe, and the bounds of a step."""

import math

import pytest
import torch
from lobe_cases import DOUBLE, random_lobes

from asglight.fitting.loss import coordinates
from asglight.fitting.loss.coordinates import BROAD, UNKNOWNS, advance
from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.data import stack


def _step(count: int, **moves: float) -> torch.Tensor:
    """Return the same step for every lobe; keywords name the unknowns.  [count, 8]."""
    names = ["tilt_x", "tilt_y", "width_x", "width_y", "turn", "red", "green", "blue"]
    return torch.tensor([moves.get(name, 0.0) for name in names], dtype=DOUBLE).repeat(count, 1)


def _shifted_matrix(lobes: Lobes) -> torch.Tensor:
    """Return the matrix that s + 1/2 stand for, in world directions.  [N, 3, 3]."""
    sides = lobes.axes[:, :2]
    return sides.mT @ torch.diag_embed(lobes.sharpness + BROAD) @ sides


@pytest.mark.parametrize("form", list(Form))
def test_no_step_moves_nothing(form: Form) -> None:
    lobes = random_lobes(form)
    moved = advance(lobes, _step(5))
    for name in ("axes", "sharpness", "amplitude"):
        torch.testing.assert_close(getattr(moved, name), getattr(lobes, name))
    assert moved.form is form


def test_tilt_turns_the_axis_towards_the_sides() -> None:
    lobes = random_lobes(Form.ASG)
    moved = advance(lobes, _step(5, tilt_x=0.01, tilt_y=-0.02))
    expected = lobes.axis_z + 0.01 * lobes.axis_x - 0.02 * lobes.axis_y
    expected = expected / expected.norm(dim=-1, keepdim=True)
    torch.testing.assert_close(moved.axis_z, expected)
    torch.testing.assert_close(moved.sharpness, lobes.sharpness)


@pytest.mark.parametrize("form", list(Form))
def test_step_keeps_frames_orthonormal_and_right_handed(form: Form) -> None:
    generator = torch.Generator().manual_seed(4)
    step = 0.3 * torch.randn(5, UNKNOWNS, generator=generator, dtype=DOUBLE)
    moved = advance(random_lobes(form), step)
    identity = torch.eye(3, dtype=DOUBLE).expand(5, 3, 3)
    torch.testing.assert_close(moved.axes @ moved.axes.mT, identity)
    torch.testing.assert_close(torch.linalg.det(moved.axes), torch.ones(5, dtype=DOUBLE))


def test_widths_grow_by_factors_of_the_shifted_sharpness() -> None:
    for form in (Form.ASG, Form.BINGHAM):
        lobes = random_lobes(form)
        moved = advance(lobes, _step(5, width_x=0.3, width_y=-0.2))
        factors = torch.tensor([math.exp(0.3), math.exp(-0.2)], dtype=DOUBLE)
        expected = ((lobes.sharpness + BROAD) * factors - BROAD).clamp(min=asg.SHARPNESS_MIN)
        torch.testing.assert_close(moved.sharpness, expected)
    round_ = random_lobes(Form.SG)
    moved = advance(round_, _step(5, width_x=0.3, width_y=-0.2, turn=0.4))
    expected = (round_.sharpness + BROAD) * math.exp(0.3) - BROAD
    torch.testing.assert_close(moved.sharpness, expected)  # both, by the first width alone
    torch.testing.assert_close(moved.axes, round_.axes)


@pytest.mark.parametrize("form", list(Form))
def test_a_narrow_lobe_keeps_its_flux_whatever_its_width(form: Form) -> None:
    narrow = random_lobes(form)
    narrow = Lobes(narrow.axes, 200 + 20 * narrow.sharpness, narrow.amplitude, form)
    moved = advance(narrow, _step(5, width_x=0.4, width_y=-0.3, turn=0.2))
    assert not torch.allclose(moved.amplitude, narrow.amplitude, rtol=0.01)
    # s + 1/2 for s, and the hemisphere's curve, of 1 / s both
    torch.testing.assert_close(asg.flux(moved), asg.flux(narrow), rtol=0.01, atol=0)


def test_long_lobes_turn_and_round_ones_shear() -> None:
    lobes = random_lobes(Form.ASG, count=20)
    round_ = coordinates.is_round(lobes)
    assert 0 < int(round_.sum()) < 20
    moved = advance(lobes, _step(20, turn=0.2))
    torch.testing.assert_close(moved.axis_z, lobes.axis_z)
    along = (moved.axis_x * lobes.axis_x).sum(-1)
    torch.testing.assert_close(along[~round_], torch.full_like(along[~round_], math.cos(0.2)))
    torch.testing.assert_close(moved.sharpness[~round_], lobes.sharpness[~round_])
    # the shear's determinant is 1
    for before, after in zip(lobes.sharpness[round_], moved.sharpness[round_], strict=True):
        torch.testing.assert_close((after + BROAD).prod(), (before + BROAD).prod())


def test_shear_is_the_matrix_that_the_coordinates_say() -> None:
    lobes = random_lobes(Form.BINGHAM, count=20)
    lobes = lobes.select(coordinates.is_round(lobes))
    moved = advance(lobes, _step(lobes.count, width_x=0.1, width_y=-0.3, turn=0.25))
    root = torch.diag_embed((lobes.sharpness + BROAD).sqrt())
    change = torch.tensor([[0.1, 0.25], [0.25, -0.3]], dtype=DOUBLE)
    inside = root @ torch.linalg.matrix_exp(change) @ root
    expected = lobes.axes[:, :2].mT @ inside @ lobes.axes[:, :2]
    torch.testing.assert_close(_shifted_matrix(moved), expected)
    assert float((moved.axis_x * lobes.axis_x).sum(-1).min()) >= 0.5**0.5  # x stays nearest to x


def _sheared(shifted: torch.Tensor, shape: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return eigenvalues and x of D^1/2 exp(E) D^1/2 by `eigh`, x nearest to x.  [N, 2] twice."""
    first, second, beside = shape.unbind(-1)
    change = torch.stack([first, beside, beside, second], dim=-1).unflatten(-1, (2, 2))
    root = torch.diag_embed(shifted.sqrt())
    values, vectors = torch.linalg.eigh(root @ torch.linalg.matrix_exp(change) @ root)
    swap = vectors[:, 0, 1].abs() > vectors[:, 0, 0].abs()
    near = torch.where(swap[:, None], vectors[:, :, 1], vectors[:, :, 0])
    values = torch.where(swap[:, None], values.flip(-1), values)
    return values, near * torch.where(near[:, :1] < 0, -1.0, 1.0)


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_shear_is_that_of_a_matrix_exponential_and_an_eigensolver(form: Form) -> None:
    generator = torch.Generator().manual_seed(11)
    lobes = random_lobes(form, count=200, seed=2)
    ratio = 0.42 + 1.9 * torch.rand(200, generator=generator, dtype=DOUBLE)  # of round lobes
    shifted = torch.stack([10 * ratio, torch.full_like(ratio, 10)], dim=-1)
    lobes = Lobes(lobes.axes, shifted - BROAD, lobes.amplitude, form)
    assert bool(coordinates.is_round(lobes).all())
    shape = 2 * torch.rand(200, 3, generator=generator, dtype=DOUBLE) - 1  # within SHAPE_MAX
    light = torch.zeros(200, 3, dtype=DOUBLE)
    moved = advance(lobes, torch.cat([torch.zeros(200, 2), shape, light], dim=-1))
    values, near = _sheared(shifted, shape)
    assert float((near[:, 0].square() - 0.5).abs().min()) > 1e-4  # none between x and y
    torch.testing.assert_close(moved.sharpness, values - BROAD)
    expected = near[:, :1] * lobes.axis_x + near[:, 1:] * lobes.axis_y
    torch.testing.assert_close(moved.axis_x, expected)
    torch.testing.assert_close(moved.axis_z, lobes.axis_z)


def test_shear_of_a_round_lobe_lies_between_its_axes() -> None:
    lobes = random_lobes(Form.ASG, count=3)
    round_ = torch.full((3, 2), 7.0, dtype=DOUBLE)
    lobes = Lobes(lobes.axes, round_ - BROAD, lobes.amplitude, lobes.form)
    for turn in (-0.3, 0.3):
        moved = advance(lobes, _step(3, turn=turn))
        # exp([[0, e], [e, 0]]) stretches by e^+-e along the diagonals
        expected = torch.tensor([7 * math.exp(0.3), 7 * math.exp(-0.3)], dtype=DOUBLE) - BROAD
        torch.testing.assert_close(
            moved.sharpness.sort(descending=True).values, expected.repeat(3, 1)
        )
        inside = lobes.axes[:, :2].mT @ torch.tensor(
            [[math.cosh(0.3), math.sinh(turn)], [math.sinh(turn), math.cosh(0.3)]], dtype=DOUBLE
        )
        torch.testing.assert_close(_shifted_matrix(moved), 7 * inside @ lobes.axes[:, :2])
    for still in (0.0, 1e-9):  # in float32, where its square is none
        single = lobes.to(torch.float32)
        moved = advance(single, _step(3, turn=still))
        torch.testing.assert_close(_shifted_matrix(moved), _shifted_matrix(single))


@pytest.mark.parametrize("form", list(Form))
def test_lobes_of_a_batch_move_as_they_would_alone(form: Form) -> None:
    generator = torch.Generator().manual_seed(5)
    frames = [random_lobes(form, count=6, seed=seed) for seed in range(6)]
    step = 0.4 * torch.randn(6, 6, UNKNOWNS, generator=generator, dtype=DOUBLE)
    alone = [advance(lobes, own, 0.1) for lobes, own in zip(frames, step, strict=True)]
    batch = stack(frames)
    axes, sharpness, amplitude = (
        value.unflatten(0, (2, 3)) for value in (batch.axes, batch.sharpness, batch.amplitude)
    )
    moved = advance(Lobes(axes, sharpness, amplitude, form), step.unflatten(0, (2, 3)), 0.1)
    expected = stack(alone)
    for name in ("axes", "sharpness", "amplitude"):
        found = getattr(moved, name)
        assert found.shape[:3] == (2, 3, 6)
        torch.testing.assert_close(found.flatten(0, 1), getattr(expected, name))


def test_at_the_limit_of_round_both_coordinates_move_the_lobe_equally_fast() -> None:
    ratio = coordinates.ROUND_RATIO
    assert ratio - 1 == pytest.approx(ratio**0.5, rel=0.01)  # |sx - sy|, sqrt(sx sy), for sy = 1
    shifted = torch.tensor([[ratio * 0.99, 1.0], [1.0, ratio * 1.01]], dtype=DOUBLE)
    lobes = random_lobes(Form.ASG, count=2)
    lobes = Lobes(lobes.axes, 10 * shifted - BROAD, lobes.amplitude, lobes.form)
    assert coordinates.is_round(lobes).tolist() == [True, False]


def test_light_is_linear_and_never_negative() -> None:
    lobes = random_lobes(Form.ASG)
    moved = advance(lobes, _step(5, red=0.5, green=-0.1, blue=-9.0))
    change = torch.tensor([0.5, -0.1, 0.0], dtype=DOUBLE)
    expected = lobes.amplitude + change
    expected[:, 2] = 0
    torch.testing.assert_close(moved.amplitude, expected)


@pytest.mark.parametrize("form", list(Form))
def test_steps_respect_the_bounds(form: Form) -> None:
    lobes = random_lobes(form)
    moved = advance(lobes, torch.full((5, UNKNOWNS), -50.0, dtype=DOUBLE))
    assert float(moved.amplitude.min()) == 0.0
    assert float(moved.sharpness.min()) >= asg.SHARPNESS_MIN
    # a width's factor is e at most; a shear of all ones is one of e^2 in its own direction
    smallest = (lobes.sharpness + BROAD).amin(-1) * math.exp(-2) - BROAD
    assert bool((moved.sharpness.amin(-1) >= smallest - 1e-9).all())
    identity = moved.axes @ moved.axes.mT
    torch.testing.assert_close(identity, torch.eye(3, dtype=DOUBLE).expand_as(identity))
    sharp = advance(lobes, torch.full((5, UNKNOWNS), 50.0, dtype=DOUBLE), width_min=0.05)
    assert float(texels.lobe_width(sharp).min()) >= 0.05 * (1 - 1e-6)


@pytest.mark.parametrize("form", list(Form))
def test_a_step_tilts_a_lobe_by_its_own_width_at_most(form: Form) -> None:
    lobes = random_lobes(form, count=20)
    narrow = (lobes.sharpness.amin(-1) > 10)[:, None]
    per_variance = {Form.SG: 1.0, Form.FLAT: 2 * 66 / 85}.get(form, 2.0)
    width = (per_variance * lobes.sharpness).rsqrt()
    bound = (coordinates.TILT_MAX_WIDTHS * width).clamp(max=coordinates.TILT_MAX)
    for sign in (-1.0, 1.0):
        moved = advance(lobes, _step(20, tilt_x=sign * 9.0, tilt_y=sign * 9.0))
        # in the tangent plane; the axis itself turns by less
        across = torch.stack([lobes.axis_x, lobes.axis_y], dim=1) @ moved.axis_z[:, :, None]
        tilt = across[..., 0] / (moved.axis_z * lobes.axis_z).sum(-1, keepdim=True)
        torch.testing.assert_close(tilt, sign * bound)
    assert bool((bound[narrow[:, 0]] < coordinates.TILT_MAX).all())
    assert bool(narrow.any())


def test_small_steps_pass_unbounded() -> None:
    lobes = random_lobes(Form.ASG)
    narrowest = float((2 * lobes.sharpness.amax()).rsqrt())
    moved = advance(lobes, _step(5, tilt_x=0.9 * narrowest))
    along = (moved.axis_z * lobes.axis_x).sum(-1)
    expected = math.sin(math.atan(0.9 * narrowest))
    torch.testing.assert_close(along, torch.full_like(along, expected))


def test_sharpness_stays_between_its_limits() -> None:
    lobes = random_lobes(Form.ASG, count=2)
    edge = torch.tensor([[asg.SHARPNESS_MIN] * 2, [asg.SHARPNESS_MAX] * 2], dtype=DOUBLE)
    lobes = Lobes(lobes.axes, edge, lobes.amplitude, lobes.form)
    for move in (-0.5, 0.5):
        found = advance(lobes, _step(2, width_x=move, width_y=move)).sharpness
        assert float(found.min()) >= asg.SHARPNESS_MIN
        assert float(found.max()) <= asg.SHARPNESS_MAX
