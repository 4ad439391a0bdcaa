# SPDX-License-Identifier: Apache-2.0
"""The fitter's grid: monomials, averages onto cells against `latlong.reduce`, what goes back."""

import pytest
import torch

from asglight.fitting.loss.grid import POWERS, cell_sums, coarsen, coarser, grid, repeated
from asglight.sphere import latlong

FACTORS = [(64, 32), (128, 32), (96, 32), (50, 25), (45, 15), (45, 9), (7, 1), (127, 1), (12, 12)]


def _images(height: int, *batch: int) -> torch.Tensor:
    """Return radiances between 0 and 1.  [*batch, P]."""
    generator = torch.Generator().manual_seed(height)
    return torch.rand(*batch, 2 * height * height, generator=generator)


def test_monomials_are_in_the_order_of_the_powers() -> None:
    found = grid(6)
    x, y, z = latlong.directions(6, 12, dtype=torch.float64).reshape(-1, 3).unbind(-1)
    for row, (i, j, k) in zip(found.monomials, POWERS, strict=True):
        expected = (x**i * y**j * z**k).float()
        assert torch.equal(row, expected)  # rounded once


def test_powers_are_all_monomials_up_to_degree_three() -> None:
    every = {(i, j, k) for i in range(3) for j in range(3) for k in range(3) if i + j + k <= 2}
    assert len(POWERS) == 10
    assert set(POWERS) == every
    # what a symmetric 3 x 3 matrix's upper triangle reads row by row
    assert POWERS[4:10] == ((2, 0, 0), (1, 1, 0), (1, 0, 1), (0, 2, 0), (0, 1, 1), (0, 0, 2))


def test_monomials_are_those_of_the_directions() -> None:
    found = grid(4)
    x, y, z = found.directions.double().unbind(-1)
    expected = torch.stack([x**i * y**j * z**k for i, j, k in POWERS])
    torch.testing.assert_close(found.monomials.double(), expected, rtol=0, atol=1e-6)  # float32
    assert torch.equal(found.monomials[1:4], found.directions.mT)


@pytest.mark.parametrize("height", [1, 2, 33, 64])
def test_shares_are_those_of_the_sphere(height: int) -> None:
    share = grid(height).share
    assert float(share.double().sum()) == pytest.approx(1.0, rel=1e-6)  # rounded to float32
    areas = latlong.texel_solid_angles(height, 2 * height).reshape(-1)
    torch.testing.assert_close(share * 4 * torch.pi, areas)


@pytest.mark.parametrize(("height", "coarse"), FACTORS)
def test_coarsen_is_the_exact_reduction(height: int, coarse: int) -> None:
    images = _images(height, 2, 3)
    found = coarsen(images, height, coarse)
    for image, reduced in zip(images, found, strict=True):
        texels = image.mT.reshape(height, 2 * height, 3).double()
        expected = latlong.reduce(texels, coarse, 2 * coarse).reshape(-1, 3).mT
        # means of up to 127^2 numbers below 1 in float32
        torch.testing.assert_close(reduced.double(), expected, rtol=3e-6, atol=0)


@pytest.mark.parametrize(("height", "coarse"), [(12, 4), (15, 5), (14, 7), (7, 1), (6, 6)])
def test_cell_sums_add_the_texels_of_each_cell(height: int, coarse: int) -> None:
    images = torch.arange(2.0 * height * height).repeat(3, 1)  # whole numbers: exact
    factor = height // coarse
    blocks = images.reshape(3, coarse, factor, 2 * coarse, factor)
    assert torch.equal(cell_sums(images, height, coarse), blocks.sum((2, 4)).flatten(1))


@pytest.mark.parametrize(("height", "coarse"), [(12, 4), (15, 5), (14, 7), (7, 1), (6, 6)])
def test_repeated_gives_each_texel_the_value_of_its_cell(height: int, coarse: int) -> None:
    cells = _images(coarse, 2, 3)
    found = repeated(cells, coarse, height).unflatten(-1, (height, 2 * height))
    factor = height // coarse
    for row in range(height):
        for column in range(2 * height):
            cell = row // factor * 2 * coarse + column // factor
            assert torch.equal(found[..., row, column], cells[..., cell])


@pytest.mark.parametrize(("height", "coarse"), [(12, 4), (15, 5), (7, 1)])
def test_repeated_is_the_transpose_of_cell_sums(height: int, coarse: int) -> None:
    down = cell_sums(torch.eye(2 * height * height), height, coarse)  # ones and zeros: exact
    up = repeated(torch.eye(2 * coarse * coarse), coarse, height)
    assert torch.equal(up, down.mT)


@pytest.mark.parametrize(
    ("height", "wanted", "rows"),
    [
        (64, 64, 64),
        (64, 32, 32),
        (256, 64, 64),
        (32, 64, 32),  # never finer than the map
        (1, 64, 1),
        (1, 1, 1),
        (100, 64, 50),
        (100, 32, 25),
        (250, 64, 50),
        (250, 32, 25),
        (96, 64, 48),  # just three quarters
        (94, 64, 94),  # 47 would be less
        (127, 64, 127),  # a prime
        (127, 32, 127),
    ],
)
def test_coarser_picks_the_nearest_divisor(height: int, wanted: int, rows: int) -> None:
    assert coarser(height, wanted) == rows


def test_coarser_divides_every_height_and_keeps_three_quarters_of_the_rows() -> None:
    for height in range(1, 200):
        for wanted in (1, 32, 64):
            rows = coarser(height, wanted)
            assert height % rows == 0
            assert rows >= min(height, 0.75 * wanted)
