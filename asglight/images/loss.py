# SPDX-License-Identifier: Apache-2.0
"""Images that lost too much of their light or of their texels to be the ones that were meant."""

import math
from pathlib import Path

from asglight.images.decoding.header import DamagedError
from asglight.images.repair import Repair

CONVERTED_MAX = 0.9
"""Share of negative light from which a converted image is none. Rec.709 cannot show the green of
Rec.2020, which has 0.6 of it there; layers of vectors have 1."""


def check_loss(
    path: Path, account: Repair, texels: int, limit: float, *, is_converted: bool = False
) -> None:
    """Refuse an image that lost too much to be the one that was meant.

    Args:
        path: The file, for the message.
        account: What was changed.
        texels: How many the image has.
        limit: Share of the light or of the texels that may be lost.
        is_converted: Its primaries have been converted to Rec.709.

    Raises:
        DamagedError: It lost more, or everything.
    """
    lost = account.nonfinite + account.infinite
    if account.nonfinite == texels:
        raise DamagedError(path, "holds nothing but NaN", "expected light. Render it again.")
    if lost > limit * texels:
        raise DamagedError(
            path,
            f"has NaN or infinite values in {_share(lost / texels)} of its texels",
            f"expected at most {_share(limit)}. Render it again, or take it as it is with "
            f"--repair {_enough(lost / texels)}.",
        )
    ratio = account.negative_flux_ratio
    if ratio == math.inf:
        raise DamagedError(
            path,
            "holds negative values and nothing above 0",
            "expected light. Is it a layer of normals or a difference?",
        )
    if ratio > (max(limit, CONVERTED_MAX) if is_converted else limit):
        raise DamagedError(
            path,
            f"holds {_share(ratio)} as much negative light as positive",
            f"expected at most {_share(limit)}. Is it a layer of normals or a difference? To take "
            f"it as it is: --repair {_enough(ratio)}.",
        )


def _share(ratio: float) -> str:
    return f"{100 * ratio:.3g} %"


def _enough(ratio: float) -> str:
    """Return a limit that lets a share pass: two digits, rounded up."""
    return f"{min(1.0, math.ceil(100 * ratio - 1e-9) / 100):g}"
