# SPDX-License-Identifier: Apache-2.0
"""Lobes that stand in for each other are found, and no others."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import torch
from lobe_cases import lamps

from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.steps import condition
from asglight.fitting.steps.condition import Trade
from asglight.lobes import Form

UP, SIDE = (0.0, 1.0, 0.1), (1.0, 0.0, 0.2)


def _hessian(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    jacobian = torch.randn(40, UNKNOWNS * count, generator=generator, dtype=torch.float64)
    # unknowns of very different sizes, as sharpness and radiance are
    return (jacobian.mT @ jacobian) * torch.logspace(-4, 4, UNKNOWNS * count).double().outer(
        torch.logspace(-4, 4, UNKNOWNS * count).double()
    )


def test_correlation_is_what_is_left_when_the_other_lobe_undoes_a_change() -> None:
    hessian = _hessian(3)
    found = condition.correlations(hessian)
    blocks = hessian.numpy().reshape(3, UNKNOWNS, 3, UNKNOWNS)
    for one, other in [(0, 1), (2, 0), (1, 2)]:
        own = blocks[one, :, one]
        undone = blocks[one, :, other] @ np.linalg.solve(
            blocks[other, :, other], blocks[other, :, one]
        )
        size = np.sqrt(np.diag(own))
        scaled = [matrix / size[:, None] / size for matrix in (own - undone, own)]
        left = scipy.linalg.eigh(*scaled, eigvals_only=True)[0]
        # conditioned to about 1e4 once scaled
        assert float(found[one, other]) == pytest.approx(math.sqrt(1 - left), abs=1e-8)
        assert float(found[one, other]) == pytest.approx(float(found[other, one]), abs=1e-8)


@pytest.mark.parametrize("form", list(Form))
def test_two_lobes_in_one_place_trade_and_a_third_does_not(form: Form) -> None:
    lobes = lamps([UP, UP, SIDE], [40.0, 40.0, 60.0], [2.0, 1.0, 3.0])
    lobes = replace(lobes, form=form)
    (found,) = condition.trades(lobes)
    assert found.lobes == (0, 1)
    assert found.amplification > 1e4  # float32 images


def test_lobes_apart_do_not_trade() -> None:
    lobes = lamps([UP, SIDE, (-1.0, 0.0, 0.2)], [40.0, 60.0, 50.0], [2.0, 3.0, 1.0])
    assert condition.trades(lobes) == []


def test_the_nearer_two_lobes_are_the_more_they_trade() -> None:
    found = []
    for degrees in (4.0, 8.0, 24.0):
        angle = math.radians(degrees)
        near = (math.sin(angle), math.cos(angle), 0.0)
        pair = lamps([(0.0, 1.0, 0.0), near], [100.0, 100.0], [1.0, 1.0])
        found.append(condition.trades(pair, limit=0.0)[0].amplification)
    assert found[0] > 3 * found[1] > 9 * found[2]  # of lobes 4 degrees wide
    assert found[2] < 3


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_the_unit_of_light_does_not_matter(scale: float) -> None:
    places, sharpness = [UP, (0.2, 1.0, 0.1), SIDE], [40.0, 40.0, 60.0]
    dim = condition.trades(lamps(places, sharpness, [2.0, 1.0, 3.0]), limit=0.0)
    bright = condition.trades(lamps(places, sharpness, [scale * x for x in (2, 1, 3)]), limit=0.0)
    for one, other in zip(dim, bright, strict=True):
        assert one.lobes == other.lobes
        assert other.amplification == pytest.approx(one.amplification, rel=1e-3)  # float32 images


def test_the_least_radiance_that_float32_has_is_light_as_any() -> None:
    """Its flux is 0 in float32."""
    places, sharpness = [UP, (0.2, 1.0, 0.1), SIDE], [40.0, 40.0, 60.0]
    least = condition.trades(lamps(places, sharpness, [2.0**-149] * 3), limit=0.0)
    usual = condition.trades(lamps(places, sharpness, [1.0] * 3), limit=0.0)
    assert [one.lobes for one in least] == [one.lobes for one in usual]
    for one, other in zip(least, usual, strict=True):
        assert one.amplification == pytest.approx(other.amplification, rel=1e-6)


def test_black_lobes_trade_with_none() -> None:
    assert condition.trades(lamps([UP, UP], [40.0, 40.0], [2.0, 0.0])) == []
    assert condition.trades(lamps([UP, UP], [40.0, 40.0], [0.0, 0.0])) == []


def test_trades_are_gathered() -> None:
    found = [Trade((0, 3), 900.0), Trade((1, 2), 300.0), Trade((3, 5), 200.0)]
    assert condition.groups(found) == [[0, 3, 5], [1, 2]]
    assert condition.groups([*found, Trade((2, 5), 150.0)]) == [[0, 1, 2, 3, 5]]
    assert condition.groups([]) == []
