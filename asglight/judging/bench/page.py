# SPDX-License-Identifier: Apache-2.0
"""The bench's results as one page of HTML that needs nothing else: no network, no script."""

from collections.abc import Mapping, Sequence
from html import escape
from string import Template
from typing import Any

from asglight.fitting.paper import fit as paper
from asglight.judging.bench.looks import LOOKS, PEER
from asglight.judging.bench.plan import PEERS
from asglight.judging.compare.methods import METHODS
from asglight.judging.metrics import METRIC_NAMES
from asglight.judging.pictures.layout import BACKGROUND, FAINT, LINE, TEXT

PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="dark light">
<title>$title</title>
<style>
:root { $dark }
@media (prefers-color-scheme: light) { :root { $light } }
body { background: var(--ground); color: var(--text); margin: 0 auto; padding: 1.5rem 2rem 4rem;
  max-width: 1200px; font: 16px/1.5 system-ui, sans-serif; }
h1, h2, h3 { line-height: 1.2; margin: 2.2rem 0 .6rem; } h1 { margin-top: 0; }
p, li { max-width: 75ch; } a { color: inherit; } .note, caption { color: var(--faint); }
svg { width: 100%; height: auto; display: block; margin: 1rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: .4rem 0; }
th, td { padding: .2rem .7rem .2rem 0; text-align: right; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; }
summary { cursor: pointer; margin: .8rem 0; } b { font-weight: 700; }
</style>
</head>
<body>
<h1>$title</h1>
$body
</body>
</html>
""")

GLOSSARY = """<h2>How to read this</h2>
<p>Every error is relative to the map, over the whole sphere, and 0 is perfect. <b>env</b> is the
error of the map itself, <b>flux</b> of its total light, <b>irr</b> of the light on a white ball
(<b>irrMax</b>: at its worst place), <b>r0.5</b> and <b>r0.25</b> of what balls of that roughness
reflect, <b>flicker</b> of the change from frame to frame. <b>energy</b> is the light of the fit
over that of the map: 1 where none is lost.</p>
<p>Seconds are those of the processor on one thread, for the fit alone: reading the file and
judging the result are not in them. A <b>float</b> is a degree of freedom; an anisotropic lobe has
8, a round one 6, a point light 5. <b>Steps</b> are those of the method's own optimiser and mean
something else in each; methods without any have 0. Peak memory is what the process held at its
highest above what it held when the fit began.</p>
<p>Lines for <i>fast</i> and <i>best</i> are what one fit held on its way; those for <i>paper</i>
are whole runs with fewer steps, each with the full fall of its learning rate. Exponents are slopes
by least squares in logarithms with their standard error; a power law is a summary, and the last
column says how far the points are from it.</p>
<p>What the numbers do not say: <i>fast</i> and <i>best</i> minimise what irr, r0.5, r0.25 and env
measure, and no other method here does. Wavelets and harmonics gain with every float; lobes are
made for few. A method in torch may be a tenth as fast as it could be. One map says little about
another one. Absolute seconds belong to the machine above; only ratios travel.</p>"""

BYTES_MB = 1e6
DECIMALS = 4
"""Of errors in tables."""


def page(document: Mapping[str, Any], pictures: Mapping[str, Mapping[str, str]]) -> str:
    """Return the page.

    Args:
        document: As in bench.json.
        pictures: SVG elements by input and by what they show, in the order of the page.
    """
    names = ", ".join(record["name"] for record in document["inputs"])
    parts = [_head(document)]
    for record in document["inputs"]:
        parts += _input(record, pictures[record["name"]])
    parts.append(GLOSSARY)
    return PAGE.substitute(
        title=escape(f"asglight bench: {names}"),
        dark=_variables(is_dark=True),
        light=_variables(is_dark=False),
        body="\n".join(parts),
    )


def ahead(errors: Mapping[str, Mapping[str, float]], ours: Sequence[str]) -> str:
    """Return a sentence on the errors in which a method is ahead of every preset of ours.

    Args:
        errors: By method and metric.
        ours: The presets among the methods.
    """
    found = []
    for metric in errors[ours[0]]:
        # what differs behind the decimals of the tables is rounding
        shown = {name: round(each[metric], DECIMALS) for name, each in errors.items()}
        best = min(shown[name] for name in ours)
        found += [
            f"{name} in {metric} ({value:.4f} against {best:.4f})"
            for name, value in shown.items()
            if value < best
        ]
    presets = " and ".join([", ".join(ours[:-1]), ours[-1]])
    if not found:
        return f"No other method here is ahead of {presets} in any error."
    return f"Ahead of {presets}: {'; '.join(found)}."


def ahead_on_the_map(record: Mapping[str, Any]) -> str:
    """Return the sentence for the methods at one number of floats."""
    fits = _at_one_size(record)
    errors = {
        fit["method"]: {name: fit["points"][-1][name] for name in METRIC_NAMES} for fit in fits
    }
    return ahead(errors, ("fast", "best"))


def ahead_on_the_sequence(record: Mapping[str, Any]) -> str:
    """Return the sentence for the methods that follow a sequence."""
    methods = record["sequence"]["methods"]
    means = {name: found["mean"] for name, found in methods.items()}
    return ahead(means, ("live", "fast", "best"))


def _variables(*, is_dark: bool) -> str:
    ground, text, faint, line = (
        (BACKGROUND, TEXT, FAINT, LINE) if is_dark else ("#ffffff", "#1d1e20", "#5c5d5f", "#d9dadc")
    )
    colours = {"ground": ground, "text": text, "faint": faint, "line": line}
    for name, look in {**LOOKS, "peer": PEER}.items():
        colours[name] = look.dark if is_dark else look.light
    return " ".join(f"--{name}: {colour};" for name, colour in colours.items())


def _head(document: Mapping[str, Any]) -> str:
    at = document["machine"]
    sizes = [
        f"{record['name']}: {record['path']}, {_frames(record['frames'])}, "
        f"{record['columns']} x {record['rows']}"
        for record in document["inputs"]
    ]
    where = (
        f"{at['processor']}, {at['cores']} cores, load {at['load']} (1 is the bench itself); torch "
        f"{at['torch']}, Python {at['python']}. asglight {document['version']}."
    )
    return (
        "<p>How wrong a fit is, and what it costs, for every preset and beside other methods.</p>"
        f"<p><code>{escape(document['command'])}</code></p>"
        f"<p class='note'>{escape('; '.join(sizes))}.<br>{escape(where)}<br>"
        f"{escape(_left_out(document))}</p>"
    )


def _frames(frames: Sequence[int]) -> str:
    first, last = frames[0], frames[-1]
    return f"frame {first}" if len(frames) == 1 else f"frames {first} to {last}"


def _left_out(document: Mapping[str, Any]) -> str:
    """Say what the effort of this run leaves out."""
    absent = [
        name
        for name in PEERS
        if all(fit["method"] != name for record in document["inputs"] for fit in record["fits"])
    ]
    steps, every = document["paper_steps"], paper.FIRST_FRAME_STEPS
    parts = [f"Effort: {document['effort']}."]
    if steps < every:
        parts.append(f"The paper's recipe takes {steps:,} of its {every:,} steps.")
    if absent:
        parts.append(f"Not run: {', '.join(absent)}.")
    return " ".join(parts)


def _input(record: Mapping[str, Any], pictures: Mapping[str, str]) -> list[str]:
    parts = [f"<h2>{escape(record['name'])}</h2>", _summary(record)]
    parts.append(f"<p>{escape(ahead_on_the_map(record))}</p>")
    tables = {
        "time": [_checkpoints(record)],
        "lobes": [_by_lobes(record)],
        "scaling": [_scaling(record), _drift(record)],
    }
    if "sequence" in record:
        sentence = f"<p>{escape(ahead_on_the_sequence(record))}</p>"
        tables["following"] = [_following(record), sentence]
    for name, svg in pictures.items():
        parts.append(svg)
        parts += tables[name]
    return parts


def _at_one_size(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [fit for fit in record["fits"] if fit["lobes"] == record["lobes"]]


def _summary(record: Mapping[str, Any]) -> str:
    fits = _at_one_size(record)
    last = [fit["points"][-1] for fit in fits]
    columns = {
        "method": [_method(fit) for fit in fits],
        "floats": [f"{fit['floats']}" for fit in fits],
        "CPU s": [f"{point['cpu_seconds']:.2f}" for point in last],
        "wall s": [f"{point['wall_seconds']:.2f}" for point in last],
        "peak MB": [_megabytes(fit["peak_bytes"]) for fit in fits],
        "energy": [f"{point['energy']:.4f}" for point in last],
        **{name: _bold_least([point[name] for point in last]) for name in METRIC_NAMES},
    }
    race = {name: sorted(seconds) for name, seconds in record["races"].items()}
    note = "; ".join(
        f"{name} {seconds[0]:.2f} to {seconds[-1]:.2f} s" for name, seconds in race.items()
    )
    caption = (
        f"Every method with the floats of {record['lobes']} anisotropic lobes; the least of each "
        f"error is bold. CPU seconds of {len(race['fast'])} fits in turn: {note}."
    )
    return _table(columns, caption)


def _method(fit: Mapping[str, Any]) -> str:
    steps, published = fit["points"][-1]["steps"], fit["published_steps"]
    name = f"{fit['method']}: {METHODS[fit['method']].title}"
    return f"{name}, {steps:,} of {published:,} steps" if steps < published else name


def _checkpoints(record: Mapping[str, Any]) -> str:
    points = [(fit, point) for fit in record["fits"] for point in fit["points"]]
    keys = ("energy", *METRIC_NAMES)
    columns = {
        "method": [fit["method"] for fit, _ in points],
        "lobes": [f"{fit['lobes']}" for fit, _ in points],
        "steps": [f"{point['steps']:,}" for _, point in points],
        "CPU s": [f"{point['cpu_seconds']:.3f}" for _, point in points],
        "wall s": [f"{point['wall_seconds']:.3f}" for _, point in points],
        **{key: [f"{point[key]:.4f}" for _, point in points] for key in keys},
    }
    return _folded("every checkpoint of every fit", _table(columns, ""))


def _by_lobes(record: Mapping[str, Any]) -> str:
    fits = [fit for fit in record["fits"] if fit["method"] in LOOKS]
    columns = {
        "method": [fit["method"] for fit in fits],
        "lobes": [f"{fit['lobes']}" for fit in fits],
        "steps": [f"{fit['points'][-1]['steps']:,}" for fit in fits],
        "CPU s": [f"{fit['points'][-1]['cpu_seconds']:.2f}" for fit in fits],
        "peak MB": [_megabytes(fit["peak_bytes"]) for fit in fits],
        **{name: [f"{fit['points'][-1][name]:.4f}" for fit in fits] for name in METRIC_NAMES},
    }
    return _folded("errors by number of lobes", _table(columns, ""))


def _scaling(record: Mapping[str, Any]) -> str:
    rows = [
        (way["unit"], name, found)
        for way in record["scaling"].values()
        for name, found in way["methods"].items()
    ]
    laws = [found["law"] for _, _, found in rows]
    columns = {
        "time of": [name for _, name, _ in rows],
        "with": [unit for unit, _, _ in rows],
        "from": [f"{found['sizes'][0]:,}" for _, _, found in rows],
        "to": [f"{found['sizes'][-1]:,}" for _, _, found in rows],
        "seconds": [
            f"{found['cpu_seconds'][0]:.3g} to {found['cpu_seconds'][-1]:.3g}"
            for _, _, found in rows
        ],
        "exponent": [
            "–" if law is None else f"{law['exponent']:.2f} ± {law['standard_error']:.2f}"
            for law in laws
        ],
        "points off the line": ["–" if law is None else f"x {law['spread']:.2f}" for law in laws],
    }
    finer = record["scaling"]["texels"]["source_columns"]
    caption = (
        f"Growth of the processor's time. The file has {finer:,} columns; on finer maps its texels "
        "are split. Frames are those after the first one."
    )
    return _table(columns, caption)


def _drift(record: Mapping[str, Any]) -> str:
    frames = record["scaling"]["frames"]
    found = next(iter(frames["methods"].values()))
    columns = {
        "frame": [f"{count:,}" for count in found["sizes"]],
        "CPU s so far": [f"{seconds:.2f}" for seconds in found["cpu_seconds"]],
        "r0.25 of this frame": [f"{error:.4f}" for error in found["r0.25"]],
    }
    caption = (
        "Drift: the map, or the sequence there and back, turned by one texel a frame and followed "
        f"by live. Peak memory {_megabytes(frames['peak_bytes'])} MB."
    )
    return _table(columns, caption)


def _following(record: Mapping[str, Any]) -> str:
    methods = record["sequence"]["methods"]
    found = list(methods.values())
    keys = (*METRIC_NAMES, "flicker")
    columns = {
        "method": [f"{name}: {each['title']}" for name, each in methods.items()],
        "first s": [f"{each['cpu_seconds'][0]:.2f}" for each in found],
        "next s": [f"{each['next_cpu_seconds']:.3f}" for each in found],
        "worst s": [f"{max(each['cpu_seconds'][1:]):.3f}" for each in found],
        "peak MB": [_megabytes(each["peak_bytes"]) for each in found],
        **{key: _bold_least([each["mean"][key] for each in found]) for key in keys},
        "jumps": [f"{each['jumps']}" for each in found],
    }
    first, following = record["sequence"]["paper_steps"]
    caption = (
        f"{len(record['frames'])} frames, errors are means over them. A jump is a lobe with over "
        "1 % of the flux that turns by more than 10 degrees between two frames. paper takes "
        f"{first:,} steps for the first frame and {following:,} for each next one."
    )
    return _table(columns, caption)


def _bold_least(values: Sequence[float]) -> list[str]:
    least = f"{min(values):.4f}"
    texts = [f"{value:.4f}" for value in values]
    return [f"<b>{text}</b>" if text == least else text for text in texts]


def _megabytes(count: int | None) -> str:
    return "–" if count is None else f"{count / BYTES_MB:.0f}"


def _table(columns: Mapping[str, Sequence[str]], caption: str) -> str:
    """Return a table; only the tag of bold cells is taken as it is."""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    rows = [
        "<tr>" + "".join(f"<td>{_cell(text)}</td>" for text in row) + "</tr>"
        for row in zip(*columns.values(), strict=True)
    ]
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (
        f"<div class='wide'><table>{title}<thead><tr>{head}</tr></thead><tbody>"
        + "".join(rows)
        + "</tbody></table></div>"
    )


def _cell(text: str) -> str:
    if text.startswith("<b>"):
        return f"<b>{escape(text[3:-4])}</b>"
    return escape(text)


def _folded(summary: str, content: str) -> str:
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"
