# SPDX-License-Identifier: Apache-2.0
"""Rows of an image repaired and averaged, compiled: reduction.c, called with numpy's arrays.

`asglight.images.decoding.reduction` is the reference, and serves where nothing was compiled.
"""

import ctypes
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int64, c_void_p
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asglight.c_library import LIBRARIES, fingerprint

NAME = LIBRARIES["images/compiled"]


class _Strip(Structure):
    _fields_ = (
        ("rows", c_int64),
        ("width", c_int64),
        ("is_half", c_int64),
        ("stride", c_int64 * 3),
        ("planes", c_void_p * 3),
    )


class _Grid(Structure):
    _fields_ = (
        ("matrix", c_void_p),
        ("areas", c_void_p),
        ("shares", c_void_p),
        ("is_last", c_void_p),
        ("columns", c_int64),
        ("most", c_int64),
        ("first", c_void_p),
        ("parts", c_void_p),
    )


class _State(Structure):
    _fields_ = (
        ("sums", c_void_p),
        ("row", c_void_p),
        ("result", c_void_p),
        ("below", c_double),
        ("negative", c_int64),
    )


def load() -> ctypes.CDLL | None:
    """Return the library; None where it was not compiled, or from other sources."""
    path = Path(__file__).with_name(NAME)
    if not path.is_file():
        return None
    try:
        library = ctypes.CDLL(str(path))
        library.asglight_sources.restype = c_char_p
        library.asglight_reduce.argtypes = [POINTER(_Strip), POINTER(_Grid), POINTER(_State)]
        library.asglight_reduce.restype = c_int64
    except (OSError, AttributeError):
        return None
    is_ours = library.asglight_sources() == fingerprint(path.parent).encode()
    return library if is_ours else None


LIBRARY = load()
"""None: numpy computes the same."""


def reduce(
    planes: tuple[NDArray, NDArray, NDArray],
    rows: tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.bool_]],
    columns: tuple[NDArray[np.int64], NDArray[np.float32]],
    matrix: NDArray[np.float64] | None,
    sums: NDArray[np.float32],
    result: NDArray[np.float32],
) -> tuple[int, int, float]:
    """Take rows of an image in, up to the first with a value that is not finite.

    Args:
        planes: Red, green and blue, float16 or float32, all of one type.  [rows, W]
        rows: Of each, the solid angle of a texel [rows]; its shares in the result's row at hand and
            in the next one [rows, 2]; whether the former ends with it [rows].
        columns: Of each of the result, the first that it touches [w], and their shares [w, K].
        matrix: From the file's primaries; None where they are the result's.  [3, 3]
        sums: Of the result's row at hand and the next one, over rows; changed.  [2, 3, W]
        result: Takes the rows of the result that end.  [n, w, 3]

    Returns:
        How many rows were taken, how many of their texels were negative, and the flux of negative
        values, taken positive.
    """
    assert LIBRARY is not None
    height, width = planes[0].shape
    strip = _Strip(height, width, planes[0].itemsize == 2)
    for channel, plane in enumerate(planes):
        assert plane.strides[1] == plane.itemsize == planes[0].itemsize
        strip.stride[channel], strip.planes[channel] = plane.strides[0], plane.ctypes.data
    areas, shares, is_last = rows
    first, parts = columns
    row = np.empty((3, width), np.float32)
    grid = _Grid(
        None if matrix is None else matrix.ctypes.data,
        *(areas.ctypes.data, shares.ctypes.data, is_last.ctypes.data),
        *(*parts.shape, first.ctypes.data, parts.ctypes.data),
    )
    state = _State(sums.ctypes.data, row.ctypes.data, result.ctypes.data)
    taken = LIBRARY.asglight_reduce(byref(strip), byref(grid), byref(state))
    return taken, state.negative, state.below
