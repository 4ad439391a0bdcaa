# SPDX-License-Identifier: Apache-2.0
"""Reading the keys of a stage, as the lobes of their cards."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from pxr import Usd

from asglight.images import ocio
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.options import KeyLights
from asglight.usd.read.edited_lights import hidden_lobes, switched_off, with_key_edits
from asglight.usd.read.placement import placement_of
from asglight.usd.read.read_options import card_distance_of
from asglight.usd.read.rest import Rest, images_of, read_rest
from asglight.usd.read.times import frame_numbers
from asglight.usd.read.tracks import darkened, known_space, lobes_at, slants_at
from asglight.usd.read.view import View
from asglight.usd.schema import Representation
from asglight.usd.spaces import in_colorspace
from asglight.usd.stage import (
    held_representations,
    key_lights,
    lobe_prims,
    name_of,
    open_rig,
    readable,
    representations_of,
    show,
)


@dataclass(frozen=True)
class Keys:
    """The keys of a stage.

    Attributes:
        tracks: As the lobes of their cards, in Rec.709 and with +Y up; None where the images have
            no lamp. What nobody sees is black.
        rest: The images without them.
        times: Frame numbers.  F
        fps: Frames per second.
        changes: What other programs changed, one line each.
        unmuted: The keys with the light of those that are invisible in every frame, as if they
            were seen.
        muted: Indices of those keys.
    """

    tracks: LobeTracks | None
    rest: Rest
    times: tuple[int, ...]
    fps: float
    changes: tuple[str, ...] = ()
    unmuted: LobeTracks | None = None
    muted: frozenset[int] = frozenset()


def read_keys(path: str | Path | Usd.Stage, rig: str | None = None) -> Keys | None:
    """Read the keys of a stage, with what another program changed in their lights.

    Args:
        path: The stage.
        rig: Path of the prim that holds the lobes, of a stage with several.

    Returns:
        None of a stage without keys.

    Raises:
        InputError: There is no such stage, or a value is damaged.
    """
    stage, prim = open_rig(path, rig)
    if Representation.KEYS not in held_representations(prim):
        return None
    stage.SetEditTarget(stage.GetSessionLayer())
    with readable(path), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        show(prim, Representation.KEYS)
        times = frame_numbers(stage, prim, lobe_prims(prim))
        placement, distance = placement_of(prim, times), card_distance_of(prim)
        space = known_space(name_of(path), prim)
        view = View(prim, times, Representation.KEYS, distance, placement, space.colorspace)
        rest = read_rest(view)
        fps = stage.GetTimeCodesPerSecond()
        prims, gone = lobe_prims(prim, schema.KEYS), switched_off(prim, schema.KEYS)
        if not prims:
            return Keys(None, rest, times, fps, (*gone, *rest.changes))
        lobes = lobes_at(name_of(path), prims, times)
        lobes = replace(lobes, slant=slants_at(name_of(path), prims, times))
        lobes, changes = with_key_edits(
            prim, prims, lobes, times, distance, placement, space.colorspace
        )
        lobes = in_colorspace(lobes, space.colorspace, ocio.REC709)
        names = tuple(one.GetName() for one in prims)
        called = {one.GetName(): one.GetDisplayName() for one in prims if one.GetDisplayName()}
        hidden, invisible = hidden_lobes(prims, times)
        muted = hidden.all(dim=0)  # [K]
        unmuted = LobeTracks(times, fps, darkened(lobes, hidden & ~muted), {}, names, called)
        tracks = replace(unmuted, lobes=darkened(lobes, hidden))
    changes = (*gone, *changes, *invisible, *rest.changes)
    indices = frozenset(torch.nonzero(muted)[:, 0].tolist())
    return Keys(tracks, rest, times, fps, changes, unmuted, indices)


def read_shown_keys(path: str | Path, rig: str | None = None) -> Keys | None:
    """Read the keys of a stage that shows them; None of one that shows something else.

    Raises:
        InputError: As `read_keys`.
    """
    shows, _ = representations_of(path, rig)
    return read_keys(path, rig) if shows == Representation.KEYS else None


@dataclass(frozen=True)
class HeldKeys:
    """The keys of a stage, what they shine as, and the pixels of their lamps.

    Attributes:
        keys: The keys.
        lights: What they shine as.
        textures: Of each key its image at each frame, as USD resolves it; empty without.
    """

    keys: Keys
    lights: KeyLights
    textures: tuple[tuple[str, ...], ...]


def held_keys(path: str | Path, rig: str | None = None) -> HeldKeys | None:
    """Read the keys of a stage with all that they shine with; None of a stage without keys.

    Raises:
        InputError: As `read_keys`.
    """
    found = read_keys(path, rig)
    if found is None:
        return None
    stage, prim = open_rig(path, rig)
    stage.SetEditTarget(stage.GetSessionLayer())
    show(prim, Representation.KEYS)
    prims = lobe_prims(prim, schema.KEYS)
    return HeldKeys(found, key_lights(prims), tuple(_textures(one, found.times) for one in prims))


def _textures(prim: Usd.Prim, frames: tuple[int, ...]) -> tuple[str, ...]:
    found = images_of(prim, frames)
    return found if all(found) else ()
