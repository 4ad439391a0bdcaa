# SPDX-License-Identifier: Apache-2.0
"""Reading lobe tracks back from a stage.

A lobe is orientation, sharpness, amplitude and form. Lights are derived from it; those that were
edited by another program change it (edited_lights.py). A lobe that was deactivated is
gone.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Sdf, Usd

from asglight.errors import InputError
from asglight.images import ocio
from asglight.lobes import Form, Lobes, LobeTracks, frames
from asglight.threads import one_thread
from asglight.usd import schema
from asglight.usd.read.edited_lights import hidden_lobes, with_light_edits
from asglight.usd.read.placement import placement_of
from asglight.usd.read.read_options import card_distance_of
from asglight.usd.read.times import frame_numbers
from asglight.usd.read.unread import unread_of
from asglight.usd.spaces import Space, in_colorspace, space_of
from asglight.usd.stage import lobe_prims, name_of, numbers, open_rig, readable, rig_data


@dataclass(frozen=True)
class Reading:
    """What a stage holds.

    Attributes:
        tracks: Its lobes.
        changes: What other programs changed in its lights, one line each: `<prim>: <what>`.
        unread: What the stage says of its lights that lobes cannot hold, likewise.
        unmuted: The lobes with the light of those that are invisible in every frame, as if they
            were seen.
        muted: Indices of those lobes.
    """

    tracks: LobeTracks
    changes: tuple[str, ...]
    unread: tuple[str, ...]
    unmuted: LobeTracks
    muted: frozenset[int]


def read_usd(path: str | Path | Usd.Stage, rig: str | None = None) -> LobeTracks:
    """Read the tracks of a stage that asglight wrote, or of a shot that uses one.

    Frames are all whole time codes from startTimeCode to endTimeCode, or those that the rig lists
    (times.py). Lobes come back with +Y up and in Rec.709, whatever the stage has, under the names
    of their prims. Where another program has edited a light of the variant that the stage shows,
    its lobe is the one that would shine so; `read_stage` says what was changed.

    Examples:
        >>> report = asglight.write_usd(tracks, "shot.usda")
        >>> asglight.read_usd("shot.usda").frames
        (1001, 1002)

    Args:
        path: The stage; one that is open is read as it is, with its muted layers, loaded payloads
            and variants.
        rig: Path of the prim that holds the lobes, of a stage with several.

    Returns:
        Tracks with float32 lobes on the CPU.

    Raises:
        InputError: There is no such stage, it holds no lobes, or a value is damaged.
    """
    return read_stage(path, rig).tracks


@one_thread()  # arrays are small: threads wait for each other longer than they work
def read_stage(path: str | Path | Usd.Stage, rig: str | None = None) -> Reading:
    """Read the tracks of a stage, as `read_usd`, and what other programs changed in its lights.

    Raises:
        InputError: As `read_usd`.
    """
    stage, prim = open_rig(path, rig)
    # What another program has made infinite is refused in the end, and not warned of on the way.
    with readable(path), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _reading(name_of(path), stage, prim)


def _reading(path: str, stage: Usd.Stage, rig: Usd.Prim) -> Reading:
    prims = lobe_prims(rig)
    data = rig_data(rig)
    version = data.get("version")
    if not isinstance(version, int) or version > schema.FORMAT_VERSION:
        _fail(path, f"layout version {version}", f"a number up to {schema.FORMAT_VERSION}")
    fps = stage.GetTimeCodesPerSecond()
    if not (math.isfinite(fps) and fps > 0):
        _fail(path, f"{fps:g} time codes a second", "a rate above 0")
    times = frame_numbers(stage, rig, prims)
    space = known_space(path, rig)
    distance = card_distance_of(rig)
    lobes = lobes_at(path, prims, times)
    placement = placement_of(rig, times)
    lobes, changes = with_light_edits(
        rig, prims, lobes, times, distance, placement, space.colorspace
    )
    hidden, invisible = hidden_lobes(prims, times)
    changes += invisible
    names = tuple(prim.GetName() for prim in prims)
    _check_finite(path, lobes, names, times)
    lobes = in_colorspace(lobes, space.colorspace, ocio.REC709)
    shown = {prim.GetName(): prim.GetDisplayName() for prim in prims if prim.GetDisplayName()}
    muted = hidden.all(dim=0)  # [N]
    partly = darkened(lobes, hidden & ~muted)
    unmuted = LobeTracks(times, fps, partly, _metadata(path, data), names, shown)
    tracks = replace(unmuted, lobes=darkened(lobes, hidden))
    indices = frozenset(torch.nonzero(muted)[:, 0].tolist())
    return Reading(tracks, tuple(changes), tuple(unread_of(rig, placement)), unmuted, indices)


def darkened(lobes: Lobes, dark: torch.Tensor) -> Lobes:
    """Return lobes black where they are dark.  [F, N]."""
    return replace(lobes, amplitude=lobes.amplitude.masked_fill(dark[..., None], 0.0))


def _check_finite(path: str, lobes: Lobes, names: tuple[str, ...], times: tuple[int, ...]) -> None:
    """Refuse lights that another program has made infinite.  [F, N, .]."""
    values = torch.cat([lobes.axes.flatten(-2), lobes.sharpness, lobes.amplitude], dim=-1)
    bad = torch.nonzero(~torch.isfinite(values).all(dim=-1))
    if len(bad):
        frame, lobe = bad[0].tolist()
        _fail(path, f"the light of {names[lobe]} is not finite at frame {times[frame]}", "numbers")


def known_space(path: str, rig: Usd.Prim) -> Space:
    """Return the space that a rig was written in.

    Raises:
        InputError: Nobody knows its colours.
    """
    space = space_of(rig)
    if space.colorspace not in ocio.NAMES:
        place = f"{rig.GetPath()}.{schema.COLORSPACE}"
        _fail(path, f"{place} is {space.colorspace}", f"one of {', '.join(ocio.NAMES)}")
    return space


def lobes_at(path: str, prims: list[Usd.Prim], times: Sequence[float]) -> Lobes:
    """Return what the attributes of lobes say at some times, in the stage's space.  [T, N, .]."""

    def stacked(name: str, is_good: Callable[[NDArray], Any], expected: str) -> torch.Tensor:
        tracks = [_track(path, prim, name, times, is_good, expected) for prim in prims]
        return torch.from_numpy(np.stack(tracks, axis=1))  # [F, N, K]

    def is_turn(rows: NDArray) -> Any:
        # a unit quaternion may lose length between samples, never half of it
        return np.linalg.norm(rows, axis=-1) > 0.5

    turns = stacked(schema.ORIENT, is_turn, "a unit quaternion")
    sharpness = stacked(schema.SHARPNESS, lambda rows: (rows > 0).all(-1), "numbers above 0")
    amplitude = stacked(schema.AMPLITUDE, lambda rows: (rows >= 0).all(-1), "numbers from 0 up")
    return Lobes(
        axes=frames.axes_from_quaternion(turns).float(),
        sharpness=sharpness.float(),
        amplitude=amplitude.float(),
        form=_form(path, prims),
    )


