# SPDX-License-Identifier: Apache-2.0
"""The loss against its definition in float64; its slope against autograd; its majoriser."""

import pytest
import torch
from lobe_cases import DOUBLE

from asglight.fitting import objective, probes
from asglight.fitting.probes import PROBES
from asglight.shading import kernels
from asglight.sphere import latlong

CORNERS = objective.Corners(env=0.3, probe=0.02)


def _corner(source: probes.Probe) -> float:
    return objective.EVEN_CORNER if source.kernel == kernels.EVEN else CORNERS.probe


def _map(height: int, seed: int = 0) -> torch.Tensor:
    """Return radiances with a few bright texels.  [H, 2 H, 3]."""
    generator = torch.Generator().manual_seed(seed)
    return 5 * torch.rand(height, 2 * height, 3, generator=generator) ** 4


def _channels_first(image: torch.Tensor) -> torch.Tensor:
    return image.flatten(0, 1).mT.contiguous()


def _term(fit: torch.Tensor, ref: torch.Tensor, share: torch.Tensor, corner: float) -> torch.Tensor:
    """Return mean phi(fit - ref) / mean |ref|, less phi's value at 0.  [P, 3]."""
    scale = (share * ref.norm(dim=-1)).sum()
    size = ((fit - ref).square().sum(-1) + (corner * scale) ** 2).sqrt()
    return (share * size).sum() / scale - corner


def _loss_by_definition(fit: torch.Tensor, ref: torch.Tensor) -> torch.Tensor:
    """Return J of float64 maps [H, 2 H, 3], filtering with a sum over every texel."""
    height = ref.shape[0]
    share = latlong.texel_solid_angles(height, 2 * height, dtype=DOUBLE) / (4 * torch.pi)
    total = objective.ENV_WEIGHT * _term(
        fit.flatten(0, 1), ref.flatten(0, 1), share.reshape(-1), CORNERS.env
    )
    for source, share in zip(PROBES, probes.shares(height, "cpu"), strict=True):
        rows = probes.probe_rows(source, height)
        maps = torch.stack([latlong.reduce(image, rows, 2 * rows) for image in (fit, ref)])
        directions = probes.directions(source, rows).double()
        views = kernels.filtered(maps, source.kernel, directions, normalised=True)
        total = total + source.weight * _term(views[0], views[1], share.double(), _corner(source))
    return total


@pytest.mark.parametrize("height", [24, 64, 50])
def test_value_and_slope_are_those_of_the_definition(height: int) -> None:
    reference, fit = _map(height), 1.2 * _map(height, seed=1)
    frame = objective.target(reference, CORNERS)
    exact = fit.double().requires_grad_()
    loss = _loss_by_definition(exact, reference.double())
    (expected,) = torch.autograd.grad(loss, exact)
    found = objective.value(_channels_first(fit), frame)
    assert float(found) == pytest.approx(float(loss.detach()), rel=1e-5)  # sums in float32
    slope = objective.misfit(_channels_first(fit), frame).slope.double()
    # the even probe alone gives nearly the whole of it: float32 transforms of what is left
    torch.testing.assert_close(
        slope, _channels_first(expected), rtol=1e-4, atol=1e-5 * float(slope.abs().max())
    )


@pytest.mark.parametrize("height", [16, 50, 128])
def test_slope_is_the_derivative_of_the_value(height: int) -> None:
    frame = objective.target(_map(height))
    fit = _channels_first(_map(height, seed=1)).requires_grad_()
    (expected,) = torch.autograd.grad(objective.value(fit, frame), fit)
    found = objective.misfit(fit.detach(), frame).slope
    # both in float32, summed in another order
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5 * float(found.abs().max()))


def _majoriser(away: torch.Tensor, misfit: objective.Misfit, height: int) -> float:
    """Return slope times `away` and half the weighted squares of what it shows.  [3, P]."""
    squares = (misfit.env_weight * away.square()).sum()
    for weight, view in zip(misfit.probe_weights, probes.probe(away, height), strict=True):
        squares += (weight * view.square()).sum()
    return float((misfit.slope * away).double().sum() + 0.5 * squares)


def test_weights_make_a_quadratic_that_lies_above_the_loss() -> None:
    reference, fit = _channels_first(_map(32)), _channels_first(_map(32, seed=1))
    frame = objective.target(_map(32))
    misfit = objective.misfit(fit, frame)
    start = float(objective.value(fit, frame))
    noise = torch.randn(3, 2048, generator=torch.Generator().manual_seed(2))
    for direction in (noise, noise.abs(), -fit, reference - fit, reference, torch.ones(3, 2048)):
        for size in (-3.0, -1.0, -0.1, 0.1, 1.0, 3.0):
            change = float(objective.value(fit + size * direction, frame)) - start
            assert change <= _majoriser(size * direction, misfit, 32) + 1e-5  # J in float32


def test_quadratic_touches_the_loss_where_the_error_is_and_at_its_mirror_image() -> None:
    fit, frame = _channels_first(_map(32, seed=1)), objective.target(_map(32))
    misfit = objective.misfit(fit, frame)
    start = float(objective.value(fit, frame))
    # phi is even, and so is its majoriser: at minus the error both are what they were
    mirrored = 2 * (frame.radiance - fit)
    assert float(objective.value(fit + mirrored, frame)) == pytest.approx(start, rel=1e-5)
    assert _majoriser(mirrored, misfit, 32) == pytest.approx(0.0, abs=1e-5 * start)
    # near the error they differ by the square of the way
    near = 1e-2 * (frame.radiance - fit)
    change = float(objective.value(fit + near, frame)) - start
    assert change == pytest.approx(_majoriser(near, misfit, 32), rel=2e-2)


def test_perfect_fit_has_no_loss_and_black_has_all_of_it() -> None:
    reference = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0))
    frame = objective.target(reference)
    assert float(objective.value(_channels_first(reference), frame)) == pytest.approx(0, abs=1e-5)
    black = float(objective.value(torch.zeros(3, 32 * 64), frame))
    most = objective.ENV_WEIGHT + sum(source.weight for source in PROBES)
    assert 0.8 * most < black < most  # less the rounded corners


def test_loss_does_not_depend_on_the_exposure() -> None:
    reference, fit = _map(32), _channels_first(_map(32, seed=1))
    value = float(objective.value(fit, objective.target(reference)))
    for exposure in (1e-6, 1e6):
        frame = objective.target(exposure * reference)
        brighter = float(objective.value(exposure * fit, frame))
        assert brighter == pytest.approx(value, rel=1e-5)  # float32


def test_going_dark_costs_more_flux_than_everything_else_can_gain() -> None:
    others = [p.weight for p in PROBES if p.kernel != kernels.EVEN]
    (even,) = (p for p in PROBES if p.kernel == kernels.EVEN)
    dark = even.weight * ((1 + objective.EVEN_CORNER**2) ** 0.5 - objective.EVEN_CORNER)
    assert dark > objective.ENV_WEIGHT + sum(others)


def test_perfect_fit_has_no_slope_and_finite_weights() -> None:
    reference = _map(32)
    misfit = objective.misfit(_channels_first(reference), objective.target(reference, CORNERS))
    assert torch.equal(misfit.slope, torch.zeros(3, 2048))
    assert all(bool(w.isfinite().all()) for w in (misfit.env_weight, *misfit.probe_weights))
