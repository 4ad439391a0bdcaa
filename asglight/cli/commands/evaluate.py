# SPDX-License-Identifier: Apache-2.0
"""`asglight eval`: the error of a stage against the images it was fitted to."""

import argparse
import itertools
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import torch
from torch import Tensor

from asglight.cli import between, limits
from asglight.cli.frames import chosen_frames, warn_of_unread
from asglight.cli.options.parser import (
    add_follow_option,
    add_input_options,
    add_json_option,
    add_rig_option,
)
from asglight.cli.options.reading import read_options
from asglight.cli.printing import print_json, table
from asglight.cli.progress import Reporter, reporter
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import Sequence, open_sequence
from asglight.images.frame_files import ranges
from asglight.images.message import shown
from asglight.judging.metrics import (
    FLICKER,
    METRIC_NAMES,
    FrameErrors,
    SequenceErrors,
    frames_errors,
    sequence_errors,
)
from asglight.judging.motion.between import METRICS, STAGE
from asglight.lobes import LobeTracks
from asglight.lobes.texels import texel_means
from asglight.threads import one_thread

EXAMPLE = """asglight eval sky.usda --reference sky.####.exr
between frames: asglight eval sky.usda --reference sky.####.exr --between
on a farm:      asglight eval sky.usda --reference sky.####.exr --limit irr=0.01"""

