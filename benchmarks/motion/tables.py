# SPDX-License-Identifier: Apache-2.0
"""The tables of `measure.py`, as Markdown."""

from typing import Any

from asglight.judging.motion import between
from benchmarks.fits.tables import markdown

AT_FRAMES = ("irr", "r0.5", "r0.25")


def tables(found: dict[str, Any]) -> str:
    """Return errors between frames, and below them those at the frames."""
    rows = [
        [f"{name}, {preset}", way, *_cells(one, way)]
        for name, presets in found.items()
        for preset, one in presets.items()
        for way in between.WAYS
    ]
    header = ["half-way between frames", "as", *between.METRICS]
    above = markdown(header, rows)
    note = "In brackets: over the fits dissolved; of flux, the difference from them."
    at = [
        [f"{name}, {preset}", *_frame_cells(one)]
        for name, presets in found.items()
        for preset, one in presets.items()
    ]
    header = ["at the frames", "flicker / EM", *AT_FRAMES, "CPU s", "samples", "between", "kB"]
    header.append("passages followed")
    return f"{above}\n\n{note}\n\n{markdown(header, at)}"


def _cells(account: dict[str, Any], way: str) -> list[str]:
    mean, fits = account["between"][way], account["between"][between.FITS]
    cells = []
    for name in between.METRICS:
        text = f"{mean[name]:.4f}"
        if way != between.FITS:
            more = mean[name] - fits[name]
            ratio = account["ratios"][way][name]
            text += f" ({more:+.4f})" if name == "flux" else f" ({ratio:.2f})"
        cells.append(text)
    return cells


def _frame_cells(account: dict[str, Any]) -> list[str]:
    ratio = account["flicker_over_em"]
    return [
        "" if ratio is None else f"{ratio:.2f}",
        *(f"{account['at_frames'][name]:.4f}" for name in AT_FRAMES),
        f"{account['cpu_seconds_per_frame']:.3f}",
        f"{account['samples']}",
        f"{account['samples_between']}",
        f"{account['bytes'] / 1000:.0f}",
        " ".join(f"{one['share']:.2f}" for one in account["passages"]) or "none",
    ]
