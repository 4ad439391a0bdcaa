# SPDX-License-Identifier: Apache-2.0
"""Measure the fits: how good beside EM, how fast beside the paper, how steady over time.

All methods are measured side by side in one process. Into the output folder go every number
(fit.json) and pictures (accuracy.png, curves.png, following.png); Markdown tables go to standard
output, progress to standard error. Maps finer than 256 x 512 are averaged down to it.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from asglight.cli.folders import made_folder, write_json
from asglight.cli.options.parser import Parser, one_line
from asglight.cli.progress import reporter
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.fitting.paper import fit as paper
from asglight.images import open_sequence
from asglight.images import sequence as image_sequence
from asglight.images.message import listing, shown
from asglight.judging.machine import machine
from benchmarks.fits import figures as fit_figures
from benchmarks.fits import following as fit_following
from benchmarks.fits import leaving_out as fit_leaving_out
from benchmarks.fits import machine as fit_machine
from benchmarks.fits import measures as fit_measures
from benchmarks.fits import tables as fit_tables
from benchmarks.given import positive

EXAMPLE = """example:
  python -m benchmarks.fits --maps ../shared/hdri --sequences ../shared/sequences -o bench-fit/
"""

IMAGE_SUFFIXES = (".exr", ".hdr")
CURVE_MAP = "lobby"
SEQUENCE_PART = 10
"""The paper's recipe takes one of so many of its steps on a sequence, or it would take hours."""

