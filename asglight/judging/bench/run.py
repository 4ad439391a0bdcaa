# SPDX-License-Identifier: Apache-2.0
"""Error against run time: everything that `asglight bench` measures of one input.

Results are plain dictionaries, as bench.json holds them: `docs/results/bench.md` says what each
number is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from asglight import __version__
from asglight.judging.bench import scaling as bench_scaling
from asglight.judging.bench import sequence as bench_sequence
from asglight.judging.bench import still as bench_still
from asglight.judging.bench.plan import Plan
from asglight.judging.compare.maps import Follow
from asglight.judging.machine import machine

FORMAT = 1
"""Of bench.json; a reader refuses any other."""


@dataclass(frozen=True)
class Input:
    """What is measured on.

    Attributes:
        name: Short, of files and headings.
        path: As it was given.
        frames: Frame numbers.
        references: Their repaired radiance at the size that is fitted.  [H, W, 3]
        source: The first of them as finely as its file has it.  [H', W', 3]
    """

    name: str
    path: str
    frames: tuple[int, ...]
    references: Sequence[Tensor] = field(repr=False)
    source: Tensor = field(repr=False)

    def facts(self) -> dict[str, Any]:
        """Return what describes the input, as bench.json holds it."""
        rows, columns, _ = self.references[0].shape
        return {
            "name": self.name,
            "path": self.path,
            "frames": list(self.frames),
            "rows": rows,
            "columns": columns,
            "mean_radiance": float(self.references[0].double().mean()),
        }


def document(plan: Plan, inputs: Sequence[dict[str, Any]], command: str) -> dict[str, Any]:
    """Return the whole of a run: what was asked for, where, and the record of each input."""
    return {
        "asglight_bench": FORMAT,
        "version": __version__,
        "command": command,
        "effort": plan.effort.value,
        "lobes": plan.lobes,
        "paper_steps": plan.paper_steps,
        "machine": machine(),
        "inputs": list(inputs),
    }


def measured(given: Input, plan: Plan, follow: Follow) -> dict[str, Any]:
    """Measure one input.

    Args:
        given: The input; every frame has some light in it.
        plan: What is measured.
        follow: Shows how far this is.
    """
    reference = given.references[0]
    done = bench_still.runs(reference, plan, follow)
    record: dict[str, Any] = {
        **given.facts(),
        "lobes": plan.lobes,
        "floats": plan.floats,
        "fits": bench_still.judged(done, reference, follow),
        "races": bench_still.races(reference, plan, follow),
        "scaling": bench_scaling.measured(given.source, given.references, done, plan, follow),
    }
    if len(given.references) > 1:
        record["sequence"] = bench_sequence.measured(given.references, plan, follow)
    return record
