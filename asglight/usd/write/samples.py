# SPDX-License-Identifier: Apache-2.0
"""Which time samples to keep: those that interpolation between the kept ones cannot reproduce.

USD interpolates numbers and vectors linearly and quaternions by slerp the shorter way. Samples are
chosen by splitting, all spans at a time, at the worst deviation [Douglas and Peucker 1973,
"Algorithms for the reduction of the number of points required to represent a digitized line"].

Symbols: F frames, K components of a value.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interpolation = Callable[[Array, Array, Array], Array]

QUATERNION_TOLERANCE = 2.5e-7
"""Largest difference of a component: four float32 roundings, 5e-7 radians of turn."""

DOT_MIN = 0.1
"""Quaternions nearer to a right angle than this (turns near 180 degrees) are never interpolated
between: rounding would decide which way is the shorter."""


FEW = 0.5
"""Share of the frames. A crate stores a list of times once for all attributes that share it; an
attribute that needs more samples than this is smaller with the list of all frames."""


def kept(values: Array, frames: Array, tolerance: float) -> NDArray[np.bool_]:
    """Mark the samples that linear interpolation needs.

    The tolerance is relative to each value rather than to the track's range, so that a track over
    many decades keeps its small values.

    Args:
        values: One track.  [F, K]
        frames: Frame numbers, ascending.  [F]
        tolerance: Largest relative error of a component that is left out.

    Returns:
        True where the sample is kept: the first, the last and a few; or none, where the first value
        stands for all; or all.  [F]
    """
    return _split(values, frames, _lerp, tolerance * np.abs(values))


def kept_quaternions(quaternions: Array, frames: Array) -> NDArray[np.bool_]:
    """Mark the samples that slerp needs, to `QUATERNION_TOLERANCE`.

    Args:
        quaternions: One track, (w, x, y, z).  [F, 4]
        frames: Frame numbers, ascending.  [F]

    Returns:
        True where the sample is kept, as `kept`.  [F]
    """
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return _split(unit, frames, _slerp_unless_ambiguous, np.full_like(unit, QUATERNION_TOLERANCE))


def _split(
    values: Array, frames: Array, interpolate: Interpolation, tolerance: Array
) -> NDArray[np.bool_]:
    def excess(first: NDArray, last: NDArray, inner: NDArray) -> Array:
        """Return the error at samples `inner` between two kept ones, in tolerances."""
        share = (frames[inner] - frames[first]) / (frames[last] - frames[first])
        predicted = interpolate(values[first], values[last], share[:, None])
        error = np.abs(predicted - values[inner])
        # a value of exactly 0 has tolerance 0: there any error that float32 can hold is too large
        allowed = np.maximum(tolerance[inner], float(np.finfo(np.float32).smallest_subnormal))
        return (error / allowed).max(-1)

    if bool((np.abs(values - values[0]) <= tolerance).all()):
        return np.zeros(len(frames), dtype=bool)
    inner = np.arange(1, len(frames) - 1)
    keep = np.ones(len(frames), dtype=bool)
    # Whatever can be left out lies within about two tolerances of its neighbours' line: this one
    # test leaves the splitting nothing to do on a noisy track.
    keep[1:-1] = excess(inner - 1, inner + 1, inner) > 2
    inner = np.flatnonzero(~keep)
    while len(inner) and keep.sum() <= FEW * len(keep):
        corners = np.flatnonzero(keep)
        span = np.searchsorted(corners, inner)  # of the corner after each sample
        errors = excess(corners[span - 1], corners[span], inner)
        begins = _begins(span)
        worst = np.maximum.reduceat(errors, np.flatnonzero(begins))
        within = np.cumsum(begins) - 1  # which span each sample is in
        far_off = (worst > 1)[within]
        # of every span that is too far off, the first of its worst samples
        chosen = np.flatnonzero(far_off & (errors == worst[within]))
        chosen = chosen[_begins(within[chosen])]
        keep[inner[chosen]] = True
        far_off[chosen] = False
        inner = inner[far_off]  # spans that are near enough stay so
    return keep if keep.sum() <= FEW * len(keep) else np.ones_like(keep)


def _begins(groups: NDArray) -> NDArray[np.bool_]:
    """Mark the first sample of each group; those of a group lie together."""
    return np.diff(groups, prepend=-1) != 0


def _lerp(first: Array, last: Array, share: Array) -> Array:
    return (1 - share) * first + share * last


def _slerp_unless_ambiguous(first: Array, last: Array, share: Array) -> Array:
    """Turn quaternions evenly, as USD does; infinite where rounding decides which way."""
    cosine = (first * last).sum(-1, keepdims=True)
    last = np.where(cosine < 0, -last, last)
    # the angle from the chord keeps the digits that arccos loses near 1
    chord = np.linalg.norm(last - first, axis=-1, keepdims=True)
    angle = 2 * np.arcsin(np.minimum(chord / 2, 1))
    sine = np.maximum(np.sin(angle), np.finfo(np.float64).tiny)
    same = angle < 1e-9  # below it slerp is linear to rounding
    from_first = np.where(same, 1 - share, np.sin((1 - share) * angle) / sine)
    from_last = np.where(same, share, np.sin(share * angle) / sine)
    result = from_first * first + from_last * last
    return np.where(np.abs(cosine) < DOT_MIN, np.inf, result)
