# SPDX-License-Identifier: Apache-2.0
"""What a measure is given, and what it finds."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol


@dataclass(frozen=True)
class Given:
    """What a measure is given.

    Attributes:
        device: Where torch computes.
        short: Whether everything is as small as can be: a trial of the measures themselves.
        maps: A folder of latlong maps; where there is none, maps are made up.
        sequence: A folder with a sequence; likewise.
        seconds: Until the measure is ended.
        choice: Of a measure that comes in several, which.
    """

    device: str
    short: bool
    maps: Path
    sequence: Path
    seconds: float
    choice: str = ""

    @property
    def is_gpu(self) -> bool:
        """Whether the device is one on which a measure says something."""
        return self.device.startswith("cuda")


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        what: Was measured.
        found: Numbers by name; units are in the names.
        goal: Of one of those, by name, the largest that will do.
    """

    what: str
    found: dict[str, float | str]
    goal: dict[str, float] = field(default_factory=dict)

    @property
    def missed(self) -> bool:
        """Whether a number is above its goal, or none."""
        return any(not float(self.found[name]) <= most for name, most in self.goal.items())

    def as_json(self) -> dict[str, Any]:
        """Return the row as it is in the JSON, which knows no number that is not finite."""
        found = {
            name: value if isinstance(value, str) or math.isfinite(value) else str(value)
            for name, value in self.found.items()
        }
        return asdict(self) | {"found": found, "missed": self.missed}


class Measuring(Protocol):
    """A measure: what a file of this room has as `measure`."""

    def __call__(self, given: Given) -> Iterator[Row]:
        """Yield rows as they are found; an exception says why there are no more."""
        ...
