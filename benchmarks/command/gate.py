# SPDX-License-Identifier: Apache-2.0
"""Ratios of a run held against those of an earlier one."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.message import listing, shown
from benchmarks.given import read_text

TAG, FORMAT = "asglight_command_baseline", 1

FACTOR = 1.3
"""That a ratio may be larger than the baseline's: the least of three runs in turn moves by a
tenth or so on a machine with other work, and what this is for makes a third and more."""


def as_baseline(ratios: Mapping[str, float], sizes: Mapping[str, Any]) -> dict[str, Any]:
    """Return what later runs are held against.

    Args:
        ratios: By name.
        sizes: Of what was measured; JSON values.
    """
    return {
        TAG: FORMAT,
        "sizes": dict(sizes),
        "ratios": {name: round(value, 3) for name, value in ratios.items()},
    }


def read(path: Path, names: list[str], sizes: Mapping[str, Any]) -> dict[str, float]:
    """Read the ratios of a baseline.

    Args:
        path: Its file.
        names: Those that this run measures.
        sizes: Of what it measures.

    Raises:
        InputError: It cannot be read, is none, or is of other ratios or sizes.
    """
    fix = "Write it anew with --bless."
    text = read_text(path, f"a baseline. {fix}")
    try:
        found = json.loads(text)
    except ValueError as error:
        raise InputError(f"{shown(path)}: is no JSON; expected a baseline. {fix}") from error
    if not isinstance(found, dict) or found.get(TAG) != FORMAT:
        raise InputError(f"{shown(path)}: is no baseline of this version; expected one. {fix}")
    ratios = found.get("ratios")
    if not isinstance(ratios, dict) or not isinstance(found.get("sizes"), dict):
        raise InputError(f"{shown(path)}: has no ratios and sizes; expected a baseline. {fix}")
    if list(ratios) != names:
        raise InputError(f"{shown(path)}: has {listing(ratios)}; expected {listing(names)}. {fix}")
    if found["sizes"] != sizes:
        raise InputError(
            f"{shown(path)}: is of {shown(str(found['sizes']))}; expected {sizes}. {fix}"
        )
    wrong = [name for name, value in ratios.items() if not _is_ratio(value)]
    if wrong:
        raise InputError(f"{shown(path)}: {listing(wrong)}: no ratio; expected a baseline. {fix}")
    return ratios


def _is_ratio(value: object) -> bool:
    # nothing is worse than one that is infinite or no number
    return isinstance(value, int | float) and 0 < value < math.inf


def worse(before: Mapping[str, float], now: Mapping[str, float]) -> list[str]:
    """Return a line for each ratio that got worse by more than `FACTOR`."""
    return [
        f"{name}: {now[name]:.2f}, was {value:.2f}; at most {FACTOR * value:.2f}"
        for name, value in before.items()
        if now[name] > FACTOR * value
    ]
