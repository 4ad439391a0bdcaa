# SPDX-License-Identifier: Apache-2.0
"""How a quantity grows with a size: the exponent of a power law, and how well it is known.

y = c x^p is a line in logarithms, log y = log c + p log x; p is its slope by least squares. With n
points the residuals have n - 2 degrees of freedom, and the standard error of the slope is
s / sqrt(sum (log x - mean)^2), s^2 = sum residual^2 / (n - 2) [Draper and Smith, "Applied
Regression Analysis", 3rd edition, 1998, chapter 1].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

POINTS_MIN = 3
"""Two points lie on a line whatever they are: it takes a third to see how far they stray."""


@dataclass(frozen=True)
class PowerLaw:
    """y = coefficient * x^exponent.

    Attributes:
        exponent: p.
        standard_error: Of p.
        coefficient: c, y at x = 1.
        spread: Largest factor between a point and the line, from 1 on.
        points: How many.
    """

    exponent: float
    standard_error: float
    coefficient: float
    spread: float
    points: int

    def at(self, x: float) -> float:
        """Return y."""
        return self.coefficient * x**self.exponent


def power_law(x: Sequence[float], y: Sequence[float]) -> PowerLaw | None:
    """Fit a power law; None for fewer than three different sizes, or a quantity that is 0.

    Args:
        x: Sizes, above 0.
        y: The quantity at each.
    """
    if len(set(x)) < POINTS_MIN or min(y) <= 0:
        return None
    log_x, log_y = np.log(x), np.log(y)
    from_mean = log_x - log_x.mean()
    around = float(from_mean @ from_mean)
    exponent = float(from_mean @ log_y) / around
    start = float(log_y.mean() - exponent * log_x.mean())
    residual = log_y - start - exponent * log_x
    variance = float(residual @ residual) / (len(x) - 2)
    return PowerLaw(
        exponent,
        math.sqrt(variance / around),
        math.exp(start),
        math.exp(float(np.abs(residual).max())),
        len(x),
    )
