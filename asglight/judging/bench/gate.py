# SPDX-License-Identifier: Apache-2.0
"""A run of the bench held against an earlier one: what got worse by more than chance.

A baseline holds numbers by name for each input. Errors are compared by ratio. Times are compared
only as ratios to a peer that was timed in the same run (`fast` to EM), so that a baseline of one
machine serves on another; no second is ever compared with a second of another run.
"""

import json
import math
import os
import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.message import listing, shown
from asglight.judging.bench.plan import CROWDED
from asglight.judging.metrics import METRIC_NAMES

TAG, FORMAT = "asglight_bench_baseline", 1

OURS = ("fast", "best")

HELD = ("live", *OURS)
"""Methods whose errors are held together as well."""

ERROR_RATIO_MAX, ERROR_FLOOR = 1.5, 1e-4
"""On another processor sums round differently, and a fit takes other steps: noise of 1e-6 in the
maps `lobby` and `tunnel` changed single errors by up to 1.32 times. Nobody sees an error below the
floor, whatever its ratio to another one."""

MEAN_RATIO_MAX = 1.1
"""Of all errors of a method on an input, the geometric mean of the ratios: chance goes both ways,
and the same noise left it below 1.08 for one fit alone."""

TIME_RATIO_MAX = 1.5
"""Seconds of two methods that take turns: a shared machine moves their ratio by a fifth or so."""

FACTS = ("rows", "columns", "frames", "mean_radiance")
"""What tells an input from another one of its name."""

LIGHT_TOLERANCE = 0.01
"""Relative. Two maps of one name whose mean radiance differs by more are not the same map."""


@dataclass(frozen=True)
class Worse:
    """A number that is worse than the baseline's.

    Attributes:
        input: Name of the input.
        metric: Name of the number, such as `fast, 15 lobes, irr`.
        before: The baseline's.
        now: This run's.
        ratio_max: What was allowed.
    """

    input: str
    metric: str
    before: float
    now: float
    ratio_max: float


def baseline(document: dict[str, Any]) -> dict[str, Any]:
    """Return what a later run is held against.

    Args:
        document: A whole run, as in bench.json.
    """
    return {
        TAG: FORMAT,
        **{key: document[key] for key in ("effort", "lobes", "paper_steps")},
        "inputs": {
            record["name"]: described(record) | {"numbers": numbers(record)}
            for record in document["inputs"]
        },
    }


def read_baseline(path: Path) -> dict[str, Any]:
    """Read a baseline.

    Raises:
        InputError: It cannot be read, or is none.
    """
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe would be waited for
        raise InputError(
            f"{shown(path)}: is no file; expected a baseline. Write one with --baseline."
        )
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{shown(path)}: {error.strerror}; expected a baseline. Write one with --baseline."
        ) from error
    except ValueError as error:
        raise InputError(
            f"{shown(path)}: is no JSON; expected a baseline that --baseline wrote."
        ) from error
    if not isinstance(found, dict) or found.get(TAG) != FORMAT:
        raise InputError(
            f"{shown(path)}: is no baseline of this version; expected one that --baseline wrote."
        )
    inputs = found.get("inputs")
    if not isinstance(inputs, dict) or not all(map(_is_whole, inputs.values())):
        raise InputError(
            f"{shown(path)}: is a baseline with a part missing or damaged; expected inputs with "
            "numbers. Write it anew with --baseline."
        )
    return found


def _is_whole(known: object) -> bool:
    """Tell whether a baseline holds all that it has to of an input, in finite numbers."""
    if not isinstance(known, dict) or not isinstance(known.get("numbers"), dict):
        return False
    facts, held = [known.get(key) for key in FACTS], known["numbers"].values()
    # nothing is worse than no number at all or one that is infinite
    return bool(held) and all(
        isinstance(value, int | float) and math.isfinite(value) for value in (*facts, *held)
    )


def check_asked(before: dict[str, Any], path: Path, asked: dict[str, Any]) -> None:
    """Refuse a baseline of another effort before any time is spent.

    Args:
        before: The baseline.
        path: Its file.
        asked: Effort, lobes and steps of this run.

    Raises:
        InputError: Something differs.
    """
    for key, wanted in asked.items():
        if before.get(key) != wanted:
            raise InputError(
                f"{shown(path)}: was written with {key} {shown(str(before.get(key)))}, this run "
                f"has {wanted}; expected the same. Change the options or write it anew."
            )


