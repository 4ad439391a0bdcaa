# SPDX-License-Identifier: Apache-2.0
"""How far two pictures of the same balls are apart, in numbers."""

from collections.abc import Sequence

import numpy as np

from asglight.viewer.gl.arrangement import Cell


def ball_errors(
    fit: np.ndarray, reference: np.ndarray, arrangement: Sequence[Cell]
) -> list[float | None]:
    """Return the relative L1 error of each ball: `sum |fit - reference| / sum reference`.

    Args:
        fit: Radiance times coverage, and coverage.  [H, W, 4]
        reference: The same of what it is compared with.  [H, W, 4]
        arrangement: Where the balls are.

    Returns:
        One number for each ball; None where the reference is black.
    """
    errors: list[float | None] = []
    for x, y, size in arrangement:
        window = slice(y, y + size), slice(x, x + size), slice(0, 3)
        wanted = reference[window].astype(np.float64)
        total = wanted.sum()
        difference = np.abs(fit[window] - wanted).sum()
        errors.append(float(difference / total) if total > 0 else None)
    return errors
