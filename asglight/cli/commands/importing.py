# SPDX-License-Identifier: Apache-2.0
"""`asglight import`: a stage of the spherical Gaussians that other programs keep as an array."""

import argparse
from dataclasses import replace

from asglight import __version__
from asglight.cli.options.parser import add_json_option, file_name, frame_rate
from asglight.cli.options.stage_options import OUTPUT, add_stage_options, given_stage_options
from asglight.cli.printing import counted, frame_range, print_json, size
from asglight.export import SgLayout

EXAMPLE = "asglight import lights.npy --from physg -o lights.usda"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `import`."""
    add = parser.add_argument
    add("array", metavar="ARRAY", help="a .npy file of shape [N, 7], or [F, N, 7] of F frames")
    layout = "the program whose array it is: the order of its numbers and its axes"
    add("--from", dest="layout", required=True, choices=[*map(str, SgLayout)], help=layout)
    add("-o", "--output", type=file_name, required=True, metavar="STAGE", help=OUTPUT)
    first = "number of the first frame; the others follow (default: 1)"
    add("--first-frame", type=int, default=1, metavar="FRAME", help=first)
    add("--fps", type=frame_rate, default=24.0, help="frames per second (default: 24)")
    add_stage_options(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read an array, write the stage and say what it is."""
    from asglight.export import read_sg_array
    from asglight.images.message import shown
    from asglight.shots.kept.checkpoint import alone
    from asglight.usd import write_usd

    layout = SgLayout(arguments.layout)
    read = read_sg_array(
        arguments.array, layout, first_frame=arguments.first_frame, fps=arguments.fps
    )
    source = {"asglight": __version__, "source": shown(arguments.array), "layout": str(layout)}
    tracks = replace(read, metadata=source)
    with alone(arguments.output):
        written = write_usd(tracks, arguments.output, **given_stage_options(arguments))
    if arguments.json:
        print_json(
            {
                "output": arguments.output,
                "bytes": written.bytes,
                "lobes": tracks.lobes.count,
                "form": str(tracks.lobes.form),
                "fps": tracks.fps,
                "frames": list(tracks.frames),
            }
        )
    else:
        print(
            f"{shown(arguments.output)}: {counted(tracks.lobes.count, 'lobe')} of form "
            f"{tracks.lobes.form}, {counted(len(tracks.frames), 'frame')} "
            f"({frame_range(tracks.frames)}) at {tracks.fps:g} fps, {size(written.bytes)}"
        )
    return 0
