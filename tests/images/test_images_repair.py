# SPDX-License-Identifier: Apache-2.0
"""The repair counts what it changes and says it in one line."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from asglight.images import compiled
from asglight.images.decoding.reduction import Reduction
from asglight.images.repair import Repair, repair_rows
from asglight.sphere.overlaps import row_solid_angles


def by_rows(values: NDArray) -> tuple[NDArray, Repair]:
    """Repair an image at once."""
    repaired, tally = repair_rows(values, row_solid_angles(*values.shape[:2]))
    return repaired, tally.account(repaired)


def on_the_way(values: NDArray) -> tuple[NDArray, Repair]:
    """Repair an image as it is read, without a reduction."""
    reduction = Reduction(values.shape[:2], len(values))
    red, green, blue = np.moveaxis(values, -1, 0).copy()
    repaired = reduction.add((red, green, blue))
    return repaired, reduction.tally.account(repaired)


def in_numpy(values: NDArray) -> tuple[NDArray, Repair]:
    """Repair an image as it is read where nothing was compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "LIBRARY", None)
        return on_the_way(values)


WAYS = pytest.mark.parametrize("repair", [by_rows, on_the_way, in_numpy])
Way = Callable[[NDArray], tuple[NDArray, Repair]]


def ones(height: int = 2) -> NDArray:
    return np.ones((height, 2 * height, 3), np.float32)


@WAYS
def test_clean_image_is_returned_as_it_is(repair: Way) -> None:
    radiance = np.random.default_rng(1).random((2, 4, 3), np.float32)
    repaired, account = repair(radiance)
    np.testing.assert_array_equal(repaired, radiance)
    assert account == Repair()
    assert account.is_clean
    assert account.sentence() == "nothing repaired"


@WAYS
def test_only_the_channels_at_fault_become_zero(repair: Way) -> None:
    radiance = ones()
    radiance[0, 1] = math.nan, 2.0, -3.0
    radiance[1, 3, 1] = -math.inf
    repaired, account = repair(radiance)
    assert repaired[0, 1].tolist() == [0, 2, 0]
    assert repaired[1, 3].tolist() == [1, 0, 1]
    assert (account.texels, account.nonfinite, account.negative) == (2, 2, 0)
    assert account.first == (0, 1)


@WAYS
def test_negative_zero_is_no_fault(repair: Way) -> None:
    assert repair(-0.0 * ones())[1].is_clean


@WAYS
def test_negative_flux_is_weighted_by_solid_angle(repair: Way) -> None:
    radiance = ones(4)
    radiance[0, 0] = -1
    # Polar bands of a 4-row map hold (1 - sin 45 deg) / 2 of the sphere each, over 8 columns.
    polar = (1 - math.sin(math.pi / 4)) / 2 / 8
    assert repair(radiance)[1].negative_flux_ratio == pytest.approx(polar / (1 - polar))


@WAYS
def test_image_without_anything_positive_says_so(repair: Way) -> None:
    account = repair(-ones())[1]
    assert account.negative_flux_ratio == math.inf
    assert account.sentence() == "8 negative texels set to 0 (nothing in the image is positive)"


@WAYS
def test_sum_of_huge_values_does_not_overflow(repair: Way) -> None:
    radiance = np.float32(3e38) * ones()
    radiance[0, 0, 0] = -3e38
    assert repair(radiance)[1].negative_flux_ratio == pytest.approx(1 / 23, rel=1e-6)


@pytest.mark.parametrize(
    ("account", "sentence"),
    [
        (
            Repair(nonfinite=3, negative=120, negative_flux_ratio=0.057),
            "3 NaN and 120 negative texels set to 0 (negative flux 5.7 % of the positive)",
        ),
        (Repair(nonfinite=1), "1 NaN texel set to 0"),
        (Repair(filled_from=(1016,), fault="missing"), "frame missing, held from 1016"),
        (
            Repair(nonfinite=2, filled_from=(1016, 1019), fault="is empty"),
            "frame is empty, interpolated between 1016 and 1019; 2 NaN texels set to 0",
        ),
    ],
)
def test_sentence(account: Repair, sentence: str) -> None:
    assert account.sentence() == sentence
    assert not account.is_clean


ANY_FLOAT = st.floats(width=32, allow_nan=True, allow_infinity=True)


@WAYS
@given(hnp.arrays(np.float32, (2, 4, 3), elements=ANY_FLOAT))
def test_result_is_finite_and_not_negative_and_the_counts_are_right(
    repair: Way, values: np.ndarray
) -> None:
    repaired, account = repair(values.copy())
    with np.errstate(invalid="ignore"):
        bad, below = ~np.isfinite(values), np.isfinite(values) & (values < 0)
    np.testing.assert_array_equal(repaired, np.where(bad | below, 0, values))
    assert account.nonfinite == bad.any(axis=-1).sum()
    assert account.negative == (below.any(axis=-1) & ~bad.any(axis=-1)).sum()
    assert account.texels == (bad | below).any(axis=-1).sum()
    assert account.first == (tuple(np.argwhere(bad.any(axis=-1))[0]) if bad.any() else None)
