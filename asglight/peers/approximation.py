# SPDX-License-Identifier: Apache-2.0
"""What every method of the comparison returns: something with a size and a map.

A method takes a map [H, W, 3] and a budget of floats, and keeps within it. Floats are degrees of
freedom, counted alike for all: a direction is 2, a frame 3, a sharpness 1, RGB 3, an index into a
table 1. What is the same for every map (a basis, axes on a fixed spiral) counts nothing.
"""

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from asglight.lobes import Form, Lobes, texels

LOBE_FLOATS = {Form.ASG: 8, Form.BINGHAM: 8, Form.SG: 6, Form.FLAT: 8}
"""Frame 3 and sharpnesses 2, or direction 2 and sharpness 1; and RGB 3."""


class Approximation(Protocol):
    """A map in fewer numbers."""

    @property
    def floats(self) -> int:
        """Numbers that it takes to store this."""
        ...

    def texel_means(self, height: int, width: int) -> Tensor:
        """Return the mean radiance over each texel of a latlong grid.  [H, W, 3].

        Means, not samples: what is narrower than a texel keeps its energy.
        """
        ...


@dataclass(frozen=True)
class LobeSum:
    """A sum of lobes.

    Attributes:
        lobes: The lobes.  [N, .]
        lobe_floats: Numbers that differ from map to map, of one lobe.
    """

    lobes: Lobes
    lobe_floats: int

    @property
    def floats(self) -> int:
        """Numbers that it takes to store this."""
        return self.lobe_floats * self.lobes.count

    def texel_means(self, height: int, width: int) -> Tensor:
        """Return the mean radiance over each texel of a latlong grid.  [H, W, 3]."""
        return texels.texel_means(self.lobes, height, width)


def free_lobes(lobes: Lobes) -> LobeSum:
    """Return a sum of lobes of which every number is free."""
    return LobeSum(lobes, LOBE_FLOATS[lobes.form])
