# SPDX-License-Identifier: Apache-2.0
"""Turns about the origin, as NumPy matrices that multiply columns."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OPPOSITE = 1e-6
"""One plus the cosine of directions that have no least turn: what is returned then is no turn."""


def turn_between(before: Array, now: Array) -> Array:
    """Return the least turn from one unit direction to others [Rodrigues 1840].

    Args:
        before: [3]
        now: None the opposite of it.  [..., 3]

    Returns:
        [..., 3, 3]
    """
    across = now[..., :, None] * before
    across = across - across.swapaxes(-1, -2)  # times a vector: its cross product with before x now
    # Rodrigues' formula without the angle
    part = 1 / np.maximum(1 + now @ before, OPPOSITE)
    return np.eye(3) + across + part[..., None, None] * (across @ across)