QUICK_MAPS, QUICK_PAPER_STEPS, QUICK_FRAMES = 2, 300, 6
THREADS_HELP = "threads (2): of the steps of EM and of the paper; of presets one for each start"


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write and print; return the exit status."""
    options = _parser().parse_args(argv)
    try:
        run(options)
    except InputError as error:
        print(f"bench-fit: {one_line(str(error))}", file=sys.stderr)
        return 2
    return 0


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.fits", description=__doc__, epilog=EXAMPLE)
    add = parser.add_argument
    add("--maps", type=Path, required=True, metavar="DIR", help="folder of latlong maps")
    add("--sequences", type=Path, required=True, metavar="DIR", help="folder of sequence folders")
    add("-o", "--output", type=Path, default=Path("bench-fit"), metavar="DIR", help="(bench-fit)")
    add("--lobes", type=positive, default=15, metavar="N", help="lobes (15)")
    add("--threads", type=positive, default=2, metavar="N", help=THREADS_HELP)
    add(
        "--curve-maps",
        metavar="NAME,...",
        help=f"maps whose error is drawn against time ({CURVE_MAP}, or else the first map)",
    )
    add(
        "--paper-steps",
        type=positive,
        default=paper.FIRST_FRAME_STEPS,
        metavar="N",
        help=f"Adam steps of the paper's recipe ({paper.FIRST_FRAME_STEPS}: half an hour a map)",
    )
    add("--frames", type=positive, metavar="N", help="the first N frames of each sequence (all)")
    add(
        "--peer-frames",
        type=positive,
        metavar="N",
        help="of those, the first N are also fitted from nothing and by the paper's recipe (all)",
    )
    add(
        "--tolerance",
        type=_tolerance,
        metavar="ERROR",
        help="measure nothing but the fewest lobes with which irr and r0.5 stay at or below this",
    )
    add(
        "--quick",
        action="store_true",
        help=f"at most {QUICK_MAPS} maps, {QUICK_PAPER_STEPS} steps of the paper, "
        f"{QUICK_FRAMES} frames: shows that all works, not how well",
    )
    return parser


def _tolerance(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0 < number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; expected a number above 0 and below 1")
    return number


def run(options: argparse.Namespace) -> None:
    """Measure the three parts, writing after each what is there, and print the tables.

    Raises:
        InputError: Something to read is missing, or the output cannot be written.
    """
    maps = find_maps(options.maps)
    drawn = curve_maps(maps, options.curve_maps)
    sequences = find_sequences(options.sequences)
    paper_steps, frames = options.paper_steps, options.frames
    if options.quick:
        maps = maps[:QUICK_MAPS]
        paper_steps = min(paper_steps, QUICK_PAPER_STEPS)
        frames = min(frames or QUICK_FRAMES, QUICK_FRAMES)
    made_folder(options.output)
    torch.set_num_threads(options.threads)
    result: dict[str, Any] = {
        "machine": machine(),
        "lobes": options.lobes,
        "quick": options.quick,
    }
    fit_machine.warn_where_busy(result["machine"])
    if options.tolerance is not None:
        _leave_out(options, maps, sequences, frames, result)
        return
    with reporter() as report:
        result["accuracy"] = fit_measures.accuracy(maps, options.lobes, report)
        fit_figures.draw_accuracy(options.output / "accuracy.png", result)
        write_json(options.output / "fit.json", result)
        result["following"] = {
            sequence.name: fit_following.following(
                sequence,
                frames,
                options.peer_frames,
                options.lobes,
                math.ceil(paper_steps / SEQUENCE_PART),
                report,
            )
            for sequence in sequences
        }
        fit_figures.draw_following(options.output / "following.png", result)
        write_json(options.output / "fit.json", result)
        result["curves"] = {
            path.stem: fit_measures.curves(path, options.lobes, paper_steps, report)
            for path in drawn
        }
        fit_figures.draw_curves(options.output / "curves.png", result)
        write_json(options.output / "fit.json", result)
    print(fit_tables.tables(result))


def _leave_out(
    options: argparse.Namespace,
    maps: list[Path],
    sequences: list[image_sequence.Sequence],
    frames: int | None,
    result: dict[str, Any],
) -> None:
    """Measure what a tolerance needs, write it and print its table."""
    with reporter() as report:
        found = fit_leaving_out.measured(
            maps, sequences, options.tolerance, frames, options.output, report
        )
    del result["lobes"]  # which the tolerance finds
    result["leaving_out"] = {"tolerance": options.tolerance, "inputs": found}
    write_json(options.output / "fit.json", result)
    print(fit_tables.markdown(fit_leaving_out.HEADER, fit_leaving_out.table_rows(found)))
    print(f"\n{fit_leaving_out.note(options.tolerance)}")


def find_maps(folder: Path) -> list[Path]:
    """Return the images of a folder by name.

    Raises:
        InputError: There is no such folder, or no image in it.
    """
    paths = [path for path in _entries(folder, "maps") if path.suffix.lower() in IMAGE_SUFFIXES]
    if not paths:
        raise InputError(f"{shown(folder)}: has no .exr or .hdr file; expected latlong maps.")
    return paths


def find_sequences(folder: Path) -> list[image_sequence.Sequence]:
    """Open the sequence in each folder of a folder.

    Raises:
        InputError: There is no such folder, or none in it, or one holds no sequence.
    """
    folders = [path for path in _entries(folder, "sequences") if path.is_dir()]
    if not folders:
        raise InputError(f"{shown(folder)}: has no folders; expected one for each sequence.")
    return [open_sequence(path, height=FIT_HEIGHT) for path in folders]


def curve_maps(maps: Sequence[Path], names: str | None) -> list[Path]:
    """Return the maps to draw curves of: those named, or the default one, or the first.

    Raises:
        InputError: A name is none of the maps.
    """
    by_name = {path.stem: path for path in maps}
    if names is None:
        return [by_name.get(CURVE_MAP, maps[0])]
    for name in names.split(","):
        if name not in by_name:
            raise InputError(f"--curve-maps: {shown(name)}; expected some of {listing(by_name)}.")
    return [by_name[name] for name in names.split(",")]


def _entries(folder: Path, option: str) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        raise InputError(
            f"{shown(folder)}: {error.strerror}; expected a folder. Give --{option} another one."
        ) from error


if __name__ == "__main__":
    sys.exit(main())
