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
        filled_from: Frames that stand in for a missing one: one frame held, or the two it lies
            between. Empty for a frame that is there.
    """

    negative: int = 0
    nonfinite: int = 0
    negative_flux_ratio: float = 0.0
    first: tuple[int, int] | None = None
    filled_from: tuple[int, ...] = ()

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
            return f"frame missing, held from {self.filled_from[0]}"
        return "frame missing, interpolated between {} and {}".format(*self.filled_from)

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


def repair(radiance: Tensor, to_rec709: Tensor | None = None) -> tuple[Tensor, Repair]:
    """Set negative and non-finite values to 0, converting the primaries in between.

    Only the channels at fault become 0, so a slightly negative blue costs neither red nor green.
    Non-finite values go before the conversion, which would spread them to all three channels;
    negative ones after it, because a value may be negative in one set of primaries and not in
    another.

    Args:
        radiance: Map in the file's primaries.  [H, W, 3]
        to_rec709: Matrix from the file's primaries; None where they are Rec.709.  [3, 3]

    Returns:
        Map in Rec.709 primaries, finite and >= 0, and the account of the change.  [H, W, 3]
    """
    if to_rec709 is None and _is_clean(radiance):
        return radiance, Repair()
    height, width = radiance.shape[:2]
    solid_angles = latlong.texel_solid_angles(height, width, dtype=torch.float64)[:, 0]
    blocks = [
        _repair_rows(rows, weights, to_rec709)
        for rows, weights in zip(radiance.split(ROWS), solid_angles.split(ROWS), strict=True)
    ]
    nonfinite = torch.cat([block.nonfinite for block in blocks])  # [H, W]
    first = torch.nonzero(nonfinite)[:1].flatten().tolist()
    below, above = (sum(block.fluxes[side] for block in blocks) for side in (0, 1))
    account = Repair(
        negative=sum(block.negative for block in blocks),
        nonfinite=int(nonfinite.sum()),
        negative_flux_ratio=below / above if above else math.inf if below else 0.0,
        first=(first[0], first[1]) if first else None,
    )
    return torch.cat([block.radiance for block in blocks]), account


@dataclass(frozen=True)
class _Block:
    """Some repaired rows, and their part of the account."""

    radiance: Tensor  # [rows, W, 3]
    nonfinite: Tensor  # [rows, W]
    negative: int
    fluxes: tuple[float, float]  # below zero and above it, both taken positive


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
    repaired = filled.clamp(min=0)
    # Summed in float64: a float32 map may hold values whose sum overflows.
    below, above = (
        float(solid_angles @ values.sum(dim=(1, 2), dtype=torch.float64).abs())
        for values in (filled.clamp(max=0), repaired)
    )
    return _Block(repaired, nonfinite, int(negative.sum()), (below, above))
