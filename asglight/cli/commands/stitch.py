# SPDX-License-Identifier: Apache-2.0
"""`asglight stitch`: one stage from parts of a shot that were fitted on several machines."""

import argparse
import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from asglight.cli.commands.info import part_lines
from asglight.cli.options.key_options import key_lines
from asglight.cli.options.parser import add_follow_option, add_json_option, file_name
from asglight.cli.options.stage_options import OUTPUT, add_stage_options, given_stage_options
from asglight.cli.printing import counted, frame_range, print_json, size
from asglight.errors import InputError
from asglight.images.message import shown
from asglight.shots.kept.checkpoint import alone
from asglight.shots.parts.joining import Joined, join

EXAMPLE = (
    "asglight stitch part.*.usdc -o shot.usdc\n"
    "         asglight stitch part.*.usdc -o shot.usdz --primary-path /World/Lights/Env --up-axis Z"
)

KEYS_LEFT_OUT = (
    "keys: none, for not every part has keys. Cut them with: asglight keys {} --reference IMAGES"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `stitch`."""
    parts = "stages of the parts, in any order, or patterns such as part.*.usdc"
    parser.add_argument("parts", nargs="+", metavar="STAGE", help=parts)
    output = f"{OUTPUT}; none of the parts"
    parser.add_argument(
        "-o", "--output", type=file_name, required=True, metavar="STAGE", help=output
    )
    add_stage_options(parser, kept="as of the first part")
    add_follow_option(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read the parts, write the shot, and say what was written."""
    files = part_files(arguments.parts)
    check_apart(arguments.output, files)
    with alone(arguments.output):
        joined = join(files, arguments.output, given_stage_options(arguments))
    document = as_document(joined, arguments.output)
    if arguments.json:
        print_json(document)
    else:
        print("\n".join(summary_lines(document)))
    return 0


def part_files(words: Sequence[str]) -> list[str]:
    """Return the files that are meant: patterns expanded, which not every shell does.

    Raises:
        InputError: A pattern matches nothing.
    """
    files: dict[str, None] = {}  # a set that keeps the order
    for word in words:
        is_pattern = glob.has_magic(word) and not Path(word).exists()
        found = sorted(glob.glob(word)) if is_pattern else [word]
        if not found:
            raise InputError(
                f"{shown(word)}: no file matches; expected the stages of the parts. "
                "Check the folder and the pattern."
            )
        files |= dict.fromkeys(found)
    return list(files)


def check_apart(output: str, files: Sequence[str], kind: str = "the part ") -> None:
    """Check that writing the shot leaves every part as it is, the images of its dome as well.

    Args:
        output: The stage to write.
        files: Stages that stay.
        kind: What to call those in a message, with a blank after it.

    Raises:
        InputError: The output is a part, or has the dome folder of one.
    """
    for file in files:
        # folders of domes are named after stems: a.usda and a.usdc share theirs
        if _stem(output) == _stem(file):
            raise InputError(
                f"{shown(output)}: would overwrite {kind}{shown(file)} or the images of its "
                "dome; expected a name of its own. Choose another output."
            )


def _stem(path: str) -> str:
    return os.path.splitext(os.path.realpath(path))[0]  # a loop of links is told of later


def as_document(joined: Joined, output: str) -> dict[str, Any]:
    """Return a stitched shot as JSON values."""
    tracks = joined.tracks
    return {
        "output": output,
        "bytes": joined.written.bytes,
        "lobes": tracks.lobes.count,
        "form": str(tracks.lobes.form),
        "fps": tracks.fps,
        "frames": list(tracks.frames),
        "parts": tracks.metadata["parts"],
        **({} if joined.written.keys is None else {"keys": joined.written.keys}),
        "keys_left_out": joined.keys_left_out,
    }


def summary_lines(document: dict[str, Any]) -> list[str]:
    """Return the shot and its parts as the few lines a user reads."""
    frames = document["frames"]
    head = (
        f"{document['output']}: {counted(document['lobes'], 'lobe')}, "
        f"{counted(len(frames), 'frame')} ({frame_range(frames)}) at {document['fps']:g} fps, "
        f"{size(document['bytes'])}, from {counted(len(document['parts']), 'part')}"
    )
    left_out = [KEYS_LEFT_OUT.format(shown(document["output"]))] * document["keys_left_out"]
    return [head, *part_lines(document["parts"]), *key_lines(document.get("keys")), *left_out]
