# SPDX-License-Identifier: Apache-2.0
"""Median cut and variance cut: flux, halves, the variance by its definition, the papers' figure."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from asglight.peers import cut_lights
from asglight.peers.cut_lights import Region, Sums, median_cut, variance_cut
from asglight.sphere import latlong

Cut = Callable[[torch.Tensor, int], cut_lights.PointLights]
CUTS = pytest.mark.parametrize("cut", [median_cut, variance_cut])


def random_map(seed: int) -> torch.Tensor:
    return torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(seed)) ** 6


@CUTS
@pytest.mark.parametrize("count", [1, 2, 7, 24])
def test_lights_have_the_flux_of_every_channel(cut: Cut, count: int) -> None:
    reference = random_map(count)
    lights = cut(reference, 5 * count + 4)
    assert lights.floats == 5 * count
    flux = latlong.texel_solid_angles(16, 32).double()[..., None] * reference
    torch.testing.assert_close(lights.flux.sum(0), flux.sum((0, 1)), rtol=1e-7, atol=0)
    torch.testing.assert_close(lights.directions.norm(dim=-1), torch.ones(count).double())


@CUTS
def test_a_map_of_lights_keeps_their_flux(cut: Cut) -> None:
    lights = cut(random_map(3), 60)
    means = lights.texel_means(32, 64)
    flux = (latlong.texel_solid_angles(32, 64)[..., None] * means).sum((0, 1))
    torch.testing.assert_close(flux, lights.flux.sum(0).float(), rtol=1e-5, atol=0)


def test_median_cut_gives_lights_of_equal_energy() -> None:
    """Of an even map: 16 lights, all within a texel's share of a sixteenth."""
    lights = median_cut(torch.ones(128, 256, 3), 80)
    share = lights.flux[:, 1] / (4 * math.pi)
    assert len(share) == 16
    # four cuts, each off by half a row of at most 1.2 % or half a column
    np.testing.assert_allclose(share.numpy(), 1 / 16, rtol=0.06)


def test_median_cut_halves_an_even_map_between_left_and_right() -> None:
    """At the equator the map is twice as wide as high."""
    lights = median_cut(torch.ones(16, 32, 3), 10)
    np.testing.assert_allclose(lights.directions[:, 0].abs().numpy(), 1, atol=1e-9)


def test_variance_is_its_definition() -> None:
    reference = random_map(5)
    region = Region(3, 9, 4, 21)
    found = float(cut_lights.variance(Sums(reference).of(region)))
    assert found == pytest.approx(_variance(reference, region), rel=1e-9)


def _variance(reference: torch.Tensor, region: Region) -> float:
    rows, columns = slice(region.top, region.bottom), slice(region.left, region.right)
    energy = reference.double().numpy() @ np.array([0.2126, 0.7152, 0.0722])
    energy = (energy * latlong.texel_solid_angles(16, 32, dtype=torch.float64).numpy())[
        rows, columns
    ]
    directions = latlong.directions(16, 32, dtype=torch.float64).numpy()[rows, columns]
    mean = (energy[..., None] * directions).sum((0, 1)) / energy.sum()
    return float((energy * ((directions - mean) ** 2).sum(-1)).sum())


def test_variance_cut_takes_the_best_of_all_cuts() -> None:
    reference = random_map(6)
    candidates = [(Region(0, row, 0, 32), Region(row, 16, 0, 32)) for row in range(1, 16)] + [
        (Region(0, 16, 0, column), Region(0, 16, column, 32)) for column in range(1, 32)
    ]
    best = min(candidates, key=lambda pair: max(_variance(reference, part) for part in pair))
    flux = latlong.texel_solid_angles(16, 32, dtype=torch.float64)[..., None] * reference
    expected = [flux[r.top : r.bottom, r.left : r.right].sum((0, 1)) for r in best]
    torch.testing.assert_close(
        variance_cut(reference, 10).flux, torch.stack(expected), rtol=1e-9, atol=0
    )


def test_variance_cut_keeps_whole_the_lamp_that_median_cut_slices() -> None:
    """Figure 2 of Viriyothai and Debevec: a bright and a dim lamp, two lights."""
    reference = torch.zeros(16, 32, 3)
    reference[7, 6:10] = 3.0
    reference[7, 22:26] = 1.0
    energy = variance_cut(reference, 10).flux[:, 0]
    assert float(energy.max() / energy.min()) == pytest.approx(3, rel=1e-6)
    sliced = median_cut(reference, 10).flux[:, 0]
    # 8 of 16 parts lie between the second and the third texel of the lamp of 4 x 3
    assert float(sliced.max() / sliced.min()) == pytest.approx(9 / 7, rel=1e-6)


@CUTS
def test_a_lamp_of_one_texel_is_not_cut_into_more(cut: Cut) -> None:
    reference = torch.zeros(8, 16, 3)
    reference[2, 5] = 7.0
    lights = cut(reference, 40)
    lit = lights.flux.sum(-1) > 0
    assert int(lit.sum()) == 1
    expected = latlong.directions(8, 16, dtype=torch.float64)[2, 5]
    torch.testing.assert_close(lights.directions[lit][0], expected)
    assert bool(torch.isfinite(lights.directions).all())


@CUTS
def test_a_map_of_few_texels_gives_no_more_lights_than_it_has(cut: Cut) -> None:
    assert len(cut(torch.ones(2, 4, 3), 500).flux) == 8
