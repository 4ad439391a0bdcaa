# SPDX-License-Identifier: Apache-2.0
"""`asglight info` of images: what is read of each file, and what is assumed."""

import argparse
from pathlib import Path
from typing import Any

from asglight.cli.options.reading import read_options
from asglight.cli.printing import counted, frame_range, print_json
from asglight.cli.sources.opening import stage_of
from asglight.errors import InputError
from asglight.images.account import image_words, read_as, warning_lines
from asglight.images.message import shown


def is_images(source: str) -> bool:
    """Tell whether an input of `info` is images: whatever is no stage and no folder of one."""
    return stage_of(Path(source)) is None


def run(arguments: argparse.Namespace) -> int:
    """Read the header of every frame and print what is read and assumed."""
    document = document_of(arguments)
    if arguments.json:
        print_json(document)
    else:
        print("\n".join(lines_of(document)))
    return 0


def document_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what is read of the frames of an input, as JSON values.

    Raises:
        InputError: Nothing is there, or its first frame cannot be read.
    """
    from asglight.images import open_sequence
    from asglight.images.decoding.decoders import APART
    from asglight.images.latlong_image import read_header
    from asglight.images.likeness import check_same

    sequence = open_sequence(
        arguments.stage,
        frames=arguments.frames,
        missing="hold",
        reading=read_options(arguments),
    )
    first, model = sequence.first, sequence.model
    rows: list[dict[str, Any]] = []
    for frame in sequence.frames:
        if frame in sequence.missing_frames:
            continue
        path, fault, header = sequence.source.files[frame], None, model
        try:
            header = read_header(path, sequence.named, APART)
            check_same(header, frame, model, first)
        except InputError as error:
            fault = str(error)
        rows.append({"frame": frame, "multiplier": list(header.multiplier), "fault": fault})
    return {
        "images": sequence.pattern,
        "frames": list(sequence.frames),
        "missing_frames": list(sequence.missing_frames),
        "width": model.width,
        "height": model.height,
        "format": model.kind,
        **read_as(model),
        "differing_exposures": len({tuple(row["multiplier"]) for row in rows}) > 1,
        "faults": [row["fault"] for row in rows if row["fault"]],
    }


def lines_of(document: dict[str, Any]) -> list[str]:
    """Return that as lines."""
    frames = document["frames"]
    missing = document["missing_frames"]
    lines = [
        f"{shown(document['images'])}: {counted(len(frames), 'frame')} ({frame_range(frames)}), "
        f"{document['width']} x {document['height']}, {document['format']}",
        f"read: {image_words(document)}",
        *(f"note: {note}" for note in document["notes"]),
        *warning_lines(document),
    ]
    if document["differing_exposures"]:
        lines.append("exposure: differs from frame to frame, and is divided out of each")
    if missing:
        lines.append(f"missing: {counted(len(missing), 'frame')} ({frame_range(missing)})")
    return [*lines, *(f"fault: {fault}" for fault in document["faults"])]
