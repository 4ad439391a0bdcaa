# SPDX-License-Identifier: Apache-2.0
"""Keys of a stage at other times, and of a shot that is stitched from parts."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from asglight.lobes import Lobes, LobeTracks, motion
from asglight.lobes.stitching import stitched
from asglight.shots.keyed.mixed import (
    MixedKeys,
    merged_document,
    resampled_shares,
    same_keys,
    stitched_shares,
)
from asglight.usd.read.keys import HeldKeys, held_keys


def resampled_keys(
    stage: str, rig: str | None, new: LobeTracks, times: Sequence[float], told: dict[str, Any]
) -> MixedKeys:
    """Return the keys of a stage at other times.

    Args:
        stage: A stage that has keys.
        rig: Prim that holds the lobes, of a stage with several.
        new: The lobes at these times.
        times: Of the new frames, in old frame numbers.
        told: What the stage tells of its keys.

    Raises:
        InputError: The keys cannot be read.
    """
    held = held_keys(stage, rig)
    assert held is not None
    keys, tracks = held.keys, None
    if keys.tracks is not None:
        lobes = motion.at(keys.tracks, times)
        called = keys.tracks.names, keys.tracks.display_names
        tracks = LobeTracks(new.frames, new.fps, lobes, {}, *called)
    same = range(0 if tracks is None else tracks.lobes.count)
    shares = resampled_shares(keys.times, times)
    return MixedKeys(tracks, new.frames, [held], shares, [same], _retimed(told, new.frames, times))


def _retimed(told: dict[str, Any], frames: Sequence[int], times: Sequence[float]) -> dict[str, Any]:
    """Return what is told of keys, with the frames in which they are at other times."""

    def of(old: Sequence[int]) -> list[int]:
        within = [f for f, time in zip(frames, times, strict=True) if old[0] <= time < old[1] + 1]
        near = [min(zip(frames, times, strict=True), key=lambda at: abs(at[1] - old[0]))[0]]
        return [(within or near)[0], (within or near)[-1]]

    return {**told, "keys": [{**row, "frames": of(row["frames"])} for row in told["keys"]]}


def stitched_keys(
    files: Sequence[str], parts: Sequence[LobeTracks], names: Sequence[str]
) -> MixedKeys | None:
    """Return the keys of a shot from those of its parts; None where a part has no images of a rest.

    Args:
        files: Stages of the parts, in the order in which they begin.
        parts: Their lobes.
        names: What to call them in a message.

    Raises:
        InputError: Keys cannot be read, or do not fit together.
    """
    held = [held_keys(file) for file in files]
    sources = [one for one in held if one is not None]
    if len(sources) < len(held):
        return None
    shares = stitched_shares([one.keys.times for one in sources])
    own = [one.keys.tracks for one in sources]
    tracks = None
    if any(one is not None for one in own):
        whole = stitched([one.keys.tracks or _dark(one) for one in sources], names)
        called = dict(zip(whole.names, _key_names(whole.names), strict=True))
        shown = {called[name]: text for name, text in whole.display_names.items()}
        tracks = replace(whole, names=tuple(called.values()), display_names=shown)
    same = [[] if tracks is None or one is None else same_keys(tracks, one) for one in own]
    known = () if tracks is None else tracks.names
    told = merged_document(
        [_in_order(part.metadata["keys"], one) for part, one in zip(parts, own, strict=True)],
        [part.frames for part in parts],
        same,
        known,
    )
    return MixedKeys(tracks, tuple(shares), sources, list(shares.values()), same, told)


def _dark(held: HeldKeys) -> LobeTracks:
    """Return a key without light, for a part that has none."""
    count = len(held.keys.times)
    axes = torch.eye(3).expand(count, 1, 3, 3)
    lobes = Lobes(axes, torch.full((count, 1, 2), 50.0), torch.zeros(count, 1, 3))
    return LobeTracks(held.keys.times, held.keys.fps, lobes, names=("key_00",))


def _key_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of keys for those that are named as lobes: numbers that no other key has."""
    is_key = {name: not name.startswith("lobe_") for name in names}
    free = (name for number in itertools.count() if (name := f"key_{number:02d}") not in is_key)
    return tuple(name if is_key[name] else next(free) for name in names)


def _in_order(told: dict[str, Any], tracks: LobeTracks | None) -> dict[str, Any]:
    """Return what is told of the keys of a part, in the order of its keys."""
    rows = {row["name"]: row for row in told["keys"]}
    names = () if tracks is None else tracks.names
    return {**told, "keys": [rows[name] for name in names]}
