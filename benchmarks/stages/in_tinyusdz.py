# SPDX-License-Identifier: Apache-2.0
"""Have tinyusdz read stages and write as text what it read; runs where tinyusdz is.

    python -m benchmarks.stages.in_tinyusdz FOLDER OUTPUT

`benchmarks/stages/same.py` holds the text against the stages. tinyusdz composes nothing: a layer
over a stage is none for it, and is left out.
"""

import sys
from pathlib import Path

import tinyusdz

COMPOSED = ("edits.usda",)
"""Layers over other stages."""


def main() -> None:
    """Read all stages of a folder."""
    folder, output = (Path(name) for name in sys.argv[1:])
    output.mkdir(parents=True, exist_ok=True)
    findings = []
    for path in sorted(folder.glob("*.usd*")):
        if path.name in COMPOSED:
            continue
        try:
            text = tinyusdz.load(str(path)).export_to_string()
        except tinyusdz.UsdError as error:
            findings.append(f"{path.name}: {str(error).splitlines()[0]}")
            continue
        (output / f"{path.name}.usda").write_text(text)
    sys.exit("\n".join(findings) or 0)


if __name__ == "__main__":
    main()
