# SPDX-License-Identifier: Apache-2.0
"""Rows that are repaired and averaged as they come, against the whole map in float64."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asglight import c_library
from asglight.images import colour, compiled
from asglight.images.decoding.reduction import Planes, Reduction
from asglight.images.repair import Tally, repair_rows
from asglight.sphere import latlong, overlaps

TOLERANCE = 1e-6
"""Relative, of float32: 17 rounded sums over rows and as many over columns, of values >= 0."""

MATRIX = colour.to_rec709(colour.KNOWN["ACEScg (AP1)"])

COMPILED = pytest.mark.skipif(
    compiled.LIBRARY is None and c_library.compiler() is None, reason="there is no C compiler"
)
WAYS = pytest.mark.parametrize(
    "library", [None, pytest.param(compiled.LIBRARY, marks=COMPILED)], ids=["numpy", "compiled"]
)


@pytest.fixture(autouse=True)
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the parameter `library` choose what computes."""
    if "library" in request.fixturenames:
        monkeypatch.setattr(compiled, "LIBRARY", request.getfixturevalue("library"))


def image(height: int, kind: type = np.float16) -> NDArray:
    """Return positive values over nine magnitudes, subnormal halves among them.  [H, W, 3]."""
    random = np.random.default_rng(height)
    return (10 ** random.uniform(-7, 2, (height, 2 * height, 3))).astype(kind)


def planes_of(values: NDArray) -> Planes:
    red, green, blue = np.moveaxis(values, -1, 0).copy()
    return red, green, blue


def reduced(
    values: NDArray, height: int, strip: int = 1000, matrix: NDArray | None = None
) -> tuple[NDArray, Tally]:
    reduction = Reduction(values.shape[:2], height, matrix)
    rows = [
        reduction.add(planes_of(values[top : top + strip])) for top in range(0, len(values), strip)
    ]
    return np.concatenate(rows), reduction.tally


def expected(values: NDArray, height: int) -> NDArray:
    whole = torch.from_numpy(values.astype(np.float64))
    return latlong.reduce(whole, height, 2 * height).numpy()


@WAYS
@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("strip", [1, 7, 16, 200])
@pytest.mark.parametrize("height", [1, 8, 33, 40, 63, 64])
def test_rows_come_out_as_of_the_whole_map(
    library: object, height: int, strip: int, kind: type
) -> None:
    values = image(64, kind)
    found, tally = reduced(values, height, strip)
    np.testing.assert_allclose(found, expected(values, height), rtol=TOLERANCE)
    assert tally == Tally()


@pytest.mark.thorough
@WAYS
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 41))
@settings(deadline=None, max_examples=tries(30))
def test_any_size_from_any_size(library: object, one: int, other: int, strip: int) -> None:
    values = image(max(one, other))
    found, _ = reduced(values, min(one, other), strip)
    np.testing.assert_allclose(found, expected(values, min(one, other)), rtol=TOLERANCE)


@WAYS
def test_an_image_of_the_same_size_is_the_same_to_the_bit(library: object) -> None:
    values = image(20)
    np.testing.assert_array_equal(reduced(values, 20, 3)[0], values.astype(np.float32))


@WAYS
def test_every_finite_half_is_the_float_that_it_means(library: object) -> None:
    halves = np.arange(65536, dtype=np.uint16).view(np.float16)
    finite = halves[np.isfinite(halves) & (halves >= 0)]
    values = np.zeros((256, 512, 3), np.float16)
    values.reshape(-1)[: finite.size] = finite
    found = reduced(values, 256)[0]
    np.testing.assert_array_equal(found, values.astype(np.float32))


@WAYS
@pytest.mark.parametrize("matrix", [None, MATRIX], ids=["rec709", "acescg"])
@pytest.mark.parametrize("strip", [5, 64])
def test_repair_comes_before_averaging(library: object, strip: int, matrix: NDArray | None) -> None:
    values = image(48, np.float32)
    values[3, 5, 0] = np.nan
    values[30:33, 9] = -2
    values[40, 11, 2] = np.inf
    values[44] *= -1
    areas = overlaps.row_solid_angles(48, 96)
    repaired, counted = repair_rows(values, areas, matrix)
    found, tally = reduced(values, 16, strip, matrix)
    np.testing.assert_allclose(found, expected(repaired, 16), rtol=TOLERANCE)
    assert (tally.nonfinite, tally.first) == (2, (3, 5))
    assert tally.negative == counted.negative
    assert tally.below == pytest.approx(counted.below, rel=1e-12)


@WAYS
def test_primaries_are_converted_in_float64(library: object) -> None:
    values = image(32)
    exact = np.maximum(values.astype(np.float64) @ MATRIX.T, 0)
    found, tally = reduced(values, 8, 32, MATRIX)
    np.testing.assert_allclose(found, expected(exact, 8), rtol=TOLERANCE)
    assert tally.negative == (values.astype(np.float64) @ MATRIX.T < 0).any(-1).sum() > 0


@WAYS
def test_a_conversion_that_passes_the_end_of_float32_is_not_finite(library: object) -> None:
    values = np.full((4, 8, 3), 1, np.float32)
    values[2, 3] = 3e38, 0, 0
    found, tally = reduced(values, 4, 4, MATRIX)
    assert (tally.nonfinite, tally.first) == (1, (2, 3))
    assert np.isfinite(found).all()


@WAYS
def test_sums_of_huge_values_do_not_overflow(library: object) -> None:
    values = np.full((64, 128, 3), 3e38, np.float32)
    np.testing.assert_allclose(reduced(values, 1)[0], 3e38, rtol=TOLERANCE)


@WAYS
def test_planes_may_lie_apart_and_unaligned(library: object) -> None:
    # as rows that are not compressed lie in a file: a number before each, other channels between
    values = image(12)
    lines = np.zeros((12, 8 + 24 * 4 * 2 + 1), np.uint8)
    planes = [lines[:, 8 + 48 * k : 56 + 48 * k].view(np.float16) for k in range(3)]
    for channel, plane in enumerate(planes):
        plane[:] = values[..., channel]
    red, green, blue = planes
    found = Reduction((12, 24), 4).add((red, green, blue))
    np.testing.assert_allclose(found, expected(values, 4), rtol=TOLERANCE)


@COMPILED
def test_a_library_of_other_sources_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(Path(compiled.__file__).with_name("reduction.c"), tmp_path)
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "__init__.py"))
    assert compiled.load() is None
    assert c_library.compile_library(tmp_path, tmp_path / compiled.NAME) is None
    assert compiled.load() is not None
    with (tmp_path / "reduction.c").open("a") as changed:
        changed.write("/* another */\n")
    assert compiled.load() is None
    (tmp_path / compiled.NAME).unlink()  # it is loaded: what is in it may not change
    (tmp_path / compiled.NAME).write_bytes(b"of another system")
    assert compiled.load() is None
