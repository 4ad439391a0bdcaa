# SPDX-License-Identifier: Apache-2.0
"""`asglight export`: a stage's lobes for real-time engines, as JSON or as a GLSL include."""

import argparse
from pathlib import Path

from asglight.cli.printing import counted, frame_range, size
from asglight.errors import InputError

EXAMPLE = "asglight export shot.usda --to glsl --frame 1001 -o environment.glsl"

_STAGE_EXTENSIONS = (".usd", ".usda", ".usdc", ".usdz")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `export`."""
    add = parser.add_argument
    add("stage", metavar="STAGE", help="a stage that asglight has written")
    formats = "json: the lobes of all frames; glsl: an include with those of one frame"
    add("--to", required=True, choices=("json", "glsl"), help=formats)
    add("-o", "--output", required=True, type=Path, metavar="FILE", help="file to write")
    add("--frame", type=int, metavar="N", help="frame of --to glsl (default: the first)")


def run(arguments: argparse.Namespace) -> int:
    """Read a stage, write what was asked for and say what it is."""
    output: Path = arguments.output
    _check_output(output)
    if arguments.to == "json" and arguments.frame is not None:
        raise InputError("--frame: given with --to json, which holds all frames. Leave it out.")
    from asglight.export import write_glsl, write_json
    from asglight.images.message import shown
    from asglight.usd import read_usd
    from asglight.usd.stage import lobe_names_of

    tracks = read_usd(arguments.stage)
    numbers = tracks.frames
    if arguments.to == "json":
        write_json(output, tracks, lobe_names_of(arguments.stage))
        span = f"{counted(len(numbers), 'frame')} ({frame_range(numbers)}) at {tracks.fps:g} fps"
    else:
        frame = numbers[0] if arguments.frame is None else arguments.frame
        if frame not in numbers:
            raise InputError(
                f"--frame {frame}: not in {shown(arguments.stage)}; expected one of "
                f"{frame_range(numbers)}."
            )
        write_glsl(output, tracks, frame)
        span = f"frame {frame} of {counted(len(numbers), 'frame')} ({frame_range(numbers)})"
    print(
        f"{shown(output)}: {counted(tracks.lobes.count, 'lobe')} of form {tracks.lobes.form}, "
        f"{span}, {size(output.stat().st_size)}"
    )
    return 0


def _check_output(output: Path) -> None:
    """Refuse a target that cannot be meant."""
    if output.suffix.lower() in _STAGE_EXTENSIONS:
        raise InputError(
            f"{output}: names a stage; expected a name such as shot.json or environment.glsl."
        )
    if output.is_dir():
        raise InputError(f"{output}: is a folder; expected a file to write.")
