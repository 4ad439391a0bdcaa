# SPDX-License-Identifier: Apache-2.0
"""Exact reduction of latlong maps against flux, brute-force overlaps and literal values."""

import math

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st

from asglight.sphere import latlong, overlaps

sizes = st.tuples(st.integers(1, 23), st.integers(1, 31))

ROUNDING = 1e-13
"""Relative, float64: sums of at most a thousand terms."""

SLIVER = 1e-9
"""Relative: what two bands near a pole share may be a thousandth of them, and is a difference of
rounded cosines."""


def _random_map(height: int, width: int, seed: int = 0) -> torch.Tensor:
    values = np.random.default_rng(seed).lognormal(sigma=2.0, size=(height, width, 3))
    return torch.from_numpy(values)


def _flux(radiance: torch.Tensor) -> np.ndarray:
    height, width, _ = radiance.shape
    edges = np.sin(np.pi / 2 - np.pi * np.arange(height + 1) / height)
    bands = 2 * np.pi / width * (edges[:-1] - edges[1:])
    return (radiance.numpy() * bands[:, None, None]).sum((0, 1))


def _brute_force(radiance: np.ndarray, height: int, width: int) -> np.ndarray:
    """Average by visiting every pair of texels and measuring their common area in radians."""
    rows, columns, channels = radiance.shape
    result = np.zeros((height, width, channels))
    for j, i in np.ndindex(height, width):
        area = 0.0
        for b, a in np.ndindex(rows, columns):
            top = max(math.pi * j / height, math.pi * b / rows)
            bottom = min(math.pi * (j + 1) / height, math.pi * (b + 1) / rows)
            left = max(2 * math.pi * i / width, 2 * math.pi * a / columns)
            right = min(2 * math.pi * (i + 1) / width, 2 * math.pi * (a + 1) / columns)
            if bottom > top and right > left:
                common = (right - left) * (math.cos(top) - math.cos(bottom))
                result[j, i] += common * radiance[b, a]
                area += common
        result[j, i] /= area
    return result


@pytest.mark.thorough
@settings(deadline=None, max_examples=tries(80))
@given(source=sizes, target=sizes)
def test_reduce_conserves_flux_for_any_pair_of_sizes(
    source: tuple[int, int], target: tuple[int, int]
) -> None:
    radiance = _random_map(*source)
    reduced = latlong.reduce(radiance, *target)
    assert reduced.shape == (*target, 3)
    np.testing.assert_allclose(_flux(reduced), _flux(radiance), rtol=ROUNDING)


@pytest.mark.thorough
@settings(deadline=None, max_examples=tries(40))
@given(source=sizes, target=sizes, level=st.floats(1e-6, 1e6))
def test_reduce_keeps_a_constant_map(
    source: tuple[int, int], target: tuple[int, int], level: float
) -> None:
    reduced = latlong.reduce(torch.full((*source, 3), level, dtype=torch.float64), *target)
    np.testing.assert_allclose(reduced.numpy(), level, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("source", "target"),
    [((7, 11), (3, 4)), ((4, 8), (2, 4)), ((5, 9), (8, 13)), ((6, 6), (1, 1)), ((2, 3), (6, 9))],
)
def test_reduce_is_the_area_average(source: tuple[int, int], target: tuple[int, int]) -> None:
    radiance = _random_map(*source, seed=1)
    expected = _brute_force(radiance.numpy(), *target)
    np.testing.assert_allclose(latlong.reduce(radiance, *target).numpy(), expected, rtol=ROUNDING)


def test_reduce_splits_a_band_at_its_latitude() -> None:
    # edges at +-30 degrees: the outer bands lie in one hemisphere, the middle one in both
    two_rows = torch.tensor([[[1.0]], [[5.0]]], dtype=torch.float64)
    three_rows = latlong.reduce(two_rows, 3, 1).flatten()
    assert three_rows.tolist() == pytest.approx([1, 3, 5], rel=ROUNDING)
    # of the upper hemisphere's area, the polar half (above 45 degrees) is 1 - sin 45
    four_rows = torch.tensor([2.0, 7.0, 0.0, 0.0], dtype=torch.float64).reshape(4, 1, 1)
    polar = 1 - math.sqrt(0.5)
    top = latlong.reduce(four_rows, 2, 1)[0].item()
    assert top == pytest.approx(2 * polar + 7 * (1 - polar), rel=ROUNDING)


