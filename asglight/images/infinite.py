# SPDX-License-Identifier: Apache-2.0
"""Infinite texels: the brightest there are, so they are kept as bright as a half float can be.

A half float ends at 65504, and a sun beyond it is stored as +inf.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

HALF_MAX = 65504.0
"""The largest half float."""

Planes = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Red, green and blue of some rows, each [rows, W], all float16 or all float32."""


class Infinities:
    """Replaces +inf in an image that comes in strips of rows, from top to bottom.

    Attributes:
        count: Texels with at least one channel that was +inf, so far.
    """

    def __init__(self, brightest: float = HALF_MAX) -> None:
        """Begin at the top.

        Args:
            brightest: What an infinite number stands for, at least.
        """
        self.count = 0
        self._brightest = brightest

    def kept(self, strips: Iterable[Planes]) -> Iterator[Planes]:
        """Return all rows without +inf.

        Args:
            strips: Rows of red, green and blue, each strip valid until the next one is asked for.

        Yields:
            As many rows; NaN and -inf stay.
        """
        waiting: Planes | None = None  # it ends in infinite texels, and the next row counts too
        above: Planes | None = None
        for planes in strips:
            if waiting is not None:
                yield self._replaced(waiting, above, _row(planes, 0))
                above, waiting = _row(waiting, -1), None
            if not any(map(_has_infinite, planes)):
                last = _row(planes, -1)
                yield planes
            elif any(_has_infinite(plane[-1:]) for plane in planes):
                red, green, blue = (plane.copy() for plane in planes)
                waiting = red, green, blue
                continue
            else:
                last = _row(planes, -1)
                yield self._replaced(planes, above, None)
            above = last
        if waiting is not None:
            yield self._replaced(waiting, above, None)

    def _replaced(self, planes: Planes, above: Planes | None, below: Planes | None) -> Planes:
        infinite = np.isposinf(planes[0]) | np.isposinf(planes[1]) | np.isposinf(planes[2])
        self.count += int(infinite.sum())
        red, green, blue = (
            replaced(
                plane,
                None if above is None else above[channel],
                None if below is None else below[channel],
                self._brightest,
            )
            for channel, plane in enumerate(planes)
        )
        return red, green, blue


def _row(planes: Planes, row: int) -> Planes:
    red, green, blue = (plane[row].copy() for plane in planes)
    return red, green, blue


def _has_infinite(plane: np.ndarray) -> bool:
    """Tell whether a plane holds +inf, which in whole numbers of its bits is one number."""
    bits, infinity = (np.uint16, 0x7C00) if plane.dtype == np.float16 else (np.uint32, 0x7F800000)
    return bool((plane.view(bits) == infinity).any())


def replaced(
    plane: np.ndarray, above: np.ndarray | None, below: np.ndarray | None, brightest: float
) -> np.ndarray:
    """Replace +inf in a channel by a number, one for all texels that touch each other.

    It is `brightest`, or the largest finite value beside those texels if that is more. Columns go
    around the sphere.

    Args:
        plane: Rows of an image.  [H, W]
        above: The row before them; None at the top.  [W]
        below: The row after them; None at the bottom.  [W]
        brightest: The least value.

    Returns:
        The rows without +inf; NaN and -inf stay.  [H, W]
    """
    if not _has_infinite(plane):
        return plane
    from scipy import ndimage  # seldom wanted

    first = int(above is not None)
    rows = [row[None] for row in (above,) if row is not None]
    rows += [plane, *(row[None] for row in (below,) if row is not None)]
    whole = np.concatenate(rows).astype(np.float32)
    infinite = np.isposinf(whole)
    # Turned so that the columns begin where nothing is infinite: no set lies across the seam.
    clear = np.flatnonzero(~infinite.any(axis=0))
    turn = -int(clear[0]) if len(clear) else 0
    finite = np.roll(np.where(np.isfinite(whole), whole, 0), turn, axis=1)
    padded = np.pad(np.pad(finite, ((0, 0), (1, 1)), "wrap"), ((1, 1), (0, 0)))
    around = ndimage.maximum_filter(padded, 3)[1:-1, 1:-1]
    labelled: Any = ndimage.label(np.roll(infinite, turn, axis=1), np.ones((3, 3)))
    sets = labelled[0]
    light = np.zeros(sets.max() + 1, np.float32)
    np.maximum.at(light, sets, around)
    filled = np.roll(np.maximum(light, brightest)[sets], -turn, axis=1)
    filled = filled[first : first + len(plane)]
    return np.where(np.isposinf(plane), filled, plane).astype(plane.dtype)
