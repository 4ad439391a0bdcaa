# SPDX-License-Identifier: Apache-2.0
"""Mixtures of first frames that are compiled, against the same in torch."""

import math

import pytest
import torch
from torch import Tensor

from asglight import c_library as library
from asglight.fitting import compiled
from asglight.fitting.first_frame import seeding
from asglight.fitting.first_frame.seeding import Cells, Mixture
from asglight.lobes import asg

pytestmark = pytest.mark.skipif(
    compiled.LIBRARY is None and library.compiler() is None, reason="there is no C compiler"
)

AGREE = 1e-9
"""Relative to what is compared: sums differ in the last bits of float64, and a narrow lobe's width
is what is left of moments 1e5 times as large."""


def source(rows: int, lamps: int, seed: int) -> Cells:
    """Return cells of noise with lamps of single texels, each with much of the light."""
    generator = torch.Generator().manual_seed(seed)
    radiance = torch.rand(rows, 2 * rows, 3, generator=generator) ** 4
    places = torch.randperm(2 * rows**2, generator=generator)[:lamps]
    radiance.view(-1, 3)[places] += 1000.0
    return seeding.cells(radiance)


def both(given: Cells, taken: Tensor, monkeypatch: pytest.MonkeyPatch) -> tuple[Mixture, Mixture]:
    """Return the mixture that is compiled and the one of torch."""
    assert compiled.mixes(given.weight)
    found = seeding.expectation_maximisation(given, taken, 12)
    monkeypatch.setattr(compiled, "LIBRARY", None)
    return found, seeding.expectation_maximisation(given, taken, 12)


def apart(found: Mixture, expected: Mixture) -> float:
    """Return by how much two mixtures differ at most: in shares, directions, and widths' ratio."""
    one, other = found.lobes, expected.lobes
    differences = (
        found.taken - expected.taken,
        one.axis_z - other.axis_z,
        one.sharpness / other.sharpness - 1,
    )
    return max(float(each.abs().max()) for each in differences)


@pytest.mark.parametrize(("rows", "lamps", "lobes"), [(32, 0, 1), (32, 3, 7), (64, 9, 15)])
def test_it_is_the_mixture_of_torch(
    rows: int, lamps: int, lobes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = source(rows, lamps, seed=lobes)
    start = seeding.mixture(given, lobes, math.inf).taken
    assert apart(*both(given, start, monkeypatch)) < AGREE


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_a_number_of_cells_that_fills_no_vector_is_no_other_light(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = source(32, 3, seed=1)
    given = Cells(
        few.flux[:count],
        few.weight[:count] / few.weight[:count].sum(),
        few.mean[:count],
        few.second[:count],
        few.variance_min,
    )
    taken = seeding._shares_of(torch.arange(count) % 2, 2)
    assert apart(*both(given, taken, monkeypatch)) < AGREE


def test_cells_that_no_density_reaches_go_to_the_nearest_lobe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # two lobes that took a texel each are 0.2 texels wide: of the rest they reach nothing
    given = source(64, 2, seed=3)
    lamps = given.weight.topk(2).indices
    taken = torch.zeros(len(given.weight), 2, dtype=torch.float64)
    taken[lamps, torch.arange(2)] = 1
    assert compiled.mixes(given.weight)
    found = seeding.expectation_maximisation(given, taken, 1)
    centre = torch.nn.functional.normalize(given.mean, dim=-1)
    cosine = centre @ centre[lamps].mT
    far = cosine.amax(-1) < math.cos(math.radians(30))
    assert far.any()
    wanted = seeding._shares_of(cosine.argmax(-1), 2)
    torch.testing.assert_close(found.taken[far], wanted[far], rtol=0, atol=0)
    assert apart(*both(given, taken, monkeypatch)) < AGREE


def test_a_lobe_that_takes_nothing_stays_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    given = source(32, 2, seed=4)
    taken = seeding._shares_of(torch.zeros(len(given.weight), dtype=torch.long), 3)
    found, expected = both(given, taken, monkeypatch)
    assert apart(found, expected) < AGREE
    torch.testing.assert_close(found.lobes.axis_z[2].tolist(), [0.0, 1.0, 0.0])


def test_shares_are_those_of_bells_by_their_integral() -> None:
    given = source(32, 3, seed=5)
    start = seeding.mixture(given, 4, math.inf)
    found = seeding.expectation_maximisation(given, start.taken, 1)
    # the first step's lobes are those that the start ended with
    centre = torch.nn.functional.normalize(given.mean, dim=-1)
    cosine = centre @ start.lobes.axis_z.mT
    density = torch.exp(start.lobes.sharpness[:, 0] * (cosine - 1)) / asg.integral(start.lobes)
    likelihood = (given.weight @ start.taken) * density
    shares = likelihood / likelihood.sum(-1, keepdim=True)
    torch.testing.assert_close(found.taken, shares, rtol=1e-6, atol=1e-9)


def test_other_numbers_and_a_missing_library_are_left_to_torch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    weight = source(32, 1, seed=6).weight
    assert compiled.mixes(weight)
    assert not compiled.mixes(weight.float())
    assert not compiled.mixes(weight.to("meta"))
    monkeypatch.setattr(compiled, "LIBRARY", None)
    assert not compiled.mixes(weight)
