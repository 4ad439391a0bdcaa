# SPDX-License-Identifier: Apache-2.0
"""The stress table as a page of Markdown, and its cells, which the terminal's table has too."""

from collections.abc import Iterable, Sequence

from asglight.judging.stress import run as stress
from asglight.judging.stress.case import FLUX, FOUND, GRADIENT, IRRADIANCE, Group
from asglight.judging.stress.run import Measured, Result, Tools, Verdict

HEADS: tuple[str, ...] = (
    "case",
    "lobes",
    "flux %",
    "irr %",
    "gradient",
    "GLSL",
    "balls",
    "USD",
    "verdict",
)
"""Columns of every table; `what` and the recovery's come between where there is room."""

RECOVERY_HEADS: tuple[str, ...] = ("direction", "sharpness %", "amplitude %")

TITLES = {
    Group.STIFF: "Stiff lobes",
    Group.RADIANCE: "Extreme radiance",
    Group.SHAPE: "Extreme shapes",
    Group.TIME: "Extreme time",
    Group.BROKEN: "Broken input",
    Group.RECOVERY: "Recovery: known lobes found again",
}

EXPLANATION = f"""\
Each case is written as OpenEXR files and goes the whole way of a user's shot: read, repaired,
reduced, fitted (`fast`), judged, written as a stage and read back. A number is the worst over
frames, lobes, directions and channels. What is made of known lobes is checked with the known lobes
too, because no fit makes lobes as stiff as some of them.

| column | what it says | bound |
|---|---|---|
| lobes | lobes that the fit came to, of those it could take | |
| flux % | light of the fit, by the exact integral of its lobes, over that of the map | \
{100 * FLUX.value:g} |
| irr % | error on a white ball (`irr` of `asglight eval`), the map constant within its texels | \
{100 * IRRADIANCE.value:g} |
| gradient | derivative that the fit's steps follow, against central differences in float64: \
directions, shapes and light apart, each over its length | {GRADIENT.value:g} |
| GLSL | radiance of the shaders against the library in float64, around every lobe, over the \
brightest | what float32 allows: 4e-6 to 7e-4, by sharpness |
| balls | matte and glossy ball of the viewer against the closed form in float64, over its \
brightest pixel | {stress.BALLS.value:g} |
| USD | change of any lobe that was written and read back: radians, or relative | \
{stress.STAGE.value:g} |
| direction | angle to the known lobe, in its standard deviations | {FOUND.direction:g} |
| sharpness %, amplitude % | against the known lobe | {100 * FOUND.sharpness:g}, \
{100 * FOUND.amplitude:g} |

Every number of every lobe has to be finite, too, or the case fails. Verdicts: `ok`; `stated`,
beyond a common bound for the reason given under the table; `refused`, in one line, as it has to be;
`FAIL`.
"""


def page(results: Sequence[Result], tools: Tools, command: str) -> str:
    """Return the page."""
    minutes = stress.total(results)["cpu_seconds"] / 60
    parts = [
        "# Stress",
        f"`{command}` (`make stress` writes this page): {summary(results)}, "
        f"{minutes:.1f} minutes of processor time. {opengl(tools)}",
        EXPLANATION.rstrip(),
    ]
    for group in Group:
        own = [result for result in results if result.case.group is group]
        if own:
            parts += [f"## {TITLES[group]}", _table(own, group), *_notes(own)]
    return "\n\n".join(parts) + "\n"


def summary(results: Sequence[Result]) -> str:
    """Return how many cases there are of each verdict."""
    verdicts = [result.verdict for result in results]
    counts = ", ".join(f"{verdicts.count(each)} {each}" for each in Verdict)
    return f"{len(results)} {'case' if len(results) == 1 else 'cases'}: {counts}"


def opengl(tools: Tools) -> str:
    """Say what computed the columns of the shaders, or why nothing did."""
    if tools.shader is None:
        return f"GLSL and balls were not checked: {tools.no_shader}"
    return f"GLSL and balls by {tools.shader.name}."


def cells(result: Result) -> list[str]:
    """Return the cells of `HEADS`."""
    found = result.measured
    if not found:
        return [result.case.name, *[""] * (len(HEADS) - 2), result.verdict.value]
    return [
        result.case.name,
        f"{result.lobes} of {result.case.lobes}",
        _number(found["flux"], percent=True),
        _number(found["irr"], percent=True),
        *(_number(found[name]) for name in ("gradient", "shader", "balls", "stage")),
        result.verdict.value,
    ]


def recovery_cells(result: Result) -> list[str]:
    """Return the cells of `RECOVERY_HEADS`."""
    if not result.measured:
        return [""] * len(RECOVERY_HEADS)
    direction, *others = (result.measured[name] for name in ("direction", "sharpness", "amplitude"))
    return [_number(direction), *(_number(each, percent=True) for each in others)]


def reasons(result: Result) -> list[str]:
    """Return what there is to say of a case: a message, reasons, and what is beyond a bound."""
    if result.message:
        return [result.message]
    found = [
        f"{name} {each.value:.2g}, at most {each.bound:.2g} expected"
        for name, each in result.measured.items()
        if not each.passes and each.value is not None
    ]
    return found + list(
        dict.fromkeys(each.note for each in result.measured.values() if each.is_stated)
    )


def _table(results: Sequence[Result], group: Group) -> str:
    heads = [HEADS[0], "what", *HEADS[1:-1]]
    heads += RECOVERY_HEADS if group is Group.RECOVERY else ()
    rows = [[*heads, HEADS[-1]], ["---"] * (len(heads) + 1)]
    for result in results:
        name, *numbers, verdict = cells(result)
        more = recovery_cells(result) if group is Group.RECOVERY else []
        rows.append([name, result.case.holds, *numbers, *more, verdict])
    return "\n".join(_row(row) for row in rows)


def _row(row: Iterable[str]) -> str:
    return f"| {' | '.join(row)} |"


def _notes(results: Sequence[Result]) -> list[str]:
    """Return the reasons under a table."""
    lines = [f"- {result.case.name}: {text}" for result in results for text in reasons(result)]
    return ["\n".join(lines)] if lines else []


def _number(measured: Measured, *, percent: bool = False) -> str:
    """Return an error in two digits; a dash where there is none to measure."""
    if measured.value is None:
        return "–"
    if not percent:
        return f"{measured.value:.1e}" if measured.value else "0"
    return f"{100 * measured.value:.3f}"
