# SPDX-License-Identifier: Apache-2.0
"""Lobes that stand in for each other, as `fit` and `info` tell it."""

from typing import Any

from asglight.cli.printing import counted


NAMED = 3
"""Sets that are printed. A shot of lamps that pass has a dozen; `--json` has all of them."""


def condition_lines(found: list[dict[str, Any]]) -> list[str]:
    """Return one line for all sets; none where every lobe stands for itself.

    Args:
        found: What `asglight.shots.conditioning.condition_of` found.
    """
    if not found:
        return []
    sets = "; ".join(f"{', '.join(one['lobes'])} (frame {one['frame']})" for one in found[:NAMED])
    more = f"; and {len(found) - NAMED} more (--json)" if len(found) > NAMED else ""
    return [
        f"ill-conditioned: {counted(len(found), 'set')} of lobes whose light only together is "
        f"certain: {sets}{more}"
    ]
