# SPDX-License-Identifier: Apache-2.0
"""The measures, in the order in which they are taken, and the seconds that each may have."""

from typing import NamedTuple

DEADLINE = 480.0
"""Seconds of the whole: eight minutes, of which `make gpu` takes what the set-up took."""


class Measure(NamedTuple):
    """A measure.

    Attributes:
        name: As it is asked for.
        module: The file of this room that takes it.
        seconds: After which it is ended; rows that it has found by then are kept.
        choice: `Given.choice`.
    """

    name: str
    module: str
    seconds: float
    choice: str = ""


MEASURES = (
    Measure("tests", "marked_tests", 30),
    Measure("agreement", "agreement", 75),
    Measure("first frame", "first_frame", 30),
    Measure("shot, live", "shot", 45, "live"),
    Measure("shot, fast", "shot", 60, "fast"),
    Measure("shot, best", "shot", 65, "best"),
    Measure("stills", "stills", 75),
    Measure("error against time", "against_time", 50),
    Measure("viewer", "viewer", 25),
)
"""In all less than `DEADLINE`: what is right first, then what is asked for, then what compares."""
