# SPDX-License-Identifier: Apache-2.0
"""Lobes of a shot that stand in for each other, as the account that the stage keeps.

It is found where the shot is fitted or stitched: whoever reads a stage needs no fitter for it.
"""

import math
from dataclasses import replace
from typing import Any

from asglight.fitting.steps.condition import groups, trades
from asglight.lobes import LobeTracks
from asglight.shots.tolerance import spread_frames
from asglight.threads import one_thread

KEY = "ill_conditioned"
"""Of the metadata."""


def with_condition(tracks: LobeTracks) -> LobeTracks:
    """Return tracks whose metadata tell the sets of lobes that trade."""
    return replace(tracks, metadata={**tracks.metadata, KEY: condition_of(tracks)})


def condition_of(tracks: LobeTracks) -> list[dict[str, Any]]:
    """Return the sets of lobes that trade, as JSON values, the largest first.

    A few frames are looked at, spread over the shot: lobes that come to lie together mostly stay
    so. A set that is met in several is told once, with the frame in which it is worst. Lobes that
    are alike have no finite amplification; it is None.
    """
    found: dict[tuple[int, ...], tuple[int, float]] = {}
    for frame in spread_frames(tracks.frames):
        with one_thread():
            pairs = trades(tracks.at(frame))
        for group in groups(pairs):
            worst = max(pair.amplification for pair in pairs if pair.lobes[0] in group)
            known = found.get(tuple(group))
            if known is None or worst > known[1]:
                found[tuple(group)] = frame, worst
    return [
        {
            "lobes": [tracks.names[index] for index in group],
            "frame": frame,
            "amplification": worst if math.isfinite(worst) else None,
        }
        for group, (frame, worst) in sorted(found.items(), key=lambda one: -len(one[0]))
    ]
