# SPDX-License-Identifier: Apache-2.0
"""Probes against the sum over every texel that they stand for, and against their transpose."""

import math

import pytest
import torch

from asglight.fitting.loss import probes
from asglight.fitting.loss.grid import coarser, grid
from asglight.fitting.loss.probes import PROBES
from asglight.shading import kernels

HEIGHTS = [16, 50, 64, 96, 128]


def _map(height: int) -> torch.Tensor:
    """Return radiances with a few bright texels.  [3, P]."""
    generator = torch.Generator().manual_seed(height)
    return torch.rand(3, 2 * height * height, generator=generator) ** 4


@pytest.mark.parametrize("height", HEIGHTS)
def test_probe_is_the_kernel_filter_of_the_map(height: int) -> None:
    radiance = _map(height)
    texels = radiance.mT.reshape(height, 2 * height, 3).double()
    for source, view in zip(
        PROBES, probes.split(probes.probe(radiance, height), height), strict=True
    ):
        directions = probes.directions(source, height).double()
        expected = kernels.filtered(texels[None], source.kernel, directions, normalised=True)[0]
        # weights, transforms and directions in float32; the narrowest kernel's slope is 40
        torch.testing.assert_close(view.mT.double(), expected, rtol=1e-5, atol=1e-6)


def test_probes_look_from_rings_evenly_over_latitude() -> None:
    for source in PROBES:
        directions = probes.directions(source, 64)
        latitude = torch.rad2deg(torch.asin(directions[:, 1])).reshape(source.rings, -1)
        middle = 90 - 180 * (torch.arange(source.rings) + 0.5) / source.rings
        # asin of a rounded number near 1, the ring nearest to a pole
        torch.testing.assert_close(latitude, middle[:, None].expand_as(latitude), rtol=0, atol=1e-3)


def _some_views(height: int, *batch: int) -> torch.Tensor:
    """Return random numbers for each view of each probe.  [*batch, D]."""
    generator = torch.Generator().manual_seed(height)
    return torch.randn(*batch, len(probes.shares(height, "cpu")), generator=generator)


def test_pull_is_the_transpose_of_each_probe() -> None:
    texels = 2 * 10 * 10
    views = probes.probe(torch.eye(texels), 10)
    pulled = probes.pull(torch.eye(views.shape[-1]), 10)
    # transforms in float32 of weights below 1
    torch.testing.assert_close(pulled, views.mT, rtol=0, atol=2e-7)


@pytest.mark.parametrize("height", HEIGHTS)
def test_pull_is_the_transpose_of_all_probes_together(height: int) -> None:
    image, views = _map(height), _some_views(height, 3)
    pulled = probes.pull(views, height)
    assert pulled.shape == image.shape
    products = probes.probe(image, height).double() * views
    left = float(products.sum())
    right = float((image.double() * pulled).sum())
    # float32 numbers of some thousand random terms: rounding adds up as the terms do
    size = float(products.square().sum().sqrt())
    assert left == pytest.approx(right, abs=1e-5 * size)
    assert abs(left) > 1e-3 * size  # not two zeros


def test_views_of_a_batch_are_pulled_one_by_one() -> None:
    views = _some_views(32, 2, 3)
    pulled = probes.pull(views, 32)
    assert pulled.shape == (2, 3, 2 * 32 * 32)
    alone = probes.pull(views[1, 2], 32)
    # transforms in float32 of sums of order 1
    torch.testing.assert_close(pulled[1, 2], alone, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("height", HEIGHTS)
def test_shares_of_the_views_sum_to_one(height: int) -> None:
    views = probes.split(probes.probe(_map(height), height), height)
    shares = probes.split(probes.shares(height, "cpu"), height)
    for source, share, view in zip(PROBES, shares, views, strict=True):
        assert float(share.double().sum()) == pytest.approx(1.0, rel=1e-6)  # rounded to float32
        assert share.shape == view.shape[-1:]
        directions = probes.directions(source, height)
        assert len(directions) == len(share)
        # a view stands for the area around it: larger at the equator by the cosine of latitude
        across = (1 - directions[:, 1].square()).sqrt()
        torch.testing.assert_close(share / share.max(), across / across.max(), atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("height", HEIGHTS)
def test_every_probe_shows_an_even_map_as_it_is(height: int) -> None:
    views = probes.probe(torch.full((3, 2 * height * height), 2.5), height)
    # kernels are normalised on their own grid, in float32
    torch.testing.assert_close(views, torch.full_like(views, 2.5), rtol=3e-6, atol=0)


def test_the_even_probe_shows_the_mean_radiance() -> None:
    (index,) = (i for i, source in enumerate(PROBES) if source.kernel == kernels.EVEN)
    image = _map(100)
    view = probes.split(probes.probe(image, 100), 100)[index]
    mean = (image * grid(100).share).sum(-1, keepdim=True)
    torch.testing.assert_close(view, mean.expand_as(view), rtol=1e-5, atol=0)


def test_images_of_a_batch_are_probed_one_by_one() -> None:
    batch = torch.stack([_map(32), _map(32).flip(-1), torch.ones(3, 2048)])
    for index, image in enumerate(batch):
        torch.testing.assert_close(probes.probe(batch, 32)[index], probes.probe(image, 32))


@pytest.mark.parametrize("height", [48, 50, 64, 94, 96])
def test_the_grid_of_the_curvature_has_the_same_views(height: int) -> None:
    coarse = coarser(height, probes.CURVATURE_ROWS)
    assert coarse < height
    for source in PROBES:
        fine, few = (probes.directions(source, rows) for rows in (height, coarse))
        assert fine.shape == few.shape
        # the columns' first centres differ by less than a coarse cell
        assert float((fine * few).sum(-1).min()) > math.cos(math.pi / coarse)


def test_tables_of_a_grid_are_made_once_however_they_are_asked_for() -> None:
    assert probes.tables(24) is probes.tables(24, PROBES) is probes.tables(24, sources=PROBES)


def test_filters_are_the_same_to_the_bit_however_many_rings_are_computed_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usual = [probes._filter(source, 24) for source in PROBES]
    for block in (1, 10**9):
        monkeypatch.setattr(kernels, "BLOCK", block)
        for source, expected in zip(PROBES, usual, strict=True):
            assert torch.equal(probes._filter.__wrapped__(source, 24), expected)
