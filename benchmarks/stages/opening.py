# SPDX-License-Identifier: Apache-2.0
"""Open stages with whatever USD this interpreter has, and nothing of asglight.

    python -m benchmarks.stages.opening FOLDER

Every variant is composed, every value read at every frame, every image resolved; a warning on
either stream, a missing value or a missing image is a failure.
"""

import os
import sys
import tempfile
from pathlib import Path

from pxr import Usd


def main() -> None:
    """Open all stages of a folder."""
    folder = Path(sys.argv[1])
    stages = sorted(folder.glob("*.usd*"))
    with tempfile.TemporaryFile() as heard:
        kept = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            findings = [] if stages else [f"{folder}: no stage to open"]
            findings += [finding for stage in stages for finding in opened(stage)]
        finally:
            os.dup2(kept, 2)
        heard.seek(0)
        said = heard.read().decode(errors="replace").splitlines()
    findings += [f"said: {line}" for line in said if line.strip()]
    version = ".".join(str(part) for part in Usd.GetVersion())
    print(f"USD {version}: {len(stages)} stages, {len(findings)} findings")
    sys.exit("\n".join(findings) or 0)


def opened(path: Path) -> list[str]:
    """Return what is wrong with a stage in any of its variants."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    found = []
    holders = [prim for prim in stage.Traverse() if prim.HasVariantSets()]
    variants = holders[0].GetVariantSet("representation") if holders else None
    for name in variants.GetVariantNames() if variants else ["its only representation"]:
        if variants:
            variants.SetVariantSelection(name)
        lights = [prim for prim in stage.Traverse() if prim.GetTypeName().endswith("Light")]
        if not lights:
            found.append(f"{path.name}: no light in {name}")
        for prim in stage.Traverse():
            for attribute in prim.GetAuthoredAttributes():
                found += values(path, attribute)
    return found


def values(path: Path, attribute: Usd.Attribute) -> list[str]:
    """Return the frames without a value or without an image."""
    codes = [Usd.TimeCode.Default(), *map(Usd.TimeCode, attribute.GetTimeSamples())]
    found = []
    for code in codes:
        value = attribute.Get(code)
        if value is None:
            found.append(f"{path.name}: {attribute.GetPath()} has no value at {code}")
        elif hasattr(value, "resolvedPath") and not value.resolvedPath:
            found.append(f"{path.name}: {attribute.GetPath()} is not there at {code}")
    return found


if __name__ == "__main__":
    main()
