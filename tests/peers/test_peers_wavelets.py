# SPDX-License-Identifier: Apache-2.0
"""Haar wavelets against their definition; the cube map against closed forms."""

import math

import numpy as np
import pytest
import torch

from asglight.peers import cube, wavelets
from asglight.sphere import latlong


def random_map(height: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(height, 2 * height, 3, generator=generator) ** 4


def haar_functions(size: int) -> np.ndarray:
    """Return the non-standard Haar basis of a square by its definition.  [S, S, S, S]."""
    basis = np.zeros((size,) * 4)
    basis[0, 0] = 1 / size
    for level in range(int(math.log2(size))):
        blocks, edge = 2**level, size // 2**level
        sign = np.repeat([1.0, -1.0], edge // 2)
        plain = np.ones(edge)
        shapes = {(0, 1): (plain, sign), (1, 0): (sign, plain), (1, 1): (sign, sign)}
        for (down, across), (rows, columns) in shapes.items():
            for i in range(blocks):
                for j in range(blocks):
                    place = basis[i + down * blocks, j + across * blocks]
                    block = slice(i * edge, (i + 1) * edge), slice(j * edge, (j + 1) * edge)
                    place[block] = np.outer(rows, columns) / edge
    return basis


def test_the_transform_is_the_product_with_every_haar_function() -> None:
    faces = torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    expected = np.einsum("rcij,fijk->frck", haar_functions(8), faces.numpy())
    np.testing.assert_allclose(wavelets.forward(faces).numpy(), expected, atol=1e-13)


def test_supports_are_the_areas_of_the_haar_functions() -> None:
    areas = (haar_functions(8) != 0).sum((2, 3))
    np.testing.assert_array_equal(wavelets.supports(8).reshape(8, 8).numpy(), areas)


def test_all_coefficients_reconstruct_exactly() -> None:
    reference = random_map(32, 2)
    complete = wavelets.fit(reference, wavelets.FLOATS * 6 * 8 * 8)
    assert len(complete.index) == 6 * 8 * 8
    torch.testing.assert_close(
        complete.faces(), cube.from_latlong(reference, 8), rtol=0, atol=1e-14
    )


def test_more_coefficients_are_never_further_from_the_cube_map_than_their_rest() -> None:
    """Orthonormal: what a selection misses is the square sum of what it left out."""
    reference = random_map(32, 3)
    every = wavelets.forward(cube.from_latlong(reference, 8)).flatten(0, 2)
    chosen = wavelets.fit(reference, 120)
    assert chosen.floats == 120
    left = torch.ones(len(every), dtype=torch.bool)
    left[chosen.index] = False
    missed = (chosen.faces() - cube.from_latlong(reference, 8)).square().sum()
    torch.testing.assert_close(missed, every[left].square().sum(), rtol=1e-12, atol=0)


def test_a_budget_is_kept_and_goes_first_to_the_means() -> None:
    chosen = wavelets.fit(torch.ones(32, 64, 3), 27)
    assert chosen.floats == 24
    assert sorted(chosen.index.tolist()) == [64 * face for face in range(6)]


def test_every_direction_meets_the_texel_that_its_ray_passes() -> None:
    directions = torch.randn(500, 3, generator=torch.Generator().manual_seed(4)).double()
    found = cube.cube_texel(directions, 4)
    for (x, y, z), texel in zip(directions.tolist(), found.tolist(), strict=True):
        d = (x, y, z)
        axis = max(range(3), key=lambda i: abs(d[i]))
        across, down = (d[(axis + k) % 3] / abs(d[axis]) for k in (1, 2))
        face = 2 * axis + (d[axis] < 0)
        assert texel == (face * 4 + math.floor(2 * down + 2)) * 4 + math.floor(2 * across + 2)


def test_points_share_out_the_solid_angles_of_the_cube() -> None:
    placed = cube.points(64, 128, 4)
    area = torch.zeros(96, dtype=torch.float64)
    area.index_add_(0, placed.texel.flatten(), placed.solid_angle.flatten())
    edges = np.linspace(-1, 1, 5)
    corner = np.arctan2(np.outer(edges, edges), np.sqrt(1 + edges**2 + edges[:, None] ** 2))
    exact = np.diff(np.diff(corner, axis=0), axis=1)  # the sum of four corners of each texel
    # about 5,000 points a texel, of which those along its edge may fall on either side
    np.testing.assert_allclose(area.reshape(6, 4, 4).numpy(), np.stack([exact] * 6), rtol=0.02)


@pytest.mark.parametrize("size", [4, 8])
def test_the_way_to_the_cube_and_back_keeps_the_flux(size: int) -> None:
    reference = random_map(32, 5)
    back = cube.to_latlong(cube.from_latlong(reference, size), 32, 64)
    solid_angle = latlong.texel_solid_angles(32, 64, dtype=torch.float64)[..., None]
    torch.testing.assert_close(
        (solid_angle * back).sum((0, 1)), (solid_angle * reference).sum((0, 1)), rtol=1e-12, atol=0
    )
