# SPDX-License-Identifier: Apache-2.0
"""Adaptive cells: which cells are refined, exact means, light brought to cells, shares, the
transpose."""

import math

import pytest
import torch
from splat_cases import of_texels

from asglight.fitting.loss.adaptive_cells import (
    BASE_ROWS,
    BRIGHT,
    REFINED,
    AdaptiveCells,
    adaptive_cells,
    from_cells,
    on_adaptive_cells,
    to_cells,
)
from asglight.fitting.loss.grid import grid
from asglight.sphere import latlong

SHAPES = [(16, 4, 3), (18, 6, 5), (20, 10, 1), (12, 4, 32)]
"""Rows of the map and of the coarse grid, and refined cells; the last are all cells."""


def _maps(height: int, frames: int = 2) -> torch.Tensor:
    """Return radiances with a few bright texels, other ones in each frame.  [F, 3, P]."""
    generator = torch.Generator().manual_seed(height)
    return torch.rand(frames, 3, 2 * height * height, generator=generator) ** 8


def _reduced(images: torch.Tensor, rows: int) -> torch.Tensor:
    """Return exact means on a coarser grid, in float64.  [F, K, P] -> [F, K, P']."""
    height = round((images.shape[-1] / 2) ** 0.5)
    texels = images.mT.double().unflatten(1, (height, 2 * height))
    return torch.stack([latlong.reduce(t, rows, 2 * rows).flatten(0, 1).mT for t in texels])


def _cell_of(texel: torch.Tensor, places: AdaptiveCells) -> torch.Tensor:
    """Return the cell that holds each texel."""
    factor, width = places.fine_rows // places.rows, 2 * places.fine_rows
    return texel // width // factor * (2 * places.rows) + texel % width // factor


def _worth(images: torch.Tensor, places: AdaptiveCells) -> torch.Tensor:
    """Sum each cell's differences from its mean, and a part of its light, by area.  [F, C]."""
    height = places.fine_rows
    cell = _cell_of(torch.arange(2 * height * height), places)
    difference = (images.double() - _reduced(images, places.rows)[..., cell]).abs().sum(1)
    difference += BRIGHT * images.double().sum(1)
    area = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64).reshape(-1)
    zeros = torch.zeros(len(images), places.count, dtype=torch.float64)
    return zeros.index_add(1, cell, difference * area)


@pytest.mark.parametrize(("height", "rows", "refined"), SHAPES)
def test_refined_cells_are_those_with_most_detail_and_light(
    height: int, rows: int, refined: int
) -> None:
    images = _maps(height)
    places = adaptive_cells(images, rows, refined)
    assert (places.rows, places.fine_rows, places.count) == (rows, height, 2 * rows * rows)
    assert places.refined.shape == (2, refined)
    chosen = torch.zeros(2, places.count, dtype=torch.bool).scatter(1, places.refined, True)
    assert chosen.sum(1).tolist() == [refined] * 2  # each once
    worth = _worth(images, places)
    for found, mask in zip(worth, chosen, strict=True):
        if refined < places.count:
            assert float(found[mask].min()) > float(found[~mask].max())


def test_an_even_lamp_is_refined_before_faint_detail() -> None:
    images = 0.5 + 0.05 * _maps(24, 1)
    lamp = torch.zeros(24, 48)
    lamp[8:16, 16:24] = 30.0  # two cells by two, even inside
    places = adaptive_cells(images + lamp.flatten(), 6, 4)
    assert sorted(places.refined[0].tolist()) == [2 * 12 + 4, 2 * 12 + 5, 3 * 12 + 4, 3 * 12 + 5]


def test_a_bright_texel_is_refined_in_its_own_frame_alone() -> None:
    images = torch.full((3, 3, 2 * 24 * 24), 0.5)
    bright = torch.tensor([5 * 48 + 7, 23 * 48 + 47, 12 * 48])
    images[torch.arange(3), :, bright] = 900.0
    places = adaptive_cells(images, 6, 1)
    assert places.refined[:, 0].tolist() == [1 * 12 + 1, 5 * 12 + 11, 3 * 12]
    shown = on_adaptive_cells(images, places)[..., places.count :]
    assert shown.amax(-1).tolist() == [[900.0] * 3] * 3  # as it is, not a mean
    assert (places.texel == bright[:, None]).sum(1).tolist() == [1, 1, 1]


def test_texels_come_cell_by_cell_and_row_by_row() -> None:
    places = adaptive_cells(_maps(18), 6, 5)
    blocks = places.texel.unflatten(-1, (5, 9))
    for frame in range(2):
        for cell, block in zip(places.refined[frame], blocks[frame], strict=True):
            assert _cell_of(block, places).tolist() == [int(cell)] * 9
            assert block.tolist() == sorted(set(block.tolist()))


def test_defaults_refine_a_tall_map_into_its_texels() -> None:
    places = adaptive_cells(_maps(128, 1))
    assert (places.rows, places.refined.shape) == (BASE_ROWS, (1, REFINED))
    assert places.texel.shape == (1, 4 * REFINED)


@pytest.mark.parametrize(
    ("height", "rows"),
    [(8, 8), (64, 64), (94, 94)],  # 94 = 2 x 47 has no divisor near 64
)
def test_a_map_no_taller_than_the_coarse_grid_has_no_refined_cells(height: int, rows: int) -> None:
    images = _maps(height)
    places = adaptive_cells(images)
    assert places.rows == rows
    assert (places.refined.numel(), places.texel.numel()) == (0, 0)
    assert torch.equal(on_adaptive_cells(images, places), images)
    assert torch.equal(to_cells(images, places), images)
    assert torch.equal(from_cells(images, places), images)
    assert [level[0] for level in places.levels] == [rows]


