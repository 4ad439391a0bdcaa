# SPDX-License-Identifier: Apache-2.0
"""`asglight eval --limit`: errors that a stage is not to exceed, so that a farm job can fail."""

import argparse
import math
from collections.abc import Mapping, Sequence

from asglight.errors import InputError
from asglight.images.message import shown

EXPLANATION = """\
With --limit the exit status is 3 where the mean of an error is above its limit (with --between:
that of the stage as a program interpolates it)."""

EXCEEDED = 3
"""Exit status: the stage is judged, and an error is above its limit."""

Limit = tuple[str, float]


def limit(text: str) -> Limit:
    """Read `irr=0.01`: the name of an error and the most that it may be.

    Raises:
        argparse.ArgumentTypeError: It is something else.
    """
    name, _, value = text.partition("=")
    try:
        most = float(value)
    except ValueError:
        most = math.nan
    if not name or not most >= 0:
        raise argparse.ArgumentTypeError(f"{text!r}; expected an error and a number: irr=0.01")
    return name, most


def add_limit_option(parser: argparse.ArgumentParser) -> None:
    """Add --limit."""
    most = "exit with 3 where the mean of this error is larger; may be given several times"
    parser.add_argument(
        "--limit",
        dest="limits",
        type=limit,
        action="append",
        default=[],
        metavar="ERROR=NUMBER",
        help=most,
    )


def check_limits(limits: Sequence[Limit], names: Sequence[str]) -> None:
    """Refuse limits of what is not measured.

    Raises:
        InputError: There is no such error.
    """
    for name, _ in limits:
        if name not in names:
            raise InputError(f"--limit {shown(name)}: expected one of {', '.join(names)}.")


def above(mean: Mapping[str, float], limits: Sequence[Limit]) -> list[str]:
    """Return a line for each error above its limit.

    One that is not a number is above any. Of one frame there is no flicker, which is not above.
    """
    return [
        f"{name} {mean[name]:.4g}: above the limit of {most:g}"
        for name, most in limits
        if name in mean and not mean[name] <= most
    ]
