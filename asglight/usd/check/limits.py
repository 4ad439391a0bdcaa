# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a light may be: checked as they are authored, and by the lint."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asglight.usd import schema

LIMITS = {
    schema.COLOR: (0.0, 1.0),
    schema.INTENSITY: (0.0, math.inf),
    schema.WIDTH: (0.0, math.inf),
    schema.HEIGHT: (0.0, math.inf),
    schema.ANGLE: (0.0, 180.0),
    schema.SHARPNESS: (0.0, math.inf),
    schema.AMPLITUDE: (0.0, math.inf),
}
"""Lowest and highest value of each component. Beyond 180 degrees a normalised distant light no
longer gives the irradiance that its intensity says."""


def number_findings(
    name: str, rows: NDArray[Any], values: Sequence[Any] | NDArray[Any]
) -> Iterator[str]:
    """Report numbers that no light can have.

    Args:
        name: Of the attribute.
        rows: Its default and samples.  [V, K]
        values: The same, as a finding tells them.  V
    """
    low, high = LIMITS.get(name, (-math.inf, math.inf))
    finite = np.isfinite(rows).all(-1)
    inside = (rows >= low).all(-1) & (rows <= high).all(-1)
    for good, expected in ((finite, "finite numbers"), (inside | ~finite, f"{low:g} to {high:g}")):
        if not good.all():
            yield f"is {values[int(np.flatnonzero(~good)[0])]}; expected {expected}"
