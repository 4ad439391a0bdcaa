# SPDX-License-Identifier: Apache-2.0
"""The frames of a shot: which whole time codes its lobes are read at.

They are those from the stage's start to its end time code. A layer that states none, as one that
only sublayers a rig, has those of the rig, which are where the layer offsets of sublayers,
references and payloads put them; so are the frames that a rig lists where it lacks some.
"""

import math
from collections.abc import Iterable
from typing import Any

from pxr import Sdf, Usd

from asglight.lobes.data import FRAMES_MAX
from asglight.usd import schema
from asglight.usd.stage import UnexpectedError, rig_data

WHOLE = 1e-6
"""How far from a whole number a time code may be: offsets are float64, of frames up to 1e6."""


def frame_numbers(stage: Usd.Stage, rig: Usd.Prim, lobes: Iterable[Usd.Prim]) -> tuple[int, ...]:
    """Return the frames of a rig in its stage, ascending.

    Raises:
        UnexpectedError: There are none that can be read, or too many.
    """
    samples = _samples(lobes)
    layer, offset = _written_in(rig)
    start = _end(stage, layer, offset, "startTimeCode", min(samples, default=1.0))
    end = _end(stage, layer, offset, "endTimeCode", max(samples, default=start))
    whole = "startTimeCode at or before endTimeCode, and a whole number from one to the other"
    if not (math.isfinite(start) and math.isfinite(end)) or not 0 <= end - start < FRAMES_MAX:
        raise UnexpectedError(f"frame range {start:g} to {end:g}", whole)
    first, last = math.ceil(start - WHOLE), math.floor(end + WHOLE)
    if last < first:
        raise UnexpectedError(f"frame range {start:g} to {end:g}", whole)
    listed = _listed(rig, offset, samples)
    if listed is None:
        return tuple(range(first, last + 1))
    chosen = tuple(frame for frame in listed if first <= frame <= last)
    # A shot may lie between two frames of a rig, and a rig that stands still be shown anywhere.
    return chosen or tuple(range(first, last + 1))


def _listed(rig: Usd.Prim, offset: Sdf.LayerOffset, samples: set[float]) -> list[int] | None:
    """Return the frames that a rig lists, or None where it lists none that hold in this stage.

    A list that its samples contradict is of another time: flattening moves the samples and not it.
    Lobes that move have samples at its first and its last frame; others may lie between frames.
    """
    listed = rig_data(rig).get("frames")
    if listed is None:
        return None
    try:
        frames = sorted({float(offset * float(frame)) for frame in listed})
        rounded = [round(frame) for frame in frames]
    except (TypeError, ValueError, OverflowError) as error:
        raise UnexpectedError("damaged frames in the rig's custom data", "numbers") from error
    are_whole = all(abs(frame - near) < WHOLE for frame, near in zip(frames, rounded, strict=True))
    ends = sorted({round(sample) for sample in samples} or set(rounded))
    are_met = (ends[0], ends[-1]) == (rounded[0], rounded[-1]) if rounded else False
    return rounded if are_whole and are_met else None


def _end(
    stage: Usd.Stage, layer: Sdf.Layer, offset: Sdf.LayerOffset, key: str, otherwise: float
) -> float:
    """Return one end of the range: the stage's, else the rig's own, else another."""
    if stage.HasAuthoredMetadata(key):
        return float(stage.GetMetadata(key))
    own: Any = layer.pseudoRoot
    return float(offset * float(own.GetInfo(key))) if own.HasInfo(key) else otherwise


def are_frames(rig: Usd.Prim, times: Iterable[float]) -> list[bool]:
    """Tell which times of a stage are frames of a rig, however the stage retimes it.

    The other times lie between: samples there say how a program is to interpolate.
    """
    back = _written_in(rig)[1].GetInverse()
    listed = rig_data(rig).get("frames")
    own = [float(back * float(time)) for time in times]
    whole = [abs(time - round(time)) < WHOLE for time in own]
    if listed is None:
        return whole
    chosen = {int(frame) for frame in listed}
    return [good and round(time) in chosen for good, time in zip(whole, own, strict=True)]


def _samples(lobes: Iterable[Usd.Prim]) -> set[float]:
    """Return the time codes that lobes have samples at."""
    found: set[float] = set()
    for prim in lobes:
        for name in schema.LOBE_TRACKS:
            found.update(prim.GetAttribute(name).GetTimeSamples())
    return found


def _written_in(rig: Usd.Prim) -> tuple[Sdf.Layer, Sdf.LayerOffset]:
    """Return the weakest layer that marks a rig, which wrote it, and how the stage retimes it."""
    stage = rig.GetStage()
    found = stage.GetRootLayer(), Sdf.LayerOffset()
    for spec, offset in rig.GetPrimStackWithLayerOffsets():
        if schema.CUSTOM_DATA in spec.customData:
            found = spec.layer, offset
    return found