def check_inputs(
    before: dict[str, Any], path: Path, inputs: Mapping[str, Mapping[str, Any]]
) -> None:
    """Refuse inputs that a baseline does not know, before any time is spent.

    Args:
        before: The baseline.
        path: Its file.
        inputs: What describes each input, by name: rows, columns, frames, mean radiance.

    Raises:
        InputError: An input is missing there, or is another one.
    """
    for name, now in inputs.items():
        known = before["inputs"].get(name)
        if known is None:
            raise InputError(
                f"{shown(path)}: has no input {shown(name)}; expected one of "
                f"{listing(before['inputs'])}. Leave the input out or write the baseline anew."
            )
        _check_same_map(known, now, f"{shown(path)}: {shown(name)}")


def compared(before: dict[str, Any], path: Path, document: dict[str, Any]) -> list[Worse]:
    """Return what is worse than the baseline.

    Args:
        before: The baseline; it knows the inputs.
        path: Its file, for messages.
        document: This run.

    Raises:
        InputError: The baseline has a number that this run has not.
    """
    found: list[Worse] = []
    for record in document["inputs"]:
        name, now = record["name"], numbers(record)
        known = before["inputs"][name]["numbers"]
        lacking = [key for key in known if key not in now]
        if lacking:
            raise InputError(
                f"{shown(path)}: {shown(name)} has {listing(lacking)}, this run has not; expected "
                "the same numbers. Write the baseline anew."
            )
        for key, old in known.items():
            worse = _held(key, float(old), now[key])
            if worse is not None:
                found.append(Worse(name, key, *worse))
        for method in HELD:
            mean = _mean_ratio(method, known, now)
            if mean > MEAN_RATIO_MAX:
                title = f"{method}, errors over those before, mean"
                found.append(Worse(name, title, 1.0, mean, MEAN_RATIO_MAX))
    return found


def numbers(record: dict[str, Any]) -> dict[str, float]:
    """Return the numbers of an input that must not get worse, by name; less is better in all.

    Args:
        record: As in bench.json.
    """
    result: dict[str, float] = {}
    for fit in record["fits"]:
        if fit["method"] in OURS:
            for metric in METRIC_NAMES:
                name = f"{fit['method']}, {_counted(fit['lobes'])}, {metric}"
                result[name] = fit["points"][-1][metric]
    race = {name: statistics.median(seconds) for name, seconds in record["races"].items()}
    result["fast, time over em"] = race["fast"] / race["em"]
    # not over that of fewer lobes: these may become faster alone
    result["fast, time of a crowd over em"] = race[CROWDED] / race["em"]
    sequence = record.get("sequence", {"methods": {}})["methods"]
    for name in ("live", *OURS):
        if name in sequence:
            found = sequence[name]
            for metric, value in found["mean"].items():
                result[f"{name}, sequence, {metric}"] = value
            em_seconds = sequence["em"]["next_cpu_seconds"]
            result[f"{name}, sequence, time over em"] = found["next_cpu_seconds"] / em_seconds
    return result


def described(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return what tells an input from another one of its name.

    Args:
        record: With its rows, columns, mean radiance and frame numbers.
    """
    own = {key: record[key] for key in ("rows", "columns", "mean_radiance")}
    return own | {"frames": len(record["frames"])}


def _check_same_map(before: Mapping[str, Any], now: Mapping[str, Any], where: str) -> None:
    for key in ("rows", "columns", "frames"):
        if before[key] != now[key]:
            raise InputError(
                f"{where} had {before[key]} {key}, this run has {now[key]}; expected the same "
                "input. Write the baseline anew."
            )
    old, new = before["mean_radiance"], now["mean_radiance"]
    if abs(new / old - 1) > LIGHT_TOLERANCE:
        raise InputError(
            f"{where} had a mean radiance of {old:.4g}, this run has {new:.4g}; expected the same "
            "map. Write the baseline anew."
        )


def _mean_ratio(method: str, before: Mapping[str, float], now: Mapping[str, float]) -> float:
    """Return the geometric mean of the ratios of a method's errors; 1 where it has none."""
    ratios = [
        max(now[key], ERROR_FLOOR) / max(old, ERROR_FLOOR)
        for key, old in before.items()
        if key.startswith(f"{method},") and not _is_time(key)
    ]
    return statistics.geometric_mean(ratios) if ratios else 1.0


def _is_time(name: str) -> bool:
    return ", time " in name


def _held(name: str, before: float, now: float) -> tuple[float, float, float] | None:
    """Return both numbers and the allowed ratio where it is exceeded."""
    ratio_max, floor = (TIME_RATIO_MAX, 0.0) if _is_time(name) else (ERROR_RATIO_MAX, ERROR_FLOOR)
    if now <= ratio_max * max(before, floor):
        return None
    return before, now, ratio_max


def _counted(lobes: int) -> str:
    return "1 lobe" if lobes == 1 else f"{lobes} lobes"
