# SPDX-License-Identifier: Apache-2.0
"""Splatting against scipy's interpolation, and against what materials show of the texels."""

import numpy as np
import pytest
import torch
from splat_cases import along, of_texels

from asglight.fitting.loss.adaptive_cells import adaptive_cells, on_adaptive_cells, to_cells
from asglight.fitting.loss.grid import coarsen, grid
from asglight.fitting.loss.splatting import neighbours, weights
from asglight.shading import kernels
from asglight.sphere.quadrature import fibonacci_directions


@pytest.mark.parametrize("factor", [1, 2, 3, 4, 7])
def test_weights_are_those_of_scipy_s_interpolation(factor: int) -> None:
    found = weights(factor, "cpu").double().unflatten(0, (factor, factor)).numpy()
    for row in range(factor):
        for column in range(factor):
            expected = np.outer(along(row, factor)[1], along(column, factor)[1]).flatten()
            np.testing.assert_allclose(found[row, column], expected, rtol=0, atol=1e-7)  # float32


@pytest.mark.parametrize(("height", "rows"), [(12, 4), (16, 8), (20, 4), (18, 6)])
def test_cells_hold_the_light_that_scipy_s_interpolation_brings(height: int, rows: int) -> None:
    images = torch.rand(1, 3, 2 * height**2, generator=torch.Generator().manual_seed(1))
    places = adaptive_cells(images, rows, 2 * rows**2)  # all refined: both poles and the seam
    found = to_cells(on_adaptive_cells(images, places), places)[0].double()
    texels = torch.arange(2 * height**2)
    expected = images[0].double() @ of_texels(texels, height, rows).mT
    # sums of some hundred float32 products
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)


# what no quartic follows: GGX 0.25 over three cells, the corner of Lambert's at the horizon
BOUNDS: dict[float | str, float] = {0.25: 0.02, 0.5: 2e-3, kernels.LAMBERT: 2e-3}


@pytest.mark.parametrize("row", [0, 1, 30, 127, 255])
def test_a_material_sees_a_lamp_of_one_texel_at_its_own_place(row: int) -> None:
    """Poles and the seam too: the texels are in the first column, at the edge of their cell."""
    height, rows = 256, 64
    lamp = torch.zeros(1, 1, 2 * height**2)
    texel = row * 2 * height
    lamp[..., texel] = 1.0
    places = adaptive_cells(lamp, rows, 1)
    views = fibonacci_directions(200, dtype=torch.float64)
    towards_lamp = views @ grid(height).directions[texel].double()
    towards_cells = views @ grid(rows).directions.double().mT
    splatted = to_cells(on_adaptive_cells(lamp, places), places)[0, 0].double()
    averaged = coarsen(lamp, height, rows)[0, 0].double()
    for kernel, bound in BOUNDS.items():
        exact = kernels.kernel_values(kernel, towards_lamp).double() * float(
            grid(height).share[texel]
        )
        weight = kernels.kernel_values(kernel, towards_cells).double() * grid(rows).share.double()
        found, other = (
            float((weight @ cells - exact).abs().sum() / exact.sum())
            for cells in (splatted, averaged)
        )
        assert found < bound, kernel
        assert found < 0.1 * other, kernel


def test_neighbours_go_around_the_seam_and_over_the_poles() -> None:
    rows = 8
    (around,) = neighbours(torch.tensor([[0]]), rows).reshape(1, 5, 5)
    assert around[2].tolist() == [14, 15, 0, 1, 2]  # its own row, around the seam
    assert around[3].tolist() == [30, 31, 16, 17, 18]
    assert around[1].tolist() == [6, 7, 8, 9, 10]  # over the pole: the same row, half a turn away
    assert around[0].tolist() == [22, 23, 24, 25, 26]
    last = 2 * rows * rows - 1
    (below,) = neighbours(torch.tensor([[last]]), rows).reshape(1, 5, 5)
    assert torch.equal(below, last - around.flip(0, 1))
