# SPDX-License-Identifier: Apache-2.0
"""Lobe values against their defining formulas, symmetries, and float32 against float64."""

import math

import lobe_samples
import numpy as np
import pytest
import torch
from lobe_samples import ANISOTROPIC, FORMS, double, lobes_of, value_of

from asglight.lobes import Form, asg
from asglight.lobes.data import stack

SHARPNESS = [1e-3, 1e-2, 1.0, 1e2, 1e4, 1e6]

IDENTITY = double(np.eye(3))[None]


@pytest.mark.parametrize(
    ("form", "direction", "expected"),
    [
        (Form.ASG, (0.6, 0.0, 0.8), 0.8 * math.exp(-2 * 0.36)),
        (Form.ASG, (0.0, 0.6, 0.8), 0.8 * math.exp(-5 * 0.36)),
        (Form.ASG, (0.6, 0.0, -0.8), 0.0),
        (Form.BINGHAM, (0.6, 0.0, 0.8), math.exp(-2 * 0.36)),
        (Form.BINGHAM, (0.0, 0.6, -0.8), math.exp(-5 * 0.36)),
        (Form.BINGHAM, (0.0, 1.0, 0.0), math.exp(-5)),
        (Form.SG, (0.6, 0.0, 0.8), math.exp(-2 * 0.2)),
        (Form.SG, (0.0, 0.6, -0.8), math.exp(-2 * 1.8)),
        (Form.SG, (0.0, 0.0, -1.0), math.exp(-4)),
    ],
)
def test_unit_lobe_has_the_literal_value(
    form: Form, direction: tuple[float, float, float], expected: float
) -> None:
    found = asg.unit_lobes(lobes_of(IDENTITY, (2.0, 5.0), form), double([direction]))
    assert found.shape == (1, 1)
    assert found.item() == pytest.approx(expected, rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("form", FORMS)
def test_unit_lobes_are_the_defining_formula(form: Form) -> None:
    lobes = lobe_samples.random_lobes(12, form, seed=1)
    directions = lobe_samples.random_directions(400, seed=2)
    found = asg.unit_lobes(lobes, directions).numpy()
    for index in range(12):
        expected = value_of(
            form, lobes.axes[index].numpy(), lobes.sharpness[index].numpy(), directions.numpy()
        )
        # an exponent up to 2000 times the rounding of a dot product
        np.testing.assert_allclose(found[index], expected, rtol=2e-12, atol=1e-15)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("sharpness", SHARPNESS)
def test_lobe_at_its_axis_is_its_amplitude(form: Form, sharpness: float) -> None:
    axes = lobe_samples.random_axes(5, seed=4)
    for index in range(5):
        lobes = lobes_of(axes[index : index + 1], (sharpness, sharpness / 7), form, (3, 0.5, 2e4))
        found = asg.evaluate(lobes, lobes.axis_z)
        np.testing.assert_allclose(found.numpy(), [[3, 0.5, 2e4]], rtol=1e-14)


@pytest.mark.parametrize("form", FORMS)
def test_evaluate_sums_the_lobes_and_their_colours(form: Form) -> None:
    lobes = lobe_samples.random_lobes(6, form, seed=5)
    directions = lobe_samples.random_directions(50, seed=6)
    expected = np.zeros((50, 3))
    for axes, s, amplitude in zip(lobes.axes, lobes.sharpness, lobes.amplitude, strict=True):
        value = value_of(form, axes.numpy(), s.numpy(), directions.numpy())
        expected += value[:, None] * amplitude.numpy()
    np.testing.assert_allclose(asg.evaluate(lobes, directions).numpy(), expected, rtol=1e-11)


@pytest.mark.parametrize("form", FORMS)
def test_evaluate_of_a_batch_is_evaluate_of_each(form: Form) -> None:
    frames = [lobe_samples.random_lobes(4, form, seed) for seed in range(3)]
    directions = lobe_samples.random_directions(20)
    together = asg.evaluate(stack(frames), directions)
    assert together.shape == (3, 20, 3)
    for index, lobes in enumerate(frames):
        torch.testing.assert_close(
            together[index], asg.evaluate(lobes, directions), rtol=1e-13, atol=1e-15
        )


@pytest.mark.parametrize("form", FORMS)
def test_rotated_lobes_at_rotated_directions_are_unchanged(form: Form) -> None:
    lobes = lobe_samples.random_lobes(8, form, seed=7)
    directions = lobe_samples.random_directions(200, seed=8)
    for rotation in lobe_samples.random_axes(4, seed=9):
        turned = asg.rotate(lobes, rotation)
        torch.testing.assert_close(
            asg.evaluate(turned, directions @ rotation.mT),
            asg.evaluate(lobes, directions),
            rtol=1e-11,  # exponents of hundreds times the rounding of two products
            atol=1e-14,
        )
        np.testing.assert_allclose(
            turned.axis_z.numpy(), (rotation @ lobes.axis_z.mT).mT.numpy(), atol=1e-15
        )


def test_rotate_takes_one_rotation_for_each_frame() -> None:
    frames = stack([lobe_samples.random_lobes(4, Form.ASG, seed) for seed in range(2)])
    rotations = lobe_samples.random_axes(2, seed=11)
    turned = asg.rotate(frames, rotations)
    for index in range(2):
        alone = asg.rotate(frames[index], rotations[index])
        torch.testing.assert_close(turned.axes[index], alone.axes)


def test_bingham_is_the_same_behind_the_viewer_and_the_others_are_not() -> None:
    directions = lobe_samples.random_directions(100)
    for form in FORMS:
        lobes = lobe_samples.random_lobes(5, form)
        ahead, behind = (asg.unit_lobes(lobes, d) for d in (directions, -directions))
        assert torch.equal(ahead, behind) == (form is Form.BINGHAM)


def test_asg_is_black_behind_its_horizon() -> None:
    lobes = lobe_samples.random_lobes(5, Form.ASG)
    directions = lobe_samples.random_directions(300)
    behind = lobes.axis_z @ directions.mT < 0
    values = asg.unit_lobes(lobes, directions)
    assert (values[behind] == 0).all()
    assert (values[~behind] >= 0).all()


def test_sg_does_not_depend_on_its_x_axis() -> None:
    turn = 0.7
    lobes = lobe_samples.random_lobes(3, Form.SG)
    spin = double(
        [[math.cos(turn), math.sin(turn), 0], [-math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    directions = lobe_samples.random_directions(50)
    turned = lobes_of(spin @ lobes.axes, lobes.sharpness, Form.SG, lobes.amplitude)
    torch.testing.assert_close(
        asg.evaluate(turned, directions), asg.evaluate(lobes, directions), rtol=1e-11, atol=1e-15
    )


def _directions_across(axes: np.ndarray, sharpness: np.ndarray, count: int) -> np.ndarray:
    """Return directions spread over the lobe's own width, so that its values are not all 0."""
    xy = np.random.default_rng(12).normal(size=(count, 2)) / np.sqrt(np.maximum(sharpness, 1))
    xy /= np.sqrt(1.02 + (xy**2).sum(1, keepdims=True))  # into the unit disc, still spread
    z = np.sqrt(1 - (xy**2).sum(1, keepdims=True))
    return np.concatenate([xy, z], axis=1) @ axes


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("ratio", [1.0, 400.0])
@pytest.mark.parametrize("sharpness", SHARPNESS)
def test_float32_is_as_near_to_float64_as_its_directions_allow(
    form: Form, ratio: float, sharpness: float
) -> None:
    """Bound: d.axis_x has an error of 2^-24 or so, and |d exp(-s x^2) / dx| <= sqrt(2 s / e).

    A texel's direction has no more digits than that, so nothing computed from it can; the sg form
    does better, because a difference of near equals is exact. Measured: 0.6 of 2^-24 sqrt(s).
    """
    larger = sharpness * (ratio if sharpness * ratio < 1e6 else 1)
    worst = 0.0
    for index, axes in enumerate(lobe_samples.random_axes(10, seed=13)):
        lobes = lobes_of(axes[None], (larger, larger / ratio), form).to(torch.float32)
        wide = lobes.to(torch.float64)
        spread = wide.sharpness[0].numpy() / (2 if form is Form.SG else 1)
        d = torch.from_numpy(_directions_across(axes.numpy(), spread, 300)).float()
        difference = asg.unit_lobes(lobes, d).double() - asg.unit_lobes(wide, d.double())
        worst = max(worst, difference.abs().max().item())
        assert asg.unit_lobes(lobes, d).max() > 0.5, f"lobe {index} is not met"
    assert worst < 2.0**-24 * (2 * math.sqrt(larger) + 4)


@pytest.mark.parametrize("form", ANISOTROPIC)
def test_a_pole_a_seam_and_a_negative_axis_are_nothing_special(form: Form) -> None:
    for axis in [(0, 1, 0), (0, -1, 0), (0, 0, -1), (-1, 0, 0)]:
        lobes = lobes_of(lobe_samples.pointing([axis]), (40.0, 3.0), form)
        d = double(_directions_across(lobes.axes[0].numpy(), np.array([40.0, 3.0]), 50))
        expected = value_of(form, lobes.axes[0].numpy(), np.array([40.0, 3.0]), d.numpy())
        np.testing.assert_allclose(asg.unit_lobes(lobes, d)[0].numpy(), expected, rtol=1e-13)
