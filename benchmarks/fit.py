# SPDX-License-Identifier: Apache-2.0
"""Measure the fits: how good beside EM, how fast beside the paper, how steady over time.

All methods are measured side by side in one process. Into the output folder go every number
(fit.json) and pictures (accuracy.png, curves.png, following.png); Markdown tables go to standard
output, progress to standard error. Maps finer than 256 x 512 are averaged down to it.
"""

import argparse
import contextlib
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import fit_figures
import fit_leaving_out
import fit_machine
import fit_measures
import torch

from asglight.cli.parser import Parser, one_line
from asglight.cli.printing import duration
from asglight.cli.progress import reporter
from asglight.errors import InputError
from asglight.fitting import paper
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import open_sequence
from asglight.images import sequence as image_sequence
from asglight.images.message import listing, shown

EXAMPLE = """example:
  python benchmarks/fit.py --maps ../shared/hdri --sequences ../shared/sequences -o bench-fit/
"""

IMAGE_SUFFIXES = (".exr", ".hdr")
CURVE_MAP = "lobby"
QUICK_MAPS, QUICK_PAPER_STEPS, QUICK_FRAMES = 2, 300, 6
DIGITS = {"env": 3, "irr": 4, "irrMax": 4, "r0.5": 4, "r0.25": 3, "flux": 5}
"""Decimals of each metric: three figures of what a good fit leaves."""

THREADS_HELP = "threads of EM, of the paper's recipe and of judging (2); presets compute on one"

GOALS = {
    "loss": "the paper's last loss",
    "irr": "the paper's last irr",
    "r0.25": "the paper's last r0.25",
    "near": "the paper's last loss and 1 %",
    "back": "the last loss of {preset}",
}
"""The races of `fit_measures.races`."""

