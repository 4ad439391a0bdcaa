# SPDX-License-Identifier: Apache-2.0
"""Reading lobe tracks back from a stage.

A lobe is orientation, sharpness, amplitude and form. Lights are derived from it; those that were
edited by another program change it (edited_lights.py). A lobe that was deactivated is
gone.
"""

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Sdf, Usd

from asglight.errors import InputError
from asglight.images import ocio
from asglight.images.message import shown
from asglight.lobes import Form, Lobes, LobeTracks, frames
from asglight.usd import schema
from asglight.usd.read.edited_lights import with_light_edits
from asglight.usd.read.read_options import card_distance_of
from asglight.usd.spaces import Space, from_stage, space_of
from asglight.usd.stage import lobe_prims, numbers, open_rig, readable, rig_data

FRAMES_MAX = 1_000_000
"""Eleven hours at 24 frames a second. A range beyond it is damage, and would fill the memory."""


@dataclass(frozen=True)
class Reading:
    """What a stage holds.

    Attributes:
        tracks: Its lobes.
        changes: What other programs changed in its lights, one line each: `<prim>: <what>`.
    """

    tracks: LobeTracks
    changes: tuple[str, ...]


def read_usd(path: str | Path) -> LobeTracks:
    """Read the tracks of a stage that asglight wrote.

    Frames are all integers from startTimeCode to endTimeCode, or those that the rig lists. Lobes
    come back with +Y up and in Rec.709, whatever the stage has, under the names of their prims.
    Where another program has edited a light of the variant that the stage shows, its lobe is the
    one that would shine so; `read_stage` says what was changed.

    Args:
        path: The stage.

    Returns:
        Tracks with float32 lobes on the CPU.

    Raises:
        InputError: There is no such stage, it holds no lobes, or a value is damaged.
    """
    return read_stage(path).tracks


def read_stage(path: str | Path) -> Reading:
    """Read the tracks of a stage, as `read_usd`, and what other programs changed in its lights.

    Raises:
        InputError: As `read_usd`.
    """
    stage, rig = open_rig(path)
    # What another program has made infinite is refused in the end, and not warned of on the way.
    with readable(path), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _reading(path, stage, rig)


def _reading(path: str | Path, stage: Usd.Stage, rig: Usd.Prim) -> Reading:
    prims = lobe_prims(rig)
    data = rig_data(rig)
    version = data.get("version")
    if not isinstance(version, int) or version > schema.FORMAT_VERSION:
        _fail(path, f"layout version {version}", f"a number up to {schema.FORMAT_VERSION}")
    fps = stage.GetTimeCodesPerSecond()
    if not (math.isfinite(fps) and fps > 0):
        _fail(path, f"{fps:g} time codes a second", "a rate above 0")
    times = _frame_numbers(path, stage, data)
    space = _space(path, rig)
    distance = card_distance_of(rig)
    lobes = _lobes(path, prims, times)
    lobes, changes = with_light_edits(rig, prims, lobes, times, distance)
    names = tuple(prim.GetName() for prim in prims)
    _check_finite(path, lobes, names, times)
    tracks = LobeTracks(times, fps, from_stage(lobes, space), _metadata(path, data), names)
    return Reading(tracks, tuple(changes))


def _check_finite(
    path: str | Path, lobes: Lobes, names: tuple[str, ...], times: tuple[int, ...]
) -> None:
    """Refuse lights that another program has made infinite.  [F, N, .]."""
    values = torch.cat([lobes.axes.flatten(-2), lobes.sharpness, lobes.amplitude], dim=-1)
    bad = torch.nonzero(~torch.isfinite(values).all(dim=-1))
    if len(bad):
        frame, lobe = bad[0].tolist()
        _fail(path, f"the light of {names[lobe]} is not finite at frame {times[frame]}", "numbers")


def _space(path: str | Path, rig: Usd.Prim) -> Space:
    space = space_of(rig)
    if space.colorspace not in ocio.NAMES:
        place = f"{rig.GetPath()}.{schema.COLORSPACE}"
        _fail(path, f"{place} is {space.colorspace}", f"one of {', '.join(ocio.NAMES)}")
    return space


def _lobes(path: str | Path, prims: list[Usd.Prim], times: tuple[int, ...]) -> Lobes:
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


def _track(
    path: str | Path,
    prim: Usd.Prim,
    name: str,
    times: tuple[int, ...],
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


def _form(path: str | Path, prims: list[Usd.Prim]) -> Form:
    names = {prim.GetAttribute(schema.FORM).Get() for prim in prims}
    if len(names) != 1 or not names <= set(Form):
        found = ", ".join(sorted(map(str, names)))
        _fail(path, f"{schema.FORM} is {found}", f"one of {', '.join(Form)} for all lobes")
    return Form(names.pop())


def _frame_numbers(path: str | Path, stage: Usd.Stage, data: dict[str, Any]) -> tuple[int, ...]:
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    whole = all(math.isfinite(code) and code == int(code) for code in (start, end))
    if not stage.HasAuthoredTimeCodeRange() or not whole or not 0 <= end - start < FRAMES_MAX:
        _fail(path, f"frame range {start:g} to {end:g}", "whole frame numbers in order")
    listed = data.get("frames")
    if listed is None:
        return tuple(range(int(start), int(end) + 1))
    chosen = tuple(int(frame) for frame in listed if start <= frame <= end)
    if not chosen or any(after <= before for before, after in itertools.pairwise(chosen)):
        _fail(path, f"{len(listed)} listed frames", f"ascending ones in {start:g} to {end:g}")
    return chosen


def _metadata(path: str | Path, data: dict[str, Any]) -> dict[str, Any]:
    try:
        metadata = json.loads(data.get("metadata", "{}"))
    except (TypeError, ValueError):
        metadata = None
    if not isinstance(metadata, dict):
        _fail(path, "the metadata of the rig is damaged", "a JSON object")
    return metadata


def _fail(path: str | Path, found: str, expected: str) -> NoReturn:
    raise InputError(
        f"{shown(path)}: {found}; expected {expected}. "
        "Was the stage written by asglight, and not edited since?"
    )
