# SPDX-License-Identifier: Apache-2.0
"""What `fit.py` measured, as Markdown."""

from collections.abc import Iterable, Sequence
from typing import Any

from asglight.fitting.options import Preset
from asglight.fitting.paper import fit as paper
from asglight.judging.following import JUMP_DEG, JUMP_SHARE
from benchmarks.fits import figures as fit_figures
from benchmarks.fits import following as fit_following
from benchmarks.fits import measures as fit_measures

DIGITS = {"env": 3, "irr": 4, "irrMax": 4, "r0.5": 4, "r0.25": 3, "flux": 5}
"""Decimals of each metric: three figures of what a good fit leaves."""

GOALS = {
    "loss": "the loss that the paper ends with, {level:.4f}",
    "near": "within 1 % of that loss",
    "irr": "the irr that the paper ends with, {level:.3f}",
}
"""The races of `fit_measures.races` that are printed, of `fast`; fit.json has all, `best` too."""

MISS = "✗"


def tables(result: dict[str, Any]) -> str:
    """Return all results as Markdown."""
    at = result["machine"]
    parts = [
        f"{result['lobes']} lobes; {at['processor']}, {at['cores']} cores, torch {at['torch']}, "
        f"steps {at['steps']}; "
        f"threads: {at['threads']}, of presets one a start; load "
        f"of the machine before the run {at['load']}."
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
    return f"{markdown(['map', *DIGITS, 'wall s', 'CPU s'], rows)}\n\n{note}"


def _marked(cell: str, is_missed: bool) -> str:
    return f"{cell} {MISS}" if is_missed else cell


def curves_table(curves: dict[str, Any]) -> str:
    """Return the seconds that `fast` and the paper's recipe take to the same error."""
    preset = Preset.FAST.value
    rows = []
    for name, curve in curves.items():
        for key, goal in GOALS.items():
            race = curve["races"][preset][key]
            rows.append(
                [
                    name,
                    preset,
                    goal.format(level=race["level"]),
                    _seconds(race["paper_seconds"]),
                    _seconds(race["seconds"]),
                    fit_figures.times(race["times_faster"]),
                ]
            )
    steps = sorted({curve["paper_steps"] for curve in curves.values()})
    header = ["map", "preset", "down to", "paper", "preset takes", "times faster"]
    return f"{markdown(header, rows)}\n\n{paper_note(steps[0])}"


def paper_note(steps: int) -> str:
    """Say how long the paper's recipe ran."""
    full = paper.FIRST_FRAME_STEPS
    if steps < full:
        return f"The paper's recipe was cut short: {steps:,} of its {full:,} steps."
    return f"The paper's recipe ran all its {steps:,} steps."


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return "never"
    if seconds < 600:
        return f"{seconds:.2f} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"


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
                    *(f"{found['mean'][key]:.{DIGITS[key]}f}" for key in fit_following.AVERAGED),
                    f"{found['flicker']:.4f}",
                    f"{found['flicker_first']:.4f}",
                    f"{found['jumps']}",
                    f"{account['reading_seconds_per_frame']:.3f}",
                ]
            )
    first, following = next(iter(sequences.values()))["paper_steps"]
    header = ["sequence", "method", "first frame s", "next frames s", "worst of them"]
    peers = {account["peer_frames"] for account in sequences.values()}
    header += [
        *fit_following.AVERAGED,
        "flicker",
        f"of the first {max(peers)}",
        "jumps",
        "reading s",
    ]
    note = (
        f"Errors are means over every {fit_following.AVERAGED_EVERY}th frame. A jump: a lobe with "
        f"over {JUMP_SHARE:.0%} of the flux turns by more than "
        f"{JUMP_DEG:g} degrees between neighbouring frames. `independent` fits each "
        "frame from nothing (fast); its lobes are matched to the frame before. `paper` takes "
        f"{first:,} steps of its recipe for the first frame and {following:,} for each next one. "
        "Reading is not in the seconds of the fits."
    )
    return f"{markdown(header, rows)}\n\n{note}"


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table, its first column on the left."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
