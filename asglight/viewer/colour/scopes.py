# SPDX-License-Identifier: Apache-2.0
"""Histogram and waveform of a picture, in stops from middle grey: plain numbers.

Symbols: B bins; H, W rows and columns of a picture.
"""

import numpy as np

from asglight.viewer.state.display import MIDDLE_GREY

STOPS_LOW, STOPS_HIGH = -12.0, 12.0
"""Range: from the black of a screen to a lamp in the picture."""

BINS = 192
"""Eight of a stop."""

COLUMNS = 256
"""Of a waveform at most."""

BLACK = 2.0**-100
"""Stands for black, which has no stops: it counts in the lowest bin."""

DENSE = 12.0
"""How many times the even density a bin of a waveform has to have to be all but white."""


def centres() -> np.ndarray:
    """Return the middle of each bin, in stops.  [B]."""
    step = (STOPS_HIGH - STOPS_LOW) / BINS
    return STOPS_LOW + step * (np.arange(BINS) + 0.5)


def bins(radiance: np.ndarray) -> np.ndarray:
    """Return the bin of each value; what is beyond the range is in the first or the last."""
    stops = np.log2(np.maximum(radiance, BLACK) / MIDDLE_GREY)
    place = np.floor((stops - STOPS_LOW) / (STOPS_HIGH - STOPS_LOW) * BINS)
    return np.clip(place, 0, BINS - 1).astype(np.int64)


def histogram(radiance: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return which share of a picture is how bright, for red, green and blue.

    Args:
        radiance: Linear, exposed.  [H, W, 3]
        weight: Of each pixel: its coverage, or its solid angle.  [H, W]

    Returns:
        Shares of the whole weight; 0 everywhere if there is none.  [3, B]
    """
    place, total = bins(radiance), float(weight.sum())
    counted = [
        np.bincount(place[..., channel].ravel(), weight.ravel(), BINS) for channel in range(3)
    ]
    return np.stack(counted) / (total if total > 0 else 1.0)


def waveform(radiance: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return how bright each column of a picture is, as a picture of densities.

    Args:
        radiance: Linear, exposed.  [H, W, 3]
        weight: Of each pixel.  [H, W]

    Returns:
        0 to 1 for red, green and blue; the brightest bin is the first row.  [B, C, 3]
    """
    width = radiance.shape[1]
    columns = min(width, COLUMNS)
    column = np.broadcast_to(np.arange(width) * columns // width, weight.shape)
    place = bins(radiance)
    found = []
    for channel in range(3):
        flat = place[..., channel] * columns + column
        counted = np.bincount(flat.ravel(), weight.ravel(), BINS * columns)
        found.append(counted.reshape(BINS, columns)[::-1])
    density = np.stack(found, axis=-1)
    each = density.sum(0, keepdims=True)
    share = density / np.where(each > 0, each, 1.0) * BINS
    return 1 - np.exp(-share / DENSE)
