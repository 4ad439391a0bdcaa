# SPDX-License-Identifier: Apache-2.0
"""Strips of an image, repaired and averaged by solid angle on a coarser grid.

Rows are summed first, each with the share of its band that a row of the result covers, then
columns: all but an eighth of the work on a 4k map is adding up rows, which lie one after the other
in memory. Sums are float32, so a result is within 1e-6 of that in float64.

It is written twice, in numpy and in C (asglight/images/compiled). Rows with values that are not
finite are few, and are repaired in numpy in both (repair.py).
"""

import numpy as np
from numpy.typing import NDArray

from asglight.images import compiled
from asglight.images.infinite import Planes
from asglight.images.repair import Tally, repair_rows
from asglight.sphere import overlaps

ROWS = 16
"""Worked on at once in numpy: 0.8 MB of a 4k map, which stay in the processor's cache."""


class Reduction:
    """An image that comes in strips of rows, from top to bottom, and goes as rows of a smaller one.

    Attributes:
        tally: What was repaired so far.
    """

    def __init__(
        self, size: tuple[int, int], height: int, matrix: NDArray[np.float64] | None = None
    ) -> None:
        """Begin at the top.

        Args:
            size: Rows and columns of the image.
            height: Rows of the result, of 2 * height columns; at most those of the image.
            matrix: From the file's primaries to Rec.709; None where they are.  [3, 3]
        """
        self.tally = Tally()
        self._matrix = None if matrix is None else np.ascontiguousarray(matrix, np.float64)
        self._areas = overlaps.row_solid_angles(*size)
        self._shares, self._is_last = _by_row(overlaps.rows(size[0], height), size[0])
        columns = overlaps.columns(size[1], 2 * height)
        self._columns = (columns.first, columns.shares.astype(np.float32))
        self._sums = np.zeros((2, 3, size[1]), np.float32)
        self._top = 0

    def add(self, planes: Planes) -> NDArray[np.float32]:
        """Take the next rows of the image in.

        Args:
            planes: In the file's primaries.

        Returns:
            The rows of the result that end with them, which may be none.  [rows, w, 3]
        """
        done = []
        count = len(planes[0])
        while count:
            if compiled.LIBRARY is not None:
                taken, result = self._compiled(planes, self._matrix)
                done.append(result)
                planes = _from(planes, taken)
                count -= taken
            if count:
                block = np.stack([plane[:ROWS] for plane in planes]).astype(np.float32)
                done.append(self._averaged(self._repaired(block)))
                planes = _from(planes, block.shape[1])
                count -= block.shape[1]
        return np.concatenate(done)

    def _repaired(self, block: NDArray[np.float32]) -> NDArray[np.float32]:
        """Repair some rows.  [3, rows, W]."""
        # No comparison holds for NaN.
        if self._matrix is None and block.min() >= 0 and block.max() < np.inf:
            return block
        areas = self._areas[self._top : self._top + block.shape[1]]
        values = np.moveaxis(block, 0, -1)
        repaired, tally = repair_rows(values, areas, self._matrix, self._top)
        self.tally += tally
        return np.ascontiguousarray(np.moveaxis(repaired, -1, 0))

    def _compiled(
        self, planes: Planes, matrix: NDArray[np.float64] | None
    ) -> tuple[int, NDArray[np.float32]]:
        """Take in rows up to the first that is not finite; return how many, and what ends."""
        span = slice(self._top, self._top + len(planes[0]))
        rows = self._areas[span], self._shares[span], self._is_last[span]
        first, parts = self._columns
        result = np.empty((int(rows[2].sum()), len(first), 3), np.float32)
        taken, negative, below = compiled.reduce(
            planes, rows, (first, parts), matrix, self._sums, result
        )
        self.tally += Tally(negative, below=below)
        self._top += taken
        return taken, result[: int(rows[2][:taken].sum())]

    def _averaged(self, repaired: NDArray[np.float32]) -> NDArray[np.float32]:
        """Take in repaired rows.  [3, rows, W] -> [n, w, 3]."""
        if compiled.LIBRARY is not None:
            red, green, blue = repaired
            return self._compiled((red, green, blue), None)[1]
        ended = []
        for row in range(repaired.shape[1]):
            share, after = self._shares[self._top]
            self._sums[0] += share * repaired[:, row]
            if after:
                self._sums[1] += after * repaired[:, row]
            if self._is_last[self._top]:
                ended.append(self._across())
                self._sums[0] = self._sums[1]
                self._sums[1] = 0
            self._top += 1
        first, _ = self._columns
        return np.array(ended, np.float32).reshape(-1, len(first), 3)

    def _across(self) -> NDArray[np.float32]:
        """Return the row of the result that is at hand.  [w, 3]."""
        first, parts = self._columns
        total = np.zeros((3, len(first)), np.float32)
        for offset in range(parts.shape[1]):
            total += parts[:, offset] * self._sums[0][:, first + offset]
        return total.T


def _from(planes: Planes, row: int) -> Planes:
    red, green, blue = planes
    return red[row:], green[row:], blue[row:]


def _by_row(
    overlap: overlaps.Overlap, height: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Turn the overlap round: what each row of the image gives.

    Returns:
        Its shares in the row of the result at hand, which is the first that it touches and that no
        row before has ended, and in the next one [H, 2]; and whether the former ends with it [H].
    """
    shares, is_last = np.zeros((height, 2), np.float32), np.zeros(height, bool)
    touched = [
        (target, first + np.flatnonzero(row), row[row > 0])
        for target, (first, row) in enumerate(zip(overlap.first, overlap.shares, strict=True))
    ]
    for _, rows, _ in touched:
        is_last[rows[-1]] = True
    at_hand = np.concatenate([[0], np.cumsum(is_last)[:-1]])  # [H]
    for target, rows, parts in touched:
        shares[rows, target - at_hand[rows]] = parts
    return shares, is_last
