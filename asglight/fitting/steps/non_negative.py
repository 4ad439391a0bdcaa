# SPDX-License-Identifier: Apache-2.0
"""Non-negative least squares from the normal equations."""

import numpy as np

FLAT = 1e-13
"""Slope, over the largest right-hand side, that counts as none: some roundings of float64."""

ROUNDS = 3
"""Unknowns freed at most, over how many there are: so many as scipy's allows."""


def non_negative_least_squares(
    gram: np.ndarray, right: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Minimise x^T G x / 2 - x^T b over x >= 0 [Lawson and Hanson 1974; Bro and de Jong 1997].

    Unknowns that are positive at the start are free. One after the other is freed, that with the
    steepest slope, and those that would become negative are bound again. scipy has this too, but
    takes a quarter of a second to load, half as long as the fit of a first frame takes, and always
    begins with all of them bound.

    Args:
        gram: G, positive definite, its diagonal about 1.  [N, N]
        right: b.  [N]
        start: x to begin with, at or above 0. The result does not depend on it.  [N]

    Returns:
        x.  [N]
    """
    found, free = start, start > 0
    flat = FLAT * np.abs(right).max(initial=0.0)
    for _ in range(1 + ROUNDS * len(right)):
        found = _freed(gram, right, found, free)
        slope = np.where(free, -np.inf, right - gram @ found)
        steepest = int(slope.argmax())
        if slope[steepest] <= flat:
            break
        free[steepest] = True
    return found


def _freed(gram: np.ndarray, right: np.ndarray, found: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the minimum over free unknowns; those that would become negative there are bound.

    Args:
        gram: G.  [N, N]
        right: b.  [N]
        found: Where it begins.  [N]
        free: Which are free; those that are bound leave it.  [N]
    """
    wanted = _of_free(gram, right, free)
    while wanted.min(initial=0.0) < 0:
        # as far towards it as all stay at or above 0; the first to get there is bound
        falling = wanted < 0
        room = np.full_like(wanted, np.inf)
        room[falling] = found[falling] / (found[falling] - wanted[falling])
        first = int(room.argmin())
        found = found + room[first] * (wanted - found)
        found[first], free[first] = 0.0, False
        wanted = _of_free(gram, right, free)
    return wanted


def _of_free(gram: np.ndarray, right: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the minimum over free unknowns, the others 0.  [N]."""
    found = np.zeros_like(right)
    found[free] = np.linalg.solve(gram[np.ix_(free, free)], right[free])
    return found
