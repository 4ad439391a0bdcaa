# SPDX-License-Identifier: Apache-2.0
"""`asglight keys`: lamps as lights, and the images without them, for a stage that is there."""

import argparse
from typing import Any

from asglight.cli.options.key_options import (
    AUTO,
    add_key_options,
    key_lines,
    key_options,
)
from asglight.cli.options.parser import (
    add_follow_option,
    add_json_option,
    add_reading_options,
    file_name,
)
from asglight.cli.options.reading import read_options as images_read
from asglight.cli.options.stage_options import OUTPUT, representation_list
from asglight.cli.printing import counted, frame_range, print_json, size
from asglight.cli.progress import reporter
from asglight.cli.repairs import repair_line
from asglight.cli.sources.key_cutting import Cutting, cut_keys
from asglight.errors import InputError
from asglight.usd.options import check_key_options

EXAMPLE = (
    "asglight keys sky.usda --reference sky.####.exr\n"
    "         asglight keys sky.usda --reference sky.####.exr --keys 3 --keys-texture -o keyed.usda"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `keys`."""
    parser.add_argument("stage", metavar="STAGE", help="a stage that asglight has written")
    images = "the images that it was fitted to: file, folder or pattern"
    parser.add_argument("--reference", required=True, metavar="INPUT", help=images)
    target = f"{OUTPUT} (default: STAGE itself)"
    parser.add_argument("-o", "--output", type=file_name, metavar="STAGE", help=target)
    held = "what the stage holds then, such as keys or cards,keys (default: keys, and what it has)"
    parser.add_argument("--representations", type=representation_list, metavar="LIST", help=held)
    add_key_options(parser, usual=AUTO)
    add_reading_options(parser)
    add_follow_option(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Find the keys, write the stage anew and say what they are."""
    from asglight.shots.tracks import repairs_of

    options = key_options(arguments)
    if options is None:
        raise InputError("keys: 0; expected auto or a number above 0.")
    check_key_options(options)
    cutting = Cutting(
        arguments.reference, options, images_read(arguments), arguments.representations
    )
    output = arguments.output or arguments.stage
    with reporter() as report:
        written, stage, repairs = cut_keys(arguments.stage, output, cutting, report)
    found, frames, repaired = written.keys, tuple(repairs), repairs_of(repairs)
    document: dict[str, Any] = {
        "output": output,
        "bytes": written.bytes,
        "representations": list(stage.representations),
        "frames": list(frames),
        "keys": found,
        "repairs": repaired,
    }
    if arguments.json:
        print_json(document)
        return 0
    print(
        f"{output}: {counted(len(frames), 'frame')} ({frame_range(frames)}), "
        f"{size(written.bytes)}, written as: {', '.join(stage.representations)}"
    )
    print("\n".join(filter(None, [*key_lines(found), repair_line(repaired)])))
    return 0