def slants_at(path: str, prims: list[Usd.Prim], times: Sequence[float]) -> torch.Tensor:
    """Return what the attributes of keys say of their slants at some times.  [T, K, 7]."""

    def of(prim: Usd.Prim, name: str) -> NDArray[np.float64]:
        if not prim.GetAttribute(name):
            return np.zeros((len(times), 3 if name == schema.TURN else 2))
        return _track(path, prim, name, times, lambda rows: np.abs(rows).max(-1) < 100, "numbers")

    rows = [np.concatenate([of(prim, name) for name in schema.SLANT_TRACKS], -1) for prim in prims]
    return torch.from_numpy(np.stack(rows, axis=1)).float()


def _track(
    path: str,
    prim: Usd.Prim,
    name: str,
    times: Sequence[float],
    is_good: Callable[[NDArray], Any],
    expected: str,
) -> NDArray[np.float64]:
    """Read one attribute at every frame and check it.  [F, K]."""
    attribute = prim.GetAttribute(name)
    place = f"{prim.GetPath()}.{name}"
    kind: Sdf.ValueTypeName = schema.VALUE_TYPES[name]
    if not attribute or attribute.GetTypeName() != kind:
        found = f"of type {attribute.GetTypeName()}" if attribute else "missing"
        _fail(path, f"{place} is {found}", f"type {kind}")
    query = Usd.AttributeQuery(attribute)
    varies = query.ValueMightBeTimeVarying()
    values = [query.Get(time) for time in (times if varies else times[:1])]
    if None in values:
        _fail(path, f"{place} has no value at frame {times[values.index(None)]}", expected)
    rows = numbers(values, kind)
    good = np.isfinite(rows).all(-1) & is_good(rows)
    if not good.all():
        first = int(np.flatnonzero(~good)[0])
        _fail(path, f"{place} is {values[first]} at frame {times[first]}", expected)
    return rows if varies else np.repeat(rows, len(times), axis=0)


def _form(path: str, prims: list[Usd.Prim]) -> Form:
    names = {prim.GetAttribute(schema.FORM).Get() for prim in prims}
    if len(names) != 1 or not names <= set(Form):
        found = ", ".join(sorted(map(str, names)))
        _fail(path, f"{schema.FORM} is {found}", f"one of {', '.join(Form)} for all lobes")
    return Form(names.pop())


def _metadata(path: str, data: dict[str, Any]) -> dict[str, Any]:
    try:
        metadata = json.loads(data.get("metadata", "{}"))
    except (TypeError, ValueError):
        metadata = None
    if not isinstance(metadata, dict):
        _fail(path, "the metadata of the rig is damaged", "a JSON object")
    return metadata


def _fail(path: str, found: str, expected: str) -> NoReturn:
    raise InputError(
        f"{path}: {found}; expected {expected}. "
        "Was the stage written by asglight, and not edited since?"
    )
