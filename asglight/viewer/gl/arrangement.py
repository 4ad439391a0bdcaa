# SPDX-License-Identifier: Apache-2.0
"""Where things are in a picture: cells of balls, and what a point of the picture looks at.

Pixels count from the top left corner, as rows of an image do.
"""

import math
from typing import NamedTuple

import numpy as np

BALL = 0.8
"""Diameter of a ball, as a share of its cell's width."""

ABOVE = 0.5
"""Share of the free rows of a cell above the ball: labels take those above and below."""


class Cell(NamedTuple):
    """The square that holds a ball, in pixels.

    Attributes:
        x: First column.
        y: First row.
        size: Columns and rows.
    """

    x: int
    y: int
    size: int


class Strip(NamedTuple):
    """The rows of a picture that one row of balls takes.

    Attributes:
        top: First row.
        rows: How many.
    """

    top: int
    rows: int


def strip(rows: int, parts: int) -> Strip:
    """Return where balls are drawn that are not shown one above the other.

    Where there are several to compare it is a part of the picture, as of each of those above each
    other: balls stay as large and where they are, sideways, whatever is shown of them.

    Args:
        rows: Rows of the picture.
        parts: How many there are.
    """
    each = max(1, rows // parts)
    return Strip((rows - each) // 2, each)


def cells(size: tuple[int, int], count: int) -> list[Cell]:
    """Arrange balls in rows of equal length, as large as they fit, centred.

    Args:
        size: Columns and rows of the picture, (W, H).
        count: How many balls.
    """
    width, height = size
    columns = max(
        (c for c in range(1, count + 1) if count % c == 0),
        key=lambda c: (min(width / c, height * c / count), c),
    )
    rows = count // columns
    pitch = max(1, math.floor(min(width / columns, height / rows)))
    ball = max(1, round(pitch * BALL))
    left = (width - columns * pitch + pitch - ball) // 2
    top = (height - rows * pitch) // 2 + int(ABOVE * (pitch - ball))
    return [
        Cell(left + place % columns * pitch, top + place // columns * pitch, ball)
        for place in range(count)
    ]


def drawn_areas(
    size: tuple[int, int], count: int, area: tuple[int, int, int, int]
) -> list[tuple[int, int, int, int]]:
    """Return the parts of an area that hold balls when a picture is stretched over it.

    Args:
        size: Columns and rows of the picture.
        count: How many balls it has.
        area: x, y, columns and rows.

    Returns:
        x, y, columns and rows of each, with room for a texel that is filtered.
    """
    x, y, columns, rows = area
    across, down = columns / size[0], rows / size[1]
    found = []
    for cell in cells(size, count):
        left = max(math.floor((cell.x - 1) * across), 0)
        top = max(math.floor((cell.y - 1) * down), 0)
        right = min(math.ceil((cell.x + cell.size + 1) * across), columns)
        bottom = min(math.ceil((cell.y + cell.size + 1) * down), rows)
        found.append((x + left, y + top, right - left, bottom - top))
    return found


class Hit(NamedTuple):
    """A point of a ball.

    Attributes:
        ball: Index of the ball.
        normal: Unit normal in the camera's coordinates.  [3]
    """

    ball: int
    normal: np.ndarray

    @property
    def mirrored(self) -> np.ndarray:
        """Direction that a mirror would show there, in the camera's coordinates.  [3]."""
        return 2 * self.normal[2] * self.normal - np.array([0.0, 0.0, 1.0])


def hit(arrangement: list[Cell], x: float, y: float) -> Hit | None:
    """Return the point of the ball at a place of the picture, or None beside the balls."""
    for index, cell in enumerate(arrangement):
        right = 2 * (x - cell.x) / cell.size - 1
        up = 1 - 2 * (y - cell.y) / cell.size
        depth2 = 1 - right * right - up * up
        if depth2 > 0:
            return Hit(index, np.array([right, up, math.sqrt(depth2)]))
    return None


def mirroring(direction: np.ndarray) -> np.ndarray | None:
    """Return the normal at which a ball mirrors a direction towards the camera: midway of both.

    Args:
        direction: Unit vector in the camera's coordinates.  [3]

    Returns:
        Unit normal; None right behind the ball, which only its rim mirrors.  [3]
    """
    middle = direction + np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(middle))
    return middle / length if length > 1e-6 else None  # 1e-6: float32 has lost the direction
