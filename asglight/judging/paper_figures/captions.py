# SPDX-License-Identifier: Apache-2.0
"""Captions of the paper's figures: what was run, the numbers, and what they say beside the paper.

Every sentence is made from the numbers, so that it holds for any input. Of the paper they repeat
only what it does (its loss, its weights, 15 lobes) and shows; it prints no error.
"""

import textwrap
from collections.abc import Sequence

from asglight.fitting.options import LOBES
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper.losses import Loss
from asglight.judging.metrics import METRIC_NAMES
from asglight.judging.paper_figures.data import (
    OURS,
    PAPER,
    ROUGHNESS,
    Plan,
    Row,
    Still,
    by_label,
)
from asglight.judging.paper_figures.over_time import INDEPENDENT, NEXT_SHARE, WITH, WITHOUT, Stacked
from asglight.judging.paper_figures.sheet import mean_error, percent, spread

BALLS = [f"ball {roughness:g}" for roughness in ROUGHNESS]
HEADS = ["CPU s", *METRIC_NAMES, *BALLS]

COLUMNS = 120
"""Of the text; tables are as wide as they are."""

JUDGED = (
    "Errors are relative, in percent, of the map as it is: `env` the map, `flux` all light, `irr` "
    "and `irrMax` a white ball (mean and largest), `r0.5` and `r0.25` glossy balls "
    "(`asglight/judging/metrics.py`)"
)
SEEN = "; `ball` is what the picture shows: sum of absolute differences over sum of the reference."


def recipe(plan: Plan) -> str:
    """Return what of the paper's recipe was run."""
    steps, published = f"{plan.steps:,}", f"{paper.FIRST_FRAME_STEPS:,}"
    part = "all" if plan.steps == paper.FIRST_FRAME_STEPS else f"{steps} of"
    its = f"its {published} Adam steps"
    texels = f"{plan.rows} x {2 * plan.rows} texels"
    published_texels = "" if plan.rows == paper.HEIGHT else f" (published: {paper.HEIGHT} rows)"
    return f"{part} {its} on {texels}{published_texels}"


def lobes_caption(still: Still, plan: Plan) -> str:
    """Return the caption of the sweep, without heading and picture."""
    rows = [
        [row.fit.label, "fast" if row.fit.method == OURS else "paper", *_cells([row])]
        for row in still.rows
    ]
    run = (
        f"`fast` on the map as it is, and the paper's recipe with {recipe(plan)}, each from one "
        f"start. {JUDGED}{SEEN}"
    )
    return _caption(run, ["lobes", "fit", *HEADS], rows, _sweep_finding(still.rows))


def _sweep_finding(rows: Sequence[Row]) -> str:
    ours = {row.fit.lobes.count: row for row in rows if row.fit.method == OURS}
    finding = f"The paper shows such a sweep, prints no number, and takes {LOBES} lobes."
    more = [count for count in ours if count > LOBES]
    if LOBES in ours and more:
        usual, finer = ours[LOBES].errors, ours[min(more)].errors
        falls = ", ".join(
            f"{name} by {usual[name] / finer[name]:.2g}"
            for name in ("env", "irr", "r0.5", "r0.25")
            if finer[name] > 0
        )
        finding += (
            f" From {LOBES} to {min(more)} lobes the errors of `fast` are divided: {falls}. As "
            f"long as they fall, {LOBES} is how many lights one wants, not where accuracy ends."
        )
    ahead: dict[str, list[str]] = {}
    for row in rows:
        if row.fit.method == PAPER:
            errors = ours[row.fit.lobes.count].errors
            names = [name for name in METRIC_NAMES if row.errors[name] < errors[name]]
            if names:
                ahead[row.fit.label] = names
    where = "; ".join(f"{count} in {', '.join(names)}" for count, names in ahead.items())
    return f"{finding} The paper's recipe is ahead of `fast`, by lobes: {where or 'nowhere here'}."


def losses_caption(still: Still, plan: Plan) -> str:
    """Return the caption of the ablation, without heading and picture."""
    groups = dict(by_label(still.rows, PAPER))
    table = []
    for label, group in [*groups.items(), *by_label(still.rows, OURS)]:
        cells = _cells(group)
        if len(group) > 1:
            for place, name in enumerate(METRIC_NAMES, start=1):  # after the seconds
                cells[place] += f" ({spread(group, name)})"
        table.append([label, *cells])
    starts = "one start" if plan.seeds == 1 else f"the same {plan.seeds} starts"
    means = (
        ""
        if plan.seeds == 1
        else " (means; in brackets least and largest; picture and balls are of the first start)"
    )
    run = (
        f"The paper's recipe with each of six losses, {recipe(plan)}, {plan.lobes} lobes, from "
        f"{starts}{means}; below them `fast`, which is not part of the ablation. {JUDGED}{SEEN} "
        "How each loss is read: `asglight/fitting/paper/losses.py`."
    )
    return _caption(run, ["loss", *HEADS], table, _ablation_finding(groups))


