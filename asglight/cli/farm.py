# SPDX-License-Identifier: Apache-2.0
"""`asglight fit --scheduler`: several shots, cut into parts, on a Dask cluster."""

import argparse
from pathlib import Path
from typing import Any

from asglight.cli.options.reading import read_options
from asglight.cli.options.stage_options import given_stage_options
from asglight.cli.printing import counted, frame_range, print_json
from asglight.cli.progress import reporter
from asglight.cli.sources.key_cutting import Cutting, cut_keys
from asglight.errors import InputError
from asglight.fitting.options import FitOptions
from asglight.images import open_sequence
from asglight.images.message import shown
from asglight.images.output import check_names_file
from asglight.shots.parts.chunks import CHUNK, OVERLAP, Shot
from asglight.shots.parts.joining import part_rows
from asglight.usd.options import KeyOptions, StageOptions, check_key_options, without_keys

EXAMPLE = (
    "asglight fit day.####.exr tunnel.####.exr -o stages/ --scheduler tcp://farm:8786 --resume"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a farm to those of `fit`."""
    where = "fit on a Dask cluster: tcp://HOST:PORT, or local:4 for 4 processes here"
    parser.add_argument("--scheduler", metavar="ADDRESS", help=where)
    length = f"with --scheduler: frames of a part (default: {CHUNK}), which overlap by {OVERLAP}"
    parser.add_argument("--chunk", type=int, metavar="FRAMES", help=length)


def one_input(arguments: argparse.Namespace) -> str:
    """Return the input of a fit that needs no farm.

    Raises:
        InputError: There are several, or an option of a farm.
    """
    if arguments.chunk is not None:
        raise InputError(
            f"chunk: {arguments.chunk} without a scheduler; expected both or neither. "
            "Add --scheduler local."
        )
    if len(arguments.input) > 1:
        raise InputError(
            f"input: {len(arguments.input)} sequences; expected one, or several with a scheduler. "
            "Add --scheduler local."
        )
    return arguments.input[0]


def run(arguments: argparse.Namespace, options: FitOptions, keys: KeyOptions | None) -> int:
    """Fit every input on the cluster, cut keys here, and say what was written."""
    from asglight.shots.parts.farm import fit_on_farm

    if keys is not None:
        check_key_options(keys)
    shots = shots_from(arguments, options)
    with reporter() as report:
        stages = fit_on_farm(
            shots,
            arguments.scheduler,
            chunk=CHUNK if arguments.chunk is None else arguments.chunk,
            resume=arguments.resume,
            on_progress=report,
        )
        for stage, shot in zip(stages, shots, strict=True):
            if keys is not None:
                names = given_stage_options(arguments).get("representations")
                cutting = Cutting(shot.source, keys, shot.reading, names, shot.missing)
                cut_keys(stage, stage, cutting, report)
    documents = [as_document(stage) for stage in stages]
    if arguments.json:
        print_json({"shots": documents})
    else:
        print("\n".join(map(summary_line, documents)))
    return 0


def shots_from(arguments: argparse.Namespace, options: FitOptions) -> list[Shot]:
    """Return the shots: one to a stage, or several to stages in a folder, named by their images.

    Raises:
        InputError: An input cannot be found, two would write one stage, or an option has no effect.
    """
    if options.preroll is not None:
        raise InputError(
            f"preroll: {options.preroll} with a scheduler, which gives each part its own; expected "
            "one of the two. Leave out --preroll."
        )
    output, names = Path(arguments.output).absolute(), {}
    into_folder = len(arguments.input) > 1 or output.is_dir()
    if not into_folder:
        check_names_file(arguments.output)
    if into_folder and not output.is_dir():
        raise InputError(
            f"{shown(arguments.output)}: is no folder; expected one to write "
            f"{counted(len(arguments.input), 'stage')} into. Make it first."
        )
    shots = []
    for source in arguments.input:
        stage = output
        if into_folder:
            name = open_sequence(source, missing="hold").name
            if name in names:
                raise InputError(
                    f"{shown(source)}: would write {name}.usdc as {shown(names[name])} does; "
                    "expected inputs of different names. Fit them one by one."
                )
            names[name] = source
            stage = output / f"{name}.usdc"
        shots.append(
            Shot(
                str(Path(source).absolute()),
                str(stage),
                options,
                arguments.frames,
                arguments.fps,
                arguments.missing,
                read_options(arguments),
                without_keys(StageOptions(**given_stage_options(arguments))),
                names_from_of(arguments, stage),
            )
        )
    return shots


def names_from_of(arguments: argparse.Namespace, stage: Path) -> str | None:
    """Return the stage whose lights keep their names: one that was given, or that is written over.

    One that is merely in the way may be anything, and gives no names.
    """
    from asglight.usd import read_usd

    if arguments.names_from is not None:
        return str(Path(arguments.names_from).absolute())
    try:
        read_usd(stage)
    except InputError:
        return None
    return str(stage)


def as_document(stage: str) -> dict[str, Any]:
    """Return a finished shot as JSON values."""
    from asglight.usd import read_usd

    tracks = read_usd(stage)
    return {
        "output": stage,
        "lobes": tracks.lobes.count,
        "form": str(tracks.lobes.form),
        "fps": tracks.fps,
        "frames": list(tracks.frames),
        "parts": part_rows(tracks, stage),
    }


def summary_line(document: dict[str, Any]) -> str:
    """Return a finished shot as one line."""
    frames = document["frames"]
    return (
        f"{document['output']}: {counted(document['lobes'], 'lobe')}, "
        f"{counted(len(frames), 'frame')} ({frame_range(frames)}) at {document['fps']:g} fps, "
        f"from {counted(len(document['parts']), 'part')}"
    )
