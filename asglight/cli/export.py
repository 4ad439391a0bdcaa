# SPDX-License-Identifier: Apache-2.0
"""`asglight export`: a stage's lobes for real-time engines, as JSON or as a GLSL include."""

import argparse
from dataclasses import replace
from pathlib import Path

from asglight.cli.frames import chosen_frames
from asglight.cli.printing import counted, frame_range, size
from asglight.errors import InputError
from asglight.lobes import LobeTracks

EXAMPLE = "asglight export shot.usda --to glsl --frame 1001 -o environment.glsl"

_OTHER_FILES = (".usd", ".usda", ".usdc", ".usdz", ".exr", ".hdr", ".f32")
"""Suffixes of what is surely meant to be kept: stages, images, blocks of frames."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `export`."""
    add = parser.add_argument
    add("stage", metavar="STAGE", help="a stage that asglight has written")
    formats = "json: lobe tracks as data; glsl: functions that shade with the lobes, as an include"
    add("--to", required=True, choices=("json", "glsl"), help=formats)
    add("-o", "--output", required=True, type=Path, metavar="FILE", help="file to write")
    frames = (
        "frames, such as 1001 or 1001-1048 (default: all); glsl of one frame has the lobes as "
        "constants, of several as a uniform block that FILE with the suffix .f32 fills"
    )
    add("--frames", "--frame", metavar="RANGE", help=frames)


def run(arguments: argparse.Namespace) -> int:
    """Read a stage, write what was asked for and say what it is."""
    output: Path = arguments.output
    _check_output(output)
    from asglight.export import write_glsl, write_json
    from asglight.images.message import shown
    from asglight.usd import read_usd
    from asglight.usd.stage import lobe_names_of

    every = read_usd(arguments.stage)
    tracks = _of_frames(every, chosen_frames(every, arguments.frames, arguments.stage))
    if arguments.to == "json":
        write_json(output, tracks, lobe_names_of(arguments.stage))
        files = [output]
    else:
        files = write_glsl(output, tracks)
    numbers = tracks.frames
    print(
        f"{', '.join(shown(file) for file in files)}: "
        f"{counted(tracks.lobes.count, 'lobe')} of form {tracks.lobes.form}, "
        f"{counted(len(numbers), 'frame')} ({frame_range(numbers)}) at {tracks.fps:g} fps, "
        f"{size(sum(file.stat().st_size for file in files))}"
    )
    return 0


def _of_frames(tracks: LobeTracks, frames: tuple[int, ...]) -> LobeTracks:
    places = [tracks.frames.index(frame) for frame in frames]
    return replace(tracks, frames=frames, lobes=tracks.lobes[places])


def _check_output(output: Path) -> None:
    """Refuse a target that cannot be meant."""
    if output.suffix.lower() in _OTHER_FILES:
        raise InputError(
            f"{output}: has the suffix of another kind of file; expected a name such as shot.json "
            "or environment.glsl."
        )
    if output.is_dir():
        raise InputError(f"{output}: is a folder; expected a file to write.")