def test_reduce_of_a_ramp_has_no_half_texel_shift() -> None:
    ramp = torch.arange(12, dtype=torch.float64).reshape(1, 12, 1).expand(6, 12, 1)
    halved = latlong.reduce(ramp, 3, 6)
    np.testing.assert_allclose(halved[0, :, 0].numpy(), [0.5, 2.5, 4.5, 6.5, 8.5, 10.5], rtol=1e-14)
    doubled = latlong.reduce(ramp, 6, 24)
    np.testing.assert_allclose(doubled[2, :, 0].numpy(), np.repeat(np.arange(12), 2), atol=1e-14)


def test_reduce_of_a_row_ramp_keeps_up_up() -> None:
    ramp = torch.arange(6, dtype=torch.float64).reshape(6, 1, 1).expand(6, 4, 1)
    doubled = latlong.reduce(ramp, 12, 4)
    np.testing.assert_allclose(doubled[:, 1, 0].numpy(), np.repeat(np.arange(6), 2), atol=1e-13)


def test_reduce_does_not_mix_the_columns_beside_the_seam() -> None:
    radiance = torch.zeros(4, 8, 1, dtype=torch.float64)
    radiance[:, 0] = 1
    reduced = latlong.reduce(radiance, 2, 4)
    expected = torch.tensor([0.5, 0, 0, 0], dtype=torch.float64).expand(2, 4)[..., None]
    torch.testing.assert_close(reduced, expected, rtol=0, atol=1e-15)


def test_reduce_to_the_same_size_returns_the_map_and_keeps_the_dtype() -> None:
    radiance = _random_map(4, 8).float()
    assert torch.equal(latlong.reduce(radiance, 4, 8), radiance)
    assert latlong.reduce(radiance, 3, 5).dtype == torch.float32


def test_reduce_of_one_bright_texel_keeps_its_flux_in_float32() -> None:
    # half-range sun of 1e6 in a texel beside the pole: float32 weights have 6e-8 each
    radiance = torch.zeros(64, 128, 3)
    radiance[0, 3] = 1e6
    reduced = latlong.reduce(radiance, 7, 11)
    np.testing.assert_allclose(_flux(reduced.double()), _flux(radiance.double()), rtol=1e-6)


@pytest.mark.parametrize(("rows", "factor"), [(1, 1), (4, 1), (5, 2), (9, 3)])
def test_split_repeats_texels_until_there_are_rows_enough(rows: int, factor: int) -> None:
    radiance = _random_map(4, 8)
    expected = radiance.repeat_interleave(factor, 0).repeat_interleave(factor, 1)
    torch.testing.assert_close(latlong.split(radiance, rows), expected, rtol=1e-14, atol=0)


def _mean(overlap: overlaps.Overlap, values: np.ndarray) -> np.ndarray:
    places = overlap.first[:, None] + np.arange(overlap.shares.shape[1])
    return (overlap.shares[..., None] * values[places]).sum(1)


@given(fine=sizes, coarse=sizes)
@settings(deadline=None)
def test_overlaps_are_the_area_average(fine: tuple[int, int], coarse: tuple[int, int]) -> None:
    rows, columns = map(min, fine, coarse)
    radiance = _random_map(*fine, seed=2).numpy()
    by_row = _mean(overlaps.rows(fine[0], rows), radiance.reshape(fine[0], -1))
    across = by_row.reshape(rows, fine[1], 3).swapaxes(0, 1).reshape(fine[1], -1)
    reduced = _mean(overlaps.columns(fine[1], columns), across).reshape(columns, rows, 3)
    expected = latlong.reduce(torch.from_numpy(radiance), rows, columns).numpy()
    np.testing.assert_allclose(reduced.swapaxes(0, 1), expected, rtol=SLIVER)


@pytest.mark.parametrize(("fine", "coarse"), [(2048, 256), (300, 300), (4320, 256), (7, 1)])
def test_a_coarse_texel_touches_no_more_fine_ones_than_it_covers(fine: int, coarse: int) -> None:
    overlap = overlaps.rows(fine, coarse)
    # a ratio that is not whole needs one more at each end
    most = fine // coarse + (2 if fine % coarse else 0)
    assert overlap.shares.shape[1] <= most
    assert overlap.shares.sum(1) == pytest.approx(1, rel=ROUNDING)
    assert overlap.first.min() == 0
    assert int(overlap.first[-1]) + overlap.shares.shape[1] == fine


def test_solid_angles_of_rows_are_those_of_texels() -> None:
    of_texels = latlong.texel_solid_angles(9, 5, dtype=torch.float64)[:, 0]
    found = overlaps.row_solid_angles(9, 5)
    np.testing.assert_allclose(found, of_texels.numpy(), rtol=1e-14)
    assert found.sum() == pytest.approx(4 * math.pi / 5, rel=ROUNDING)
