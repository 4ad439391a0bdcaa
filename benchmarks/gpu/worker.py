# SPDX-License-Identifier: Apache-2.0
"""Takes one measure, in a process of its own, and writes each row as a line of JSON.

    python -m benchmarks.gpu.worker given.json rows.jsonl

What it raises is told on standard error, the last line of which says why.
"""

import importlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.gpu.rows import Given, Measuring


def main(argv: Sequence[str]) -> int:
    """Measure."""
    given, target = map(Path, argv)
    told: dict[str, Any] = json.loads(given.read_text())
    module = importlib.import_module(f"benchmarks.gpu.{told.pop('module')}")
    told |= {name: Path(told[name]) for name in ("maps", "sequence")}
    measure: Measuring = module.measure
    with target.open("a") as rows:
        for row in measure(Given(**told)):
            rows.write(json.dumps(row.as_json()) + "\n")
            rows.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
