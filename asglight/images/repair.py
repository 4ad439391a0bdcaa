# SPDX-License-Identifier: Apache-2.0
"""The repair of an image: negative and non-finite values set to 0, and the account of it.

Resampling with a sharp filter leaves negative texels beside bright lamps, and renderers leave
NaN. A light can have neither, so both become 0 before anything is averaged or fitted.
The account says how many texels that concerns and how much light the negatives carried.

What is +inf is light, and has been replaced before (infinite.py). A frame that lost too much to be
the one that was meant is refused (loss.py).

Only the channels at fault become 0, so a slightly negative blue costs neither red nor green.
Non-finite values go before the conversion of primaries, which would spread them to all three
channels; negative ones after it, because a value may be negative in one set of primaries and not in
another.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asglight.images.infinite import HALF_MAX
from asglight.sphere.overlaps import row_solid_angles


@dataclass(frozen=True)
class Repair:
    """What was changed in an image before it was used.

    Attributes:
        negative: Finite texels with at least one negative channel.
        nonfinite: Texels with at least one channel that is NaN or -inf.
        negative_flux_ratio: Flux of the negative values over the flux of the positive ones, both
            taken positive; infinite where nothing is positive.
        first: Row and column of the first non-finite texel, in the file's own grid.
        filled_from: Frames that stand in for a missing or damaged one: one frame held, or the two
            it lies between. Empty for a frame that is there.
        fault: What the frame is that others stand in for: `missing`, or how its file is damaged.
        infinite: Texels with at least one channel that was +inf.
    """

    negative: int = 0
    nonfinite: int = 0
    negative_flux_ratio: float = 0.0
    first: tuple[int, int] | None = None
    filled_from: tuple[int, ...] = ()
    fault: str = ""
    infinite: int = 0

    @property
    def texels(self) -> int:
        """Return how many texels were changed."""
        return self.negative + self.nonfinite + self.infinite

    @property
    def is_clean(self) -> bool:
        """True when the image is used as it was found."""
        return self.texels == 0 and not self.filled_from

    def sentence(self) -> str:
        """Say in one line what was changed."""
        clauses = (self._filling(), self._zeroing(), self._keeping())
        return "; ".join(filter(None, clauses)) or "nothing repaired"

    def _filling(self) -> str:
        if not self.filled_from:
            return ""
        if len(self.filled_from) == 1:
            return f"frame {self.fault}, held from {self.filled_from[0]}"
        return "frame {}, interpolated between {} and {}".format(self.fault, *self.filled_from)

    def _keeping(self) -> str:
        if not self.infinite:
            return ""
        noun = "texel" if self.infinite == 1 else "texels"
        return f"{self.infinite} infinite {noun} taken as {HALF_MAX:g}, or as the light around"

    def _zeroing(self) -> str:
        at_zero = self.negative + self.nonfinite
        if not at_zero:
            return ""
        kinds = [
            f"{count} {kind}"
            for count, kind in ((self.nonfinite, "NaN"), (self.negative, "negative"))
            if count
        ]
        noun = "texel" if at_zero == 1 else "texels"
        clause = f"{' and '.join(kinds)} {noun} set to 0"
        if not self.negative:
            return clause
        if self.negative_flux_ratio == math.inf:
            return f"{clause} (nothing in the image is positive)"
        return f"{clause} (negative flux {100 * self.negative_flux_ratio:.2g} % of the positive)"

    def merged(self, other: "Repair") -> "Repair":
        """Return the account of an image made from two, such as an interpolated frame."""
        return Repair(
            negative=self.negative + other.negative,
            nonfinite=self.nonfinite + other.nonfinite,
            negative_flux_ratio=max(self.negative_flux_ratio, other.negative_flux_ratio),
            first=self.first or other.first,
            infinite=self.infinite + other.infinite,
        )


@dataclass(frozen=True)
class Tally:
    """What was changed in some rows of an image.

    Attributes:
        negative: Finite texels with at least one negative channel.
        nonfinite: Texels with at least one channel that is NaN or -inf.
        below: Flux of the negative values, taken positive.
        first: Row and column of the first texel of `nonfinite`.
        infinite: Texels with at least one channel that was +inf.
    """

    negative: int = 0
    nonfinite: int = 0
    below: float = 0.0
    first: tuple[int, int] | None = None
    infinite: int = 0

    def __add__(self, after: "Tally") -> "Tally":
        """Return what was changed in these rows and in some that follow them."""
        return Tally(
            self.negative + after.negative,
            self.nonfinite + after.nonfinite,
            self.below + after.below,
            self.first or after.first,
            self.infinite + after.infinite,
        )

    def account(self, repaired: NDArray[np.float32]) -> Repair:
        """Return the account of an image.

        Args:
            repaired: The whole repaired image, or what it was reduced to: it has its flux.
                [H', W', 3]
        """
        ratio = 0.0
        if self.below:
            solid_angles = row_solid_angles(*repaired.shape[:2])
            # Summed in float64: a float32 map may hold values whose sum overflows.
            above = float(solid_angles @ repaired.sum(axis=(1, 2), dtype=np.float64))
            ratio = self.below / above if above else math.inf
        return Repair(self.negative, self.nonfinite, ratio, self.first, infinite=self.infinite)


def repair_rows(
    rows: NDArray[np.float32],
    solid_angles: NDArray[np.float64],
    matrix: NDArray[np.float64] | None = None,
    top: int = 0,
) -> tuple[NDArray[np.float32], Tally]:
    """Set negative and non-finite values to 0, converting the primaries in between.

    Args:
        rows: Some rows of an image in the file's primaries.  [rows, W, 3]
        solid_angles: Of a texel of each row.  [rows]
        matrix: From the file's primaries to Rec.709; None where they are.  [3, 3]
        top: Number of the first of these rows in the image.

    Returns:
        The rows in Rec.709 primaries, finite and >= 0, [rows, W, 3], and what was changed.
    """
    finite = np.isfinite(rows)
    filled = np.where(finite, rows, np.float32(0))
    if matrix is not None:
        # Values near the end of float32 may pass it on the way.
        with np.errstate(over="ignore"):
            filled = (filled.astype(np.float64) @ matrix.T).astype(np.float32)
        finite = finite & np.isfinite(filled)
        filled = np.where(finite, filled, np.float32(0))
    nonfinite = ~finite.all(axis=-1)  # [rows, W]
    negative = (filled < 0).any(axis=-1) & ~nonfinite
    # Summed in float64: a float32 map may hold values whose sum overflows.
    below = -float(solid_angles @ np.minimum(filled, 0).sum(axis=(1, 2), dtype=np.float64))
    at_fault = np.argwhere(nonfinite)
    first = None if not len(at_fault) else (top + int(at_fault[0, 0]), int(at_fault[0, 1]))
    tally = Tally(int(negative.sum()), len(at_fault), max(below, 0.0), first)
    return np.maximum(filled, 0), tally
