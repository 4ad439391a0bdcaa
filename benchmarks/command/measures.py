# SPDX-License-Identifier: Apache-2.0
"""The commands that are measured, and the ratios that they are held to."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.command.frames import written
from benchmarks.command.runs import Run, in_turn

ASGLIGHT = ("-c", "import sys; from asglight.cli.main import main; sys.exit(main())")


@dataclass(frozen=True)
class Sizes:
    """How much is measured.

    Attributes:
        frames: Of the sequence that is fitted and written.
        large: Frames of 4k, which are fitted beside as many of `rows`.
        rows: Of a frame as the fit takes it.
        large_rows: Of a large one.
        lobes: Few and many, of the growth.
        times: Runs of each command, of which the least counts.
    """

    frames: int = 48
    large: int = 8
    rows: int = 256
    large_rows: int = 2048
    lobes: tuple[int, int] = (15, 120)
    times: int = 3

    def as_json(self) -> dict[str, Any]:
        """Return all but the number of runs, as it is in the baseline."""
        numbers = asdict(self) | {"lobes": list(self.lobes)}
        return {name: number for name, number in numbers.items() if name != "times"}


SHORT = Sizes(frames=3, large=2, rows=16, large_rows=32, lobes=(1, 2), times=1)
"""A trial."""

Found = Mapping[str, Sequence[Run]]


class Time(NamedTuple):
    """A time: the wall seconds of a command, or seconds that it measured itself."""

    command: str
    part: str | None = None

    def least(self, found: Found) -> float:
        """Return the least of several runs."""
        runs = found[self.command]
        if self.part is None:
            return min(run.wall for run in runs)
        return min(json.loads(run.printed)[self.part] for run in runs)


RATIOS = {
    "--help over import torch": (Time("help"), Time("import torch")),
    "info over import torch": (Time("info"), Time("import torch")),
    "fit of a tiny map over import torch": (Time("tiny"), Time("import torch")),
    "fit over its fit alone": (Time("fit"), Time("parts", "fit")),
    "write over its fit alone": (Time("parts", "write"), Time("parts", "fit")),
    "4k over 256 rows": (Time("large"), Time("small")),
    "120 lobes over 15": (Time("growth", "many"), Time("growth", "few")),
}
"""What over what."""


def ratios(found: Found) -> dict[str, float]:
    """Return the ratios of a run by name."""
    return {name: of.least(found) / to.least(found) for name, (of, to) in RATIOS.items()}


def commands(folder: Path, sizes: Sizes) -> dict[str, list[str]]:
    """Write frames, and return the arguments of Python of each command by name.

    Args:
        folder: For frames and stages.
        sizes: How much.
    """
    shot = written(folder / "shot", sizes.frames, sizes.rows)
    large = written(folder / "large", sizes.large, sizes.large_rows)
    small = written(folder / "small", sizes.large, sizes.rows)
    tiny = written(folder / "tiny", 1, 16)

    def fit(source: Path, *others: str) -> list[str]:
        stage = folder / f"{source.name}.usda"
        return [*ASGLIGHT, "fit", str(source), "-o", str(stage), "--preset", "live", *others]

    parts = ["-m", "benchmarks.command.parts"]
    return {
        "import torch": ["-c", "import torch"],
        "help": [*ASGLIGHT, "--help"],
        "tiny": fit(tiny, "--lobes", "1"),
        "info": [*ASGLIGHT, "info", str(folder / "tiny.usda")],
        "fit": fit(shot),
        "parts": [*parts, "fit", str(shot), "live"],
        "large": fit(large),
        "small": fit(small),
        "growth": [*parts, "growth", str(sizes.rows), *map(str, sizes.lobes)],
    }


def measured(folder: Path, sizes: Sizes) -> dict[str, list[Run]]:
    """Run every command in turn.

    Args:
        folder: For frames and stages.
        sizes: How much.
    """
    return in_turn(commands(folder, sizes), sizes.times)