def _ablation_finding(groups: dict[str, list[Row]]) -> str:
    published = Loss.L1_LD.value
    best: dict[str, list[str]] = {}
    ranks = []
    for name in METRIC_NAMES:
        errors = {label: mean_error(group, name) for label, group in groups.items()}
        best.setdefault(min(errors, key=errors.__getitem__), []).append(name)
        rank = 1 + sum(error < errors[published] for error in errors.values())
        ranks.append(f"{name} {rank}")
    listed = "; ".join(f"{label} in {', '.join(names)}" for label, names in best.items())
    verdict = (
        "These numbers agree with its choice."
        if list(best) == [published]
        else "Where another loss is named, these numbers differ from its choice."
    )
    return (
        f"The paper takes {published}. Best of the six here: {listed}. Place of {published}: "
        f"{', '.join(ranks)}. {verdict}"
    )


def forms_caption(still: Still) -> str:
    """Return the caption of the forms, without heading and picture."""
    table = [
        [row.fit.label, str(row.fit.lobes.count), str(row.fit.floats), *_cells([row])]
        for row in still.rows
    ]
    few, many, ours, antipodal = still.rows
    run = f"`fast` with each lobe function. {JUDGED}{SEEN} Isotropic lobes take 6 floats, others 8."
    finding = (
        "The paper's lobes are anisotropic; its formula, read with squared products, is antipodal: "
        f"`bingham` here. Ahead of `asg`: isotropic lobes in {_ahead(many, ours)} with as many "
        f"floats, in {_ahead(few, ours)} with as many lobes; `bingham` in "
        f"{_ahead(antipodal, ours)}."
    )
    return _caption(run, ["form", "lobes", "floats", *HEADS], table, finding)


def _ahead(row: Row, other: Row) -> str:
    names = [name for name in METRIC_NAMES if row.errors[name] < other.errors[name]]
    return ", ".join(names) if names else "nothing"


def time_caption(found: Stacked, plan: Plan) -> str:
    """Return the caption of the stacked row, without heading and picture."""
    names = [*METRIC_NAMES, "flicker"]
    table = [
        [
            way.name if way.name == OURS else f"paper, {way.name}",
            f"{way.seconds:.2f}",
            *(percent(way.mean[name]) for name in names),
            str(way.jumps),
        ]
        for way in found.ways
    ]
    next_steps = max(plan.steps // NEXT_SHARE, 1)
    run = (
        f"Row {found.index} of the map, at {found.latitude_deg:+.0f} degrees, of "
        f"{len(found.frames)} frames: above the row; below what a ball of roughness 0.25 shows "
        "along it, how its luminance changes from frame to frame, less how it does under the map, "
        "over the mean. The paper's recipe: "
        f"{recipe(plan)} for the first frame, {next_steps:,} of {paper.NEXT_FRAME_STEPS:,} for "
        f"each next one, gamma {paper.GAMMA:g}; frames by themselves take {plan.steps:,} each, "
        f"from one start. {JUDGED}, means over the frames; `flicker` is that of r0.25. A jump is a "
        "lit lobe that turns by more than 10 degrees between two frames."
    )
    return _caption(run, ["fit", "CPU s a frame", *names, "jumps"], table, _time_finding(found))


def _time_finding(found: Stacked) -> str:
    ways = {way.name: way.mean for way in found.ways}
    held, free, alone = ways[WITH], ways[WITHOUT], ways[INDEPENDENT]
    changes = ", ".join(
        f"{name} from {percent(free[name])} to {percent(held[name])} %"
        for name in ("flicker", "irr", "r0.5", "r0.25")
    )
    return (
        "The paper shows a row with and without L_T and prints no number. Here L_T takes the "
        f"recipe's {changes}. Frames by themselves: flicker {percent(alone['flicker'])} %, r0.25 "
        f"{percent(alone['r0.25'])} %. How strong L_T is depends on the units of the other terms, "
        "which the poster leaves open (here they are relative to the map's flux)."
    )


def _caption(run: str, heads: Sequence[str], rows: Sequence[Sequence[str]], finding: str) -> str:
    filled = [textwrap.fill(text, COLUMNS, break_on_hyphens=False) for text in (run, finding)]
    return "\n\n".join([filled[0], markdown_table(heads, rows), filled[1]])


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows as Markdown: the first column to the left, the others to the right."""
    lines = [f"| {' | '.join(heads)} |", f"|---|{'--:|' * (len(heads) - 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _cells(group: Sequence[Row]) -> list[str]:
    """Return seconds, mean errors, and the errors of the first one's balls where it has some."""
    balls = [percent(error) for error in group[0].ball_errors] or [""] * len(BALLS)
    seconds = sum(row.fit.seconds for row in group) / len(group)
    return [f"{seconds:.1f}", *(percent(mean_error(group, name)) for name in METRIC_NAMES), *balls]
