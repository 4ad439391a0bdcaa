# SPDX-License-Identifier: Apache-2.0
"""A fit of radiance in memory: what `fit_sequence` does of files."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import torch

from asglight.arrays.radiance import Frame, all_prepared, device_of, frames_of
from asglight.errors import check_whole
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import Following
from asglight.images.options import LOST_MAX, ReadOptions
from asglight.lobes import Form, LobeTracks
from asglight.shots.conditioning import with_condition
from asglight.shots.events import OnProgress, Started, ignore
from asglight.shots.frames import frame_done
from asglight.shots.job import form_named, preset_named
from asglight.shots.kept.records import FrameRecord, repeated_by
from asglight.shots.refining import refined_by
from asglight.shots.settings import check_fps, check_options
from asglight.shots.tracks import tracks_of

SOURCE = "array"
"""What the metadata say the tracks were fitted to."""


def fit(
    radiance: Any,
    *,
    lobes: int | None = None,
    preset: str = Preset.FAST,
    form: str = Form.ASG,
    seed: int = 0,
    first_frame: int = 1,
    fps: float = 24.0,
    repair: float = LOST_MAX,
    on_progress: OnProgress = ignore,
) -> LobeTracks:
    """Fit lobes to latlong radiance in memory.

    What is no light is repaired, and large maps are averaged down, as of files; arrays are not
    changed. Lobes are computed where the array is: a tensor on a GPU is fitted there.

    Examples:
        >>> sky = np.full((8, 16, 3), 0.1, np.float32)
        >>> sky[2, 11] = 50.0  # a lamp
        >>> asglight.fit(sky, lobes=2, first_frame=1001).frames
        (1001,)

    Args:
        radiance: Linear Rec.709, row 0 = +Y, numpy or torch: [H, 2 H, 3] of one frame, or
            [F, H, 2 H, 3] of F frames that follow each other.
        lobes: Number of lobes, at most (None: 15); those that are not needed are left out.
        preset: How the fit is made: `live`, `fast`, `best` or `paper`.
        form: Lobe function: `asg`, `bingham`, `sg` or `flat`; `auto` lets `fast` and `best` choose
            for one frame.
        seed: Of the presets that draw random numbers.
        first_frame: Number of the first frame; the others follow.
        fps: Frames per second.
        repair: Share of a frame's light or texels that may be lost to values that are no light.
        on_progress: Called with each event of `asglight.shots.events`.

    Returns:
        Tracks of F frames, with float32 lobes on the CPU.

    Raises:
        InputError: The array or a setting cannot be used.
    """
    device = device_of(radiance)
    options = FitOptions(lobes, preset_named(preset), form_named(form), seed, device)
    check_options(options)
    check_fps(fps)
    check_whole("first frame", first_frame)
    ReadOptions(repair=repair).check()
    # numbers of numpy become Python's, for metadata are JSON
    options = replace(options, lobes=None if lobes is None else int(lobes), seed=int(seed))
    first_frame, fps, repair = int(first_frame), float(fps), float(repair)
    count = len(frames_of(radiance))
    options = options.settled(count)
    frames = all_prepared(radiance, repair, first_frame)
    records = _fitted(frames, count, options, first_frame, on_progress)
    tracks = tracks_of(records, {"source": SOURCE, "repair": repair}, options, fps)
    return with_condition(tracks)


def _fitted(
    frames: Iterator[Frame],
    count: int,
    options: FitOptions,
    first_frame: int,
    on_progress: OnProgress,
) -> list[FrameRecord]:
    """Fit the frames one after the other, then each once more between its neighbours."""
    on_progress(Started(count, 0))
    records: list[FrameRecord] = []
    images: list[torch.Tensor] = []
    following = Following(options)
    for number, frame in enumerate(frames, first_frame):
        is_new = following.take(frame.radiance)
        found = following.last
        assert found is not None
        if is_new:
            images.append(frame.radiance)
        record = FrameRecord(
            frame=number,
            lobes=found.lobes.to("cpu", torch.float32),
            loss=float(found.loss),
            flux_error=float(found.flux_error),
            repair=frame.repair,
            stamp=(0, 0),
            seconds=0.0,
            repeats=None if is_new else repeated_by(records[-1]),
        )
        records.append(record)
        on_progress(frame_done(records, 0, count))
    return refined_by(records, lambda: iter(images), options, on_progress)
