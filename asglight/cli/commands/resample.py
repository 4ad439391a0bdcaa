# SPDX-License-Identifier: Apache-2.0
"""`asglight resample`: the light of a stage at another frame rate, or faster or slower."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from asglight.cli.commands.info import RESAMPLED, resampled_lines
from asglight.cli.commands.stitch import check_apart
from asglight.cli.frames import warn_of_unread
from asglight.cli.options.key_options import key_lines
from asglight.cli.options.parser import (
    add_follow_option,
    add_json_option,
    add_rig_option,
    file_name,
    frame_rate,
)
from asglight.cli.options.stage_options import OUTPUT, add_stage_options, given_stage_options
from asglight.cli.printing import counted, frame_range, print_json, size
from asglight.errors import InputError
from asglight.images.frame_files import frame_set
from asglight.images.message import shown

if TYPE_CHECKING:
    from asglight.lobes import LobeTracks
    from asglight.usd import WriteReport

EXAMPLE = (
    "asglight resample shot.usda -o wall.usda --fps 60\n"
    "         asglight resample shot.usda -o slow.usda --speed 0.5 --frames 1010-1020"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `resample`."""
    add = parser.add_argument
    add("stage", metavar="STAGE", help="a stage that asglight has written")
    output = f"{OUTPUT}; another than STAGE"
    add("-o", "--output", type=file_name, required=True, metavar="STAGE", help=output)
    rate = "new frames per second, such as 60 or 60000/1001 (default: as STAGE)"
    add("--fps", type=frame_rate, help=rate)
    speed = "how fast the light moves: 0.5 takes twice the time (default: %(default)g)"
    add("--speed", type=float, default=1.0, metavar="FACTOR", help=speed)
    frames = "frames of STAGE, such as 1010-1020 (default: all); the first keeps its number"
    add("--frames", metavar="RANGE", help=frames)
    add_stage_options(parser, kept="as STAGE")
    add_rig_option(parser)
    add_follow_option(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read a stage, take its light at other times, write it and say what it is."""
    from asglight.lobes.resampling import resampled, resampled_times
    from asglight.shots.conditioning import with_condition
    from asglight.shots.kept.checkpoint import alone
    from asglight.shots.keyed.sources import resampled_keys
    from asglight.usd import read_stage, write_usd
    from asglight.usd.options import Representation
    from asglight.usd.read.read_options import read_options

    if arguments.fps is None and arguments.speed == 1 and arguments.frames is None:
        raise InputError(
            "resample: nothing to change; expected another rate. Add --fps, --speed or --frames."
        )
    check_apart(arguments.output, [arguments.stage], "")
    reading = read_stage(arguments.stage, arguments.rig)
    old = reading.tracks
    if len(old.frames) == 1:
        raise InputError(
            f"{shown(arguments.stage)}: has one frame, {old.frames[0]}, whose light is the same at "
            "every time; expected two frames or more."
        )
    span = _span(arguments.frames, arguments.stage, old.frames)
    new = resampled(old, arguments.fps, arguments.speed, span)
    new = with_condition(replace(new, metadata=_metadata(arguments, old, span)))
    options = read_options(arguments.stage, arguments.rig)
    options = replace(options, **given_stage_options(arguments))
    keys = None
    if "keys" in old.metadata and Representation.KEYS in options.held:
        times = resampled_times(old, arguments.fps, arguments.speed, span)
        told = old.metadata["keys"]
        keys = resampled_keys(arguments.stage, arguments.rig, new, times, told)
    with alone(arguments.output):
        written = write_usd(new, arguments.output, **vars(options), keys=keys)
    document = as_document(new, written, arguments.output, reading.changes)
    if arguments.json:
        print_json(document)
    else:
        print("\n".join(summary_lines(document)))
    warn_of_unread(arguments.stage, reading)
    return 0


def _span(text: str | None, stage: str, numbers: tuple[int, ...]) -> tuple[int, int]:
    """Return the first and the last frame that were asked for.

    Raises:
        InputError: They are no range, or the stage does not reach so far.
    """
    if text is None:
        return numbers[0], numbers[-1]
    wanted = frame_set(text, "frames")
    first, last = wanted[0], wanted[-1]
    whole = f"{numbers[0]}-{numbers[-1]}"
    if last - first + 1 != len(wanted):
        raise InputError(
            f"frames: {shown(text)} leaves out frames; expected a first and a last one, such as "
            f"{whole}. Which frames are between follows from --fps and --speed."
        )
    if first < numbers[0] or last > numbers[-1]:
        raise InputError(
            f"frames: {shown(text)} reaches beyond {shown(stage)}; expected frames within {whole}. "
            "Change --frames."
        )
    return first, last


def _metadata(
    arguments: argparse.Namespace, old: "LobeTracks", span: tuple[int, int]
) -> dict[str, Any]:
    """Return the metadata of the stage; what is true of its old frames only goes into a row."""
    from asglight.shots.parts.joining import OF_FRAMES

    row = {
        "source": shown(arguments.stage),
        "fps": old.fps,
        "frames": list(span),
        "speed": arguments.speed,
    }
    row |= {name: old.metadata[name] for name in OF_FRAMES if name in old.metadata}
    kept = {name: value for name, value in old.metadata.items() if name not in OF_FRAMES}
    return kept | {RESAMPLED: [*old.metadata.get(RESAMPLED, []), row]}


def as_document(
    tracks: "LobeTracks", written: "WriteReport", output: str, changes: tuple[str, ...]
) -> dict[str, Any]:
    """Return a resampled shot as JSON values."""
    return {
        "output": output,
        "bytes": written.bytes,
        "lobes": tracks.lobes.count,
        "form": str(tracks.lobes.form),
        "fps": tracks.fps,
        "frames": list(tracks.frames),
        "samples_between": written.samples_between,
        "changes": list(changes),
        RESAMPLED: tracks.metadata[RESAMPLED],
        **({} if written.keys is None else {"keys": written.keys}),
    }


def summary_lines(document: Mapping[str, Any]) -> list[str]:
    """Return the shot and where it came from as the few lines a user reads."""
    frames = document["frames"]
    head = (
        f"{shown(document['output'])}: {counted(document['lobes'], 'lobe')} of form "
        f"{document['form']}, {counted(len(frames), 'frame')} ({frame_range(frames)}) at "
        f"{document['fps']:g} fps, {size(document['bytes'])}"
    )
    edited = [f"edited: {change}" for change in document["changes"]]
    resampled = resampled_lines(document[RESAMPLED])
    return [head, *resampled, *key_lines(document.get("keys")), *edited]