@pytest.mark.parametrize(("height", "rows", "refined"), SHAPES)
def test_shares_of_the_leaves_sum_to_one(height: int, rows: int, refined: int) -> None:
    places = adaptive_cells(_maps(height), rows, refined)
    total = places.share.double().sum(-1)
    # each share is rounded to float32 by 2^-24 of it
    torch.testing.assert_close(total, torch.ones_like(total), rtol=1e-7, atol=0)
    assert int((places.cell_share == 0).sum()) == 2 * refined
    assert not places.cell_share.gather(1, places.refined).any()
    areas = latlong.texel_solid_angles(height, 2 * height).reshape(-1) / (4 * math.pi)
    torch.testing.assert_close(places.texel_share, areas[places.texel])


def test_directions_and_monomials_are_those_of_the_centres() -> None:
    places = adaptive_cells(_maps(18), 6, 5)
    cells = latlong.directions(6, 12).reshape(-1, 3)
    texels = latlong.directions(18, 36).reshape(-1, 3)
    for frame in range(2):
        expected = torch.cat([cells, texels[places.texel[frame]]])
        # rounded to float32 from other float32 and from float64 angles
        torch.testing.assert_close(places.directions[frame].mT, expected, rtol=0, atol=3e-7)
        assert torch.equal(places.monomials[frame], grid(18).monomials[:, places.texel[frame]])
    (coarse_rows, _, first), (fine_rows, monomials, second) = places.levels
    assert (coarse_rows, fine_rows) == (6, 18)
    everything = torch.arange(places.share.shape[-1])
    assert torch.equal(torch.cat([everything[first], everything[second]]), everything)
    assert monomials.shape[-1] == len(everything[second])


@pytest.mark.parametrize(("height", "rows", "refined"), SHAPES)
def test_leaves_hold_exact_means_and_cells_the_light_of_texels_at_its_place(
    height: int, rows: int, refined: int
) -> None:
    images = _maps(height)
    places = adaptive_cells(images, rows, refined)
    shown = on_adaptive_cells(images, places)
    expected = _reduced(images, rows)
    # means of up to 25 numbers in float32
    torch.testing.assert_close(shown[..., : places.count].double(), expected, rtol=2e-6, atol=0)
    for frame in range(2):
        texels = images[frame][:, places.texel[frame]]
        assert torch.equal(shown[frame][:, places.count :], texels)
    of_cells = expected.scatter(-1, places.refined[:, None].expand(-1, 3, -1), 0.0)
    found = zip(places.texel, images, strict=True)
    parts = [of_texels(t, height, rows) @ image[:, t].double().mT for t, image in found]
    brought = torch.stack(parts).mT
    shown[..., : places.count].scatter_(-1, places.refined[:, None].expand(-1, 3, -1), math.nan)
    # a refined cell's light comes from texels alone; sums of some float32 products
    torch.testing.assert_close(
        to_cells(shown, places).double(), of_cells + brought, rtol=2e-6, atol=1e-6
    )


@pytest.mark.parametrize(("height", "rows", "refined"), SHAPES)
def test_means_over_leaves_by_their_shares_keep_the_flux(
    height: int, rows: int, refined: int
) -> None:
    images = _maps(height)
    places = adaptive_cells(images, rows, refined)
    found = (on_adaptive_cells(images, places) * places.share[:, None]).double().sum(-1)
    area = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64).reshape(-1)
    expected = (images.double() * area).sum(-1) / (4 * math.pi)
    # sums of positive float32 products
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=0)


@pytest.mark.parametrize(("height", "rows", "refined"), SHAPES)
def test_from_cells_is_the_transpose_of_to_cells(height: int, rows: int, refined: int) -> None:
    places = adaptive_cells(_maps(height), rows, refined)
    generator = torch.Generator().manual_seed(3)
    count = places.share.shape[-1]
    x = torch.randn(2, 4, count, generator=generator)
    y = torch.randn(2, 4, places.count, generator=generator)
    down, up = to_cells(x, places), from_cells(y, places)
    assert (down.shape, up.shape) == (y.shape, x.shape)
    left, right = (down.double() * y).sum(-1), (x.double() * up).sum(-1)
    # sums of some hundred terms of size 1, each rounded to float32
    torch.testing.assert_close(left, right, rtol=0, atol=2e-5)


def test_leaves_of_one_frame_repeat_for_many() -> None:
    images = _maps(18)
    one = adaptive_cells(images[:1], 6, 5)
    many = one.repeated(3)
    assert (many.rows, many.fine_rows, many.count) == (one.rows, one.fine_rows, one.count)
    for name in ("refined", "texel", "monomials", "cell_share", "texel_share", "around"):
        value = getattr(many, name)
        assert len(value) == 3
        assert all(torch.equal(frame, getattr(one, name)[0]) for frame in value)
    maps = torch.cat([images, images[:1]])
    shown = to_cells(on_adaptive_cells(maps, many), many)
    for found, image in zip(shown, maps, strict=True):
        assert torch.equal(found, to_cells(on_adaptive_cells(image[None], one), one)[0])