EXPLANATION = """\
env: radiance error over the sphere; flux: error of the total; irr: of the irradiance (irrMax: its
worst direction); r0.5, r0.25: of what balls of that roughness reflect; flicker: of the change from
frame to frame. All relative to the reference; 0 is perfect. What is judged is what the stage opens
with: keys and rest where it does so with these, else the lobes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `eval`."""
    parser.description = f"{parser.description}\n\n{EXPLANATION}\n\n{between.EXPLANATION}"
    parser.description += f"\n\n{limits.EXPLANATION}"
    parser.add_argument("stage", metavar="STAGE", help="a stage that asglight has written")
    parser.add_argument(
        "--reference", required=True, metavar="INPUT", help="image file, folder or pattern"
    )
    half = "judge the light between frames, by leaving out every second one"
    parser.add_argument("--between", action="store_true", help=half)
    add_input_options(parser)
    add_rig_option(parser)
    add_follow_option(parser)
    limits.add_limit_option(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Judge each frame and print the errors."""
    names = METRICS if arguments.between else (*METRIC_NAMES, FLICKER)
    limits.check_limits(arguments.limits, names)
    if arguments.between:
        return _run_between(arguments)
    from asglight.judging.shown_keys import shown_keys, shown_map
    from asglight.usd import read_stage

    reading = read_stage(arguments.stage, arguments.rig)
    keys = shown_keys(arguments.stage, arguments.rig)
    frames = chosen_frames(reading.tracks, arguments.frames, arguments.stage)
    sequence = reference_for(frames, arguments)
    made = map_of_lobes(reading.tracks) if keys is None else partial(shown_map, keys)
    what = "lobes" if keys is None else "keys and rest"
    with reporter() as report:
        errors = judge(made, sequence, frames, report)
    if arguments.json:
        about = {"stage": arguments.stage, "reference": arguments.reference, "judged": what}
        print_json(about | as_json(errors))
    else:
        print(errors_table(errors))
        print(f"judged: {what}, which the stage opens with" if keys else f"judged: {what}")
    warn_of_unread(arguments.stage, reading)
    return _held(arguments, errors.mean)


def _run_between(arguments: argparse.Namespace) -> int:
    with reporter() as report:
        found = between.document_of(arguments, report)
    if arguments.json:
        print_json({"stage": arguments.stage, "reference": arguments.reference} | found)
    else:
        print(between.between_table(found))
    return _held(arguments, found["mean"][STAGE])


def _held(arguments: argparse.Namespace, mean: Mapping[str, float]) -> int:
    """Say which errors are above their limits; return the exit status."""
    above = limits.above(mean, arguments.limits)
    for line in above:
        print(f"{shown(arguments.stage)}: {line}", file=sys.stderr)
    return limits.EXCEEDED if above else 0


def reference_for(frames: tuple[int, ...], arguments: argparse.Namespace) -> Sequence:
    """Open the reference of a stage's frames.

    Raises:
        InputError: The reference lacks a frame; the truth is never made up.
    """
    sequence = open_sequence(
        arguments.reference,
        missing="hold",
        height=FIT_HEIGHT,
        reading=read_options(arguments),
    )
    check_frames(sequence, frames, arguments.reference, arguments.stage)
    return sequence


def check_frames(
    sequence: Sequence,
    frames: tuple[int, ...],
    reference: str,
    stage: str,
    remedy: str = "Choose frames with --frames.",
) -> None:
    """Refuse a reference that lacks a frame of a stage; the truth is never made up.

    Args:
        sequence: The reference.
        frames: Of the stage.
        reference: What the reference is called.
        stage: What the stage is called.
        remedy: What can be done.

    Raises:
        InputError: A frame is not there, or out of the reference's range.
    """
    absent = [frame for frame in frames if frame not in sequence.source.files]
    if absent:
        raise InputError(
            f"{shown(reference)}: lacks {ranges(absent)} of {shown(stage)}; "
            f"expected an image for each frame ({ranges(frames)}). Is it the sequence that was "
            f"fitted? {remedy}"
        )
    if not set(frames) <= set(sequence.frames):
        raise InputError(
            f"{shown(reference)}: its range is {ranges(sequence.frames)}; expected "
            f"{ranges(frames)}. Leave the range out. {remedy}"
        )


AT_ONCE = 8
"""Frames judged together: the kernels are computed once for them. A frame of 256 rows takes 0.87 s
alone, 0.15 s with seven others, 0.12 s with 15; the maps of eight are 25 MB."""

ShownMap = Callable[[int, int, int], Tensor]
"""From a frame number, rows and columns to the mean radiance over each texel.  [H, W, 3]."""


def map_of_lobes(tracks: LobeTracks) -> ShownMap:
    """Return what makes maps of the lobes."""
    return lambda frame, *shape: texel_means(tracks.at(frame).to(torch.float32), *shape)


def judge(
    shown_map: ShownMap, sequence: Sequence, frames: tuple[int, ...], report: Reporter
) -> SequenceErrors:
    """Judge what some frames show against their images."""
    return sequence_errors(
        _judged(shown_map, sequence, report.follow(frames, "judging", len(frames)))
    )


def _judged(
    shown_map: ShownMap, sequence: Sequence, frames: Iterator[int]
) -> Iterator[tuple[int, FrameErrors]]:
    """Judge frames, `AT_ONCE` together."""
    while some := list(itertools.islice(frames, AT_ONCE)):
        images = [sequence.read(frame).radiance for frame in some]
        shapes = [image.shape[:2] for image in images]
        with one_thread():
            maps = [shown_map(frame, *shape) for frame, shape in zip(some, shapes, strict=True)]
        yield from zip(some, frames_errors(maps, images), strict=True)


def as_json(errors: SequenceErrors) -> dict[str, Any]:
    """Return errors as JSON values."""
    return {
        "mean": errors.mean,
        "worst": errors.worst,
        "frames": [{"frame": frame} | values for frame, values in errors.frames.items()],
    }


def errors_table(errors: SequenceErrors) -> str:
    """Return errors as a table: each frame, the mean, and the worst frame of each metric."""
    header = ["frame", *METRIC_NAMES]
    rows = [
        [str(frame), *(f"{values[name]:.4f}" for name in METRIC_NAMES)]
        for frame, values in errors.frames.items()
    ]
    rows.append(["mean", *(f"{errors.mean[name]:.4f}" for name in METRIC_NAMES)])
    rows.append(["worst frame", *(str(errors.worst[name]) for name in METRIC_NAMES)])
    text = table(header, rows)
    if FLICKER in errors.mean:
        return f"{text}\nflicker {errors.mean[FLICKER]:.4f}"
    return text
