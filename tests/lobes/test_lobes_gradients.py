# SPDX-License-Identifier: Apache-2.0
"""Gradients of the lobe maths against finite differences in float64.

Sharpness enters by its logarithm, so that a step of 1e-6 means the same at both of its limits.
"""

import lobe_samples
import pytest
import torch
from lobe_samples import ANISOTROPIC, FORMS, double

from asglight.lobes import Form, Lobes, asg

AXES = [(0, 0, -1), (0, 1, 0), (0, -1, 0), (0.6, 0.5, 0.7), (-1, 0.2, -0.4)]
"""On the latlong seam, at both poles, and two in general position."""

SHARPNESS = [(1e-3, 1e-3), (1e7, 1e7), (1e7, 2.5e4), (9.0, 2.0), (0.5, 40.0)]
"""At both limits, at the ratio 400, and two between."""

# second moments are checked where the sharpnesses differ, so that a step keeps their order
UNEQUAL = [(1e-3, 2e-3), (2.5e4, 1e7), (9.0, 2.0), (0.5, 40.0), (3e-3, 1.2)]


def _directions_near(axes: torch.Tensor, sharpness: torch.Tensor) -> torch.Tensor:
    """Return directions a fraction of its width from each lobe's axis, where gradients are large.

    None is nearer than 1e-5, ten steps, to a horizon of the asg form, where it has a kink.
    """
    offsets = double([[0.4, 0.3], [-0.5, 0.2], [0.1, -0.6]])
    xy = offsets[None] / sharpness.clamp(min=1).sqrt()[:, None]  # [N, 3, 2]
    z = (1 - xy.square().sum(-1, keepdim=True)).sqrt()
    return (torch.cat([xy, z], dim=-1) @ axes).reshape(-1, 3)


@pytest.mark.parametrize("form", FORMS)
def test_gradients_of_evaluate_equal_finite_differences(form: Form) -> None:
    start = lobe_samples.pointing(AXES)
    directions = _directions_near(start, double(SHARPNESS))
    # at sharpness 1e7 a value changes 3000 times as fast with the axes as at sharpness 1, so the
    # axes are moved in widths of the lobe
    width = double(SHARPNESS).amax(-1).clamp(min=1).rsqrt()[:, None, None]

    def radiance(moved: torch.Tensor, log_s: torch.Tensor, amplitude: torch.Tensor) -> torch.Tensor:
        lobes = Lobes(start + width * moved, log_s.exp(), amplitude, form)
        return asg.evaluate(lobes, directions)

    inputs = [
        torch.zeros_like(start),
        double(SHARPNESS).log(),
        double([[1.0, 2.0, 0.5]]).expand(5, 3).clone(),
    ]
    assert torch.autograd.gradcheck(radiance, [t.requires_grad_() for t in inputs], atol=1e-7)


@pytest.mark.parametrize("form", FORMS)
def test_gradients_of_the_integral_equal_finite_differences(form: Form) -> None:
    axes = lobe_samples.pointing(AXES)

    def log_integral(log_s: torch.Tensor) -> torch.Tensor:
        return asg.integral(Lobes(axes, log_s.exp(), torch.ones_like(axes[..., 0]), form)).log()

    for pairs in (SHARPNESS, UNEQUAL):
        log_sharpness = double(pairs).log().requires_grad_()
        assert torch.autograd.gradcheck(log_integral, [log_sharpness], atol=1e-8, rtol=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_gradients_of_the_moments_equal_finite_differences(form: Form) -> None:
    axes = lobe_samples.pointing(AXES)

    def log_moments(log_s: torch.Tensor) -> torch.Tensor:
        lobes = Lobes(axes, log_s.exp(), torch.ones_like(axes[..., 0]), form)
        zeroth, first, second = asg.moments(lobes)
        parts = [zeroth[:, None], second] + ([] if form is Form.BINGHAM else [first[:, None]])
        return torch.cat(parts, dim=-1).log()

    sharpness = double(UNEQUAL)
    if form is Form.BINGHAM:
        # the derivative of x^2 loses a factor of sharpness squared: at 1e5 it is good to 1e-6
        sharpness = sharpness.clamp(max=1e5)
    log_sharpness = sharpness.log().requires_grad_()
    # steps of 1e-4: values good to 7e-12 give differences good to 1e-7
    assert torch.autograd.gradcheck(log_moments, [log_sharpness], eps=1e-4, atol=2e-6, rtol=1e-6)


def test_first_moment_of_bingham_has_no_gradient() -> None:
    """It is 0 by symmetry for any sharpness."""
    lobes = lobe_samples.random_lobes(3, Form.BINGHAM)
    lobes.sharpness.requires_grad_()
    first = asg.moments(lobes).first
    assert (first == 0).all()
    assert not first.requires_grad


@pytest.mark.parametrize("form", ANISOTROPIC)
def test_gradients_are_finite_for_sharpness_far_outside_its_limits(form: Form) -> None:
    axes = lobe_samples.pointing(AXES[:3])
    sharpness = double([(1e-6, 1e-6), (1e10, 1e-6), (1e10, 1e10)]).requires_grad_()
    zeroth, _, second = asg.moments(Lobes(axes, sharpness, torch.ones_like(axes[..., 0]), form))
    (zeroth.sum() + second.sum()).backward()
    assert sharpness.grad is not None
    assert torch.isfinite(sharpness.grad).all()
