# SPDX-License-Identifier: Apache-2.0
"""From fitted frames to lobe tracks: continuous frames, what is not needed left out, the account.

The metadata holds nothing that differs between two runs on the same input, so that a resumed run
writes the same bytes as an unbroken one: no time, no host, no absolute path.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from asglight import __version__
from asglight.fitting.options import FitOptions, Preset
from asglight.images import Repair, Sequence
from asglight.images.account import read_as
from asglight.lobes import Lobes, LobeTracks
from asglight.lobes.data import stack
from asglight.lobes.fading import carried_on
from asglight.lobes.identity.naming import by_energy
from asglight.lobes.identity.tracks import as_tracks
from asglight.shots.kept.records import FrameRecord, own_frames, places_of
from asglight.shots.leaving_out import account, simplified
from asglight.shots.settings import options_as_json
from asglight.shots.tolerance import Accuracy, worst


def tracks_from(
    records: list[FrameRecord],
    sequence: Sequence,
    options: FitOptions,
    fps: float,
    accuracy: Accuracy | None = None,
) -> LobeTracks:
    """Return the tracks of a shot, without what it does not need.

    Args:
        records: Every frame, in order.
        sequence: Where they came from.
        options: How they were fitted.
        fps: Frames per second.
        accuracy: Measures the frames, where the shot has a tolerance.
    """
    origin = {
        "source": Path(sequence.pattern).name,
        **sequence.reading.as_json(),
        "image": read_as(sequence.model),
        "missing": sequence.missing,
    }
    return tracks_of(records, origin, options, fps, accuracy)


def tracks_of(
    records: list[FrameRecord],
    origin: Mapping[str, Any],
    options: FitOptions,
    fps: float,
    accuracy: Accuracy | None = None,
) -> LobeTracks:
    """Return the tracks of a shot, as `tracks_from`.

    Args:
        records: Every frame, in order.
        origin: Where they came from, as JSON values.
        options: How they were fitted.
        fps: Frames per second.
        accuracy: Measures the frames, where the shot has a tolerance.
    """
    own = own_frames(records)
    numbers = [record.frame for record in own]
    lobes, budget = stack([record.lobes for record in own]), None  # [F', N, .]
    as_published = options.preset is Preset.PAPER
    lobes = carried_on(lobes) if as_published else as_tracks(lobes)
    fitted, lit = options.lobes_of(lobes.count), lit_lobes(lobes)
    lobes = lobes.select(lit)
    if not as_published:
        lobes, budget = simplified(lobes, numbers, accuracy)
    measured = {} if accuracy is None else _measured(accuracy, numbers, lobes)
    lobes = lobes[torch.tensor(places_of(records))]  # [F, N', .]
    repeated = [record.frame for record in records if record.repeats is not None]
    metadata = {
        "asglight": __version__,
        **origin,
        **options_as_json(options),
        **measured,
        "left_out": account(fitted, int(lit.sum()), lobes, repeated, budget),
        "loss": [_finite(record.loss) for record in records],
        "flux_error": [_finite(record.flux_error) for record in records],
        "repairs": repairs_of({record.frame: record.repair for record in records}),
    }
    frames = tuple(record.frame for record in records)
    return by_energy(LobeTracks(frames, fps, lobes, metadata))


def _measured(accuracy: Accuracy, frames: list[int], lobes: Lobes) -> dict[str, Any]:
    """Return the largest errors and whether they are within the tolerance, as JSON values."""
    largest = worst(frames, accuracy.errors(frames, lobes))
    return {
        "tolerance_met": all(one.value <= accuracy.limit for one in largest),
        "worst_errors": {
            one.name: {"error": _finite(one.value), "frame": one.frame} for one in largest
        },
    }


def lit_lobes(lobes: Lobes) -> torch.Tensor:
    """Tell which lobes are not black in every frame; of a black shot, the first one.  [N].

    A stage without any lobe would be no rig, so a black shot keeps one black light.
    """
    lit = (lobes.amplitude > 0).any(-1).any(0)  # [N]
    if not bool(lit.any()):
        lit[0] = True
    return lit


def repairs_of(repairs: Mapping[int, Repair]) -> dict[str, Any]:
    """Sum the repairs of all frames, by their numbers.

    Returns:
        Numbers of negative, NaN and infinite texels, and the frames concerned: those with such
        texels, and those without a file that others stand in for. The texels of a frame that stands
        in for another count once.
    """
    found = {frame: repair for frame, repair in repairs.items() if not repair.filled_from}
    return {
        "negative_texels": sum(repair.negative for repair in found.values()),
        "nonfinite_texels": sum(repair.nonfinite for repair in found.values()),
        "infinite_texels": sum(repair.infinite for repair in found.values()),
        "frames": [frame for frame, repair in found.items() if repair.texels],
        "frames_filled": [frame for frame, repair in repairs.items() if repair.filled_from],
    }


def _finite(value: float) -> float | None:
    """Return None for what JSON has no number for."""
    return value if math.isfinite(value) else None
