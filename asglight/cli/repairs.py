# SPDX-License-Identifier: Apache-2.0
"""What was repaired in a shot's images, as the line that `fit` and `info` print."""

from typing import Any

from asglight.cli.printing import counted
from asglight.images.frame_files import ranges


def repair_line(repairs: dict[str, Any]) -> str:
    """Return the repairs of all frames as one line; empty where there were none."""
    clauses = []
    if repairs["frames"]:
        infinite = repairs.get("infinite_texels", 0)
        kept = f" and {counted(infinite, 'infinite texel')} taken as the brightest"
        clauses.append(
            f"{repairs['nonfinite_texels']} NaN and {repairs['negative_texels']} negative "
            f"texels set to 0{kept if infinite else ''} in "
            f"{counted(len(repairs['frames']), 'frame')} ({ranges(repairs['frames'])})"
        )
    if repairs["frames_filled"]:
        filled = repairs["frames_filled"]
        clauses.append(
            f"{counted(len(filled), 'missing or damaged frame')} filled ({ranges(filled)})"
        )
    return f"repaired: {'; '.join(clauses)}" if clauses else ""
