# SPDX-License-Identifier: Apache-2.0
"""The repair of an image: negative and non-finite values set to 0, and the account of it.

Resampling with a sharp filter leaves negative texels beside bright lamps, and renderers leave
NaN and Inf. A light can have neither, so both become 0 before anything is averaged or fitted.
The account says how many texels that concerns and how much light the negatives carried.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.sphere import latlong

# Rows worked on at once: 1.5 MB of an 8k map, which stays in the processor's cache. The whole map
# at once takes twice as long.
ROWS = 16


@dataclass(frozen=True)
class Repair:
    """What was changed in an image before it was used.

    Attributes:
        negative: Finite texels with at least one negative channel.
        nonfinite: Texels with at least one NaN or infinite channel.
        negative_flux_ratio: Flux of the negative values over the flux of the positive ones, both
            taken positive; infinite where nothing is positive.
        first: Row and column of the first non-finite texel, in the file's own grid.
        filled_from: Frames that stand in for a missing or damaged one: one frame held, or the two
            it lies between. Empty for a frame that is there.
        fault: What the frame is that others stand in for: `missing`, or how its file is damaged.
    """

    negative: int = 0
    nonfinite: int = 0
    negative_flux_ratio: float = 0.0
    first: tuple[int, int] | None = None
    filled_from: tuple[int, ...] = ()
    fault: str = ""

    @property
    def texels(self) -> int:
        """Return how many texels were changed."""
        return self.negative + self.nonfinite

    @property
    def is_clean(self) -> bool:
        """True when the image is used as it was found."""
        return self.texels == 0 and not self.filled_from

    def sentence(self) -> str:
        """Say in one line what was changed."""
        clauses = [clause for clause in (self._filling(), self._zeroing()) if clause]
        return "; ".join(clauses) or "nothing repaired"

    def _filling(self) -> str:
        if not self.filled_from:
            return ""
        if len(self.filled_from) == 1:
            return f"frame {self.fault}, held from {self.filled_from[0]}"
        return "frame {}, interpolated between {} and {}".format(self.fault, *self.filled_from)

    def _zeroing(self) -> str:
        if not self.texels:
            return ""
        kinds = [
            f"{count} {kind}"
            for count, kind in ((self.nonfinite, "NaN/Inf"), (self.negative, "negative"))
            if count
        ]
        noun = "texel" if self.texels == 1 else "texels"
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
        )


class Repairing:
    """The repair of an image that comes in strips of rows, from top to bottom.

    Only the channels at fault become 0, so a slightly negative blue costs neither red nor green.
    Non-finite values go before the conversion of primaries, which would spread them to all three
    channels; negative ones after it, because a value may be negative in one set of primaries and
    not in another.
    """

    def __init__(self, height: int, width: int, to_rec709: Tensor | None = None) -> None:
        """Begin at the top.

        Args:
            height: Rows of the image.
            width: Columns of it.
            to_rec709: Matrix from the file's primaries; None where they are Rec.709.  [3, 3]
        """
        self._solid_angles = latlong.texel_solid_angles(height, width, dtype=torch.float64)[:, 0]
        self._to_rec709 = to_rec709
        self._rows = self._negative = self._nonfinite = 0
        self._first: tuple[int, int] | None = None
        self._below = 0.0  # flux of the negative values, taken positive

    def repaired(self, strip: Tensor) -> Tensor:
        """Return the next rows in Rec.709 primaries, finite and >= 0.  [rows, W, 3]."""
        top = self._rows
        self._rows += len(strip)
        if self._to_rec709 is None and _is_clean(strip):
            return strip
        blocks = []
        for start in range(0, len(strip), ROWS):
            rows = strip[start : start + ROWS]
            weights = self._solid_angles[top + start : top + start + len(rows)]
            block = _repair_rows(rows, weights, self._to_rec709)
            self._count(block, top + start)
            blocks.append(block.radiance)
        return torch.cat(blocks)

    def account(self, repaired: Tensor) -> Repair:
        """Return what was changed.

        Args:
            repaired: The whole repaired image, or what it was reduced to: it has its flux.
                [H', W', 3]
        """
        ratio = 0.0
        if self._below:
            solid_angles = latlong.texel_solid_angles(*repaired.shape[:2], dtype=torch.float64)
            # Summed in float64: a float32 map may hold values whose sum overflows.
            above = float(solid_angles[:, 0] @ repaired.sum(dim=(1, 2), dtype=torch.float64))
            ratio = self._below / above if above else math.inf
        return Repair(self._negative, self._nonfinite, ratio, self._first)

    def _count(self, block: "_Block", top: int) -> None:
        self._negative += block.negative
        self._below += block.below
        at_fault = torch.nonzero(block.nonfinite)
        if self._first is None and len(at_fault):
            row, column = at_fault[0].tolist()
            self._first = (top + row, column)
        self._nonfinite += len(at_fault)


def repair(radiance: Tensor, to_rec709: Tensor | None = None) -> tuple[Tensor, Repair]:
    """Set negative and non-finite values to 0, converting the primaries in between (`Repairing`).

    Args:
        radiance: Map in the file's primaries.  [H, W, 3]
        to_rec709: Matrix from the file's primaries; None where they are Rec.709.  [3, 3]

    Returns:
        Map in Rec.709 primaries, finite and >= 0, and the account of the change.  [H, W, 3]
    """
    height, width = radiance.shape[:2]
    repairing = Repairing(height, width, to_rec709)
    repaired = repairing.repaired(radiance)
    return repaired, repairing.account(repaired)


@dataclass(frozen=True)
class _Block:
    """Some repaired rows, and their part of the account."""

    radiance: Tensor  # [rows, W, 3]
    nonfinite: Tensor  # [rows, W]
    negative: int
    below: float  # flux of the negative values, taken positive


def _is_clean(radiance: Tensor) -> bool:
    # Both limits are NaN where any value is, and no comparison holds for NaN.
    low, high = torch.aminmax(radiance)
    return bool((low >= 0) & (high < math.inf))


def _repair_rows(radiance: Tensor, solid_angles: Tensor, to_rec709: Tensor | None) -> _Block:
    finite = torch.isfinite(radiance)
    filled = torch.where(finite, radiance, 0.0)
    if to_rec709 is not None:
        filled = (filled.double() @ to_rec709.double().T).to(radiance.dtype)
        # Values near the end of float32 may pass it on the way.
        finite = finite & torch.isfinite(filled)
        filled = torch.where(finite, filled, 0.0)
    nonfinite = ~finite.all(dim=-1)  # [rows, W]
    negative = (filled < 0).any(dim=-1) & ~nonfinite
    # Summed in float64: a float32 map may hold values whose sum overflows.
    below = float(solid_angles @ filled.clamp(max=0).sum(dim=(1, 2), dtype=torch.float64).abs())
    return _Block(filled.clamp(min=0), nonfinite, int(negative.sum()), below)