MISS = "✗"


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
    parser = Parser(prog="fit.py", description=__doc__, epilog=EXAMPLE)
    add = parser.add_argument
    add("--maps", type=Path, required=True, metavar="DIR", help="folder of latlong maps")
    add("--sequences", type=Path, required=True, metavar="DIR", help="folder of sequence folders")
    add("-o", "--output", type=Path, default=Path("bench-fit"), metavar="DIR", help="(bench-fit)")
    add("--lobes", type=_positive, default=15, metavar="N", help="lobes (15)")
    add("--threads", type=_positive, default=2, metavar="N", help=THREADS_HELP)
    add(
        "--curve-maps",
        metavar="NAME,...",
        help=f"maps whose error is drawn against time ({CURVE_MAP}, or else the first map)",
    )
    add(
        "--paper-steps",
        type=_positive,
        default=paper.FIRST_FRAME_STEPS,
        metavar="N",
        help=f"Adam steps of the paper's recipe ({paper.FIRST_FRAME_STEPS}: half an hour a map)",
    )
    add("--frames", type=_positive, metavar="N", help="the first N frames of each sequence (all)")
    add(
        "--independent-frames",
        type=_positive,
        metavar="N",
        help="of those, the first N are also fitted from nothing (all)",
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


def _positive(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; expected a whole number from 1 on")
    return number


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
    with _writing(options.output):
        options.output.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(options.threads)
    result: dict[str, Any] = {
        "machine": fit_machine.machine(),
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
        _write_json(options.output / "fit.json", result)
        result["following"] = {
            sequence.name: fit_measures.following(
                sequence, frames, options.independent_frames, options.lobes, report
            )
            for sequence in sequences
        }
        fit_figures.draw_following(options.output / "following.png", result)
        _write_json(options.output / "fit.json", result)
        result["curves"] = {
            path.stem: fit_measures.curves(path, options.lobes, paper_steps, report)
            for path in drawn
        }
        fit_figures.draw_curves(options.output / "curves.png", result)
        _write_json(options.output / "fit.json", result)
    print(tables(result))


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
    _write_json(options.output / "fit.json", result)
    print(_markdown(fit_leaving_out.HEADER, fit_leaving_out.table_rows(found)))
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


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn what the disk refuses into the user's error."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{shown(path)}: {error.strerror}; expected a folder that can be written."
        ) from error


def _write_json(path: Path, result: dict[str, Any]) -> None:
    beside = path.with_suffix(".json.part")
    with _writing(path):
        beside.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n")
        beside.replace(path)


def tables(result: dict[str, Any]) -> str:
    """Return all results as Markdown."""
    at = result["machine"]
    parts = [
        f"{result['lobes']} lobes; {at['processor']}, {at['cores']} cores, torch {at['torch']}; "
        f"threads: presets 1, EM and the paper's recipe {at['threads']}; load of the machine "
        f"before the run {at['load']}."
    ]
    if result["quick"]:
        parts.append("A quick run: it shows that all works, not how well.")
    maps = result["accuracy"]["maps"]
    for preset, account in result["accuracy"]["presets"].items():
        parts += [f"### Accuracy: {preset} / EM", accuracy_table(maps, preset, account)]
    parts += ["### Time to the same error", curves_table(result["curves"])]
    parts += ["### Following", following_table(result["following"])]
    return "\n\n".join(parts)


def accuracy_table(
    maps: dict[str, dict[str, dict[str, float]]], preset: str, account: dict[str, Any]
) -> str:
    """Return errors of a preset beside those of EM, their ratios, and marks on missed targets."""
    every, middle = account["targets"]["every"], account["targets"]["median"]
    rows = []
    for name, methods in maps.items():
        ours, peer, ratios = methods[preset], methods["em"], account["ratios"][name]
        cells = []
        for key, digits in DIGITS.items():
            cell = f"{ours[key]:.{digits}f} / {peer[key]:.{digits}f}"
            cell += f" ({ratios[key]:.2f})" if key in ratios else ""
            cells.append(_marked(cell, key in account["missed"][name]))
        for key in ("wall_seconds", "cpu_seconds"):
            cells.append(f"{ours[key]:.1f} / {peer[key]:.1f}")
        rows.append([name, *cells])
    summary = {
        "median ratio": [
            _marked(f"{account['median'][key]:.2f}", key in account["missed_median"])
            for key in account["median"]
        ],
        "target of the median": [
            f"{middle[key]:.2f}" if key in middle else "" for key in account["median"]
        ],
        "worst ratio": [f"{ratio:.2f}" for ratio in account["worst"].values()],
        "target of every map": [f"{every[key]:.2f}" for key in account["worst"]],
    }
    flux = {"target of every map": f"{every['flux']}"}
    rows += [[name, *cells, flux.get(name, ""), "", ""] for name, cells in summary.items()]
    note = (
        f"Each cell: {preset} / EM (ratio). {MISS} misses its target; where irr is "
        f"{fit_measures.IRR_ENOUGH} or less, irr and irrMax are enough whatever EM reaches."
    )
    return f"{_markdown(['map', *DIGITS, 'wall s', 'CPU s'], rows)}\n\n{note}"


def _marked(cell: str, is_missed: bool) -> str:
    return f"{cell} {MISS}" if is_missed else cell


def curves_table(curves: dict[str, Any]) -> str:
    """Return the seconds that presets and the paper's recipe take to the same error."""
    rows = []
    for name, curve in curves.items():
        for preset, races in curve["races"].items():
            for key, race in races.items():
                goal = GOALS[key].format(preset=preset)
                rows.append(
                    [
                        name,
                        preset,
                        f"{goal}, {race['level']:.4f}",
                        _seconds(race["paper_seconds"]),
                        _seconds(race["seconds"]),
                        fit_figures.times(race["times_faster"]),
                    ]
                )
    steps = sorted({curve["paper_steps"] for curve in curves.values()})
    header = ["map", "preset", "down to", "paper", "preset takes", "times faster"]
    return f"{_markdown(header, rows)}\n\n{paper_note(steps[0])}"


def paper_note(steps: int) -> str:
    """Say how long the paper's recipe ran."""
    full = paper.FIRST_FRAME_STEPS
    if steps < full:
        return f"The paper's recipe was cut short: {steps:,} of its {full:,} steps."
    return f"The paper's recipe ran all its {steps:,} steps."


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return "never"
    return f"{seconds:.2f} s" if seconds < 10 else duration(seconds)


def following_table(sequences: dict[str, Any]) -> str:
    """Return seconds, errors, flicker and jumps of each sequence and method."""
    rows = []
    for name, account in sequences.items():
        for method, found in account["methods"].items():
            first, *rest = found["wall_seconds"]
            rest = rest or [first]
            rows.append(
                [
                    f"{name}, {len(found['wall_seconds'])} frames",
                    method,
                    f"{first:.2f}",
                    f"{sum(rest) / len(rest):.3f}",
                    f"{max(rest):.3f}",
                    *(f"{found['mean'][key]:.{DIGITS[key]}f}" for key in fit_measures.AVERAGED),
                    f"{found['flicker']:.4f}",
                    f"{found['jumps']}",
                    f"{account['reading_seconds_per_frame']:.3f}",
                ]
            )
    header = ["sequence", "method", "first frame s", "next frames s", "worst of them"]
    header += [*fit_measures.AVERAGED, "flicker", "jumps", "reading s"]
    note = (
        f"Errors are means over every {fit_measures.AVERAGED_EVERY}th frame. A jump: a lobe with "
        f"over {fit_measures.JUMP_SHARE:.0%} of the flux turns by more than "
        f"{fit_measures.JUMP_DEG:g} degrees between neighbouring frames. `independent` fits each "
        "frame from nothing (fast); its lobes are matched to the frame before. Reading is not in "
        "the seconds of the fits."
    )
    return f"{_markdown(header, rows)}\n\n{note}"


def _markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


if __name__ == "__main__":
    sys.exit(main())
