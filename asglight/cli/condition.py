# SPDX-License-Identifier: Apache-2.0
"""Lobes that stand in for each other, as `fit` and `info` tell it."""

from typing import Any

from asglight.cli.printing import counted
from asglight.lobes import LobeTracks


def condition_of(tracks: LobeTracks) -> list[dict[str, Any]]:
    """Return the sets of lobes that trade, as JSON values, the largest first.

    A few frames are looked at, spread over the shot: lobes that come to lie together mostly stay
    so. A set that is met in several is told once, with the frame in which it is worst.
    """
    from asglight.fitting.condition import groups, trades
    from asglight.shots.tolerance import spread_frames
    from asglight.threads import one_thread

    found: dict[tuple[int, ...], dict[str, Any]] = {}
    for frame in spread_frames(tracks.frames):
        with one_thread():
            pairs = trades(tracks.at(frame))
        for group in groups(pairs):
            worst = max(pair.amplification for pair in pairs if pair.lobes[0] in group)
            known = found.get(tuple(group))
            if known is None or worst > known["amplification"]:
                names = [tracks.names[index] for index in group]
                found[tuple(group)] = {"lobes": names, "frame": frame, "amplification": worst}
    return sorted(found.values(), key=lambda one: -len(one["lobes"]))


def condition_lines(found: list[dict[str, Any]]) -> list[str]:
    """Return one line for all sets; none where every lobe stands for itself."""
    if not found:
        return []
    sets = "; ".join(f"{', '.join(one['lobes'])} (frame {one['frame']})" for one in found)
    return [
        f"ill-conditioned: {counted(len(found), 'set')} of lobes whose light only together is "
        f"certain: {sets}"
    ]
