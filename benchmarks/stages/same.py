# SPDX-License-Identifier: Apache-2.0
"""Hold stages that another reader wrote as text against the stages themselves.

    python -m benchmarks.stages.same FOLDER OUTPUT

Every prim, attribute and sample of every variant must be there, with its value. tinyusdz prints six
digits of a number, so times and values are compared as it prints them; it leaves out empty arrays.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd

DIGITS = 6
"""Of a time, as tinyusdz prints it: samples between frames that are nearer fall together."""

SAME = 5.1e-6
"""Relative difference of values that were printed with so many digits."""


def main() -> None:
    """Compare all stages."""
    folder, output = (Path(name) for name in sys.argv[1:])
    paths = sorted(output.glob("*.usda"))
    findings, samples = [] if paths else [f"{output}: no stage to compare"], 0
    for path in paths:
        source = folder / path.name.removesuffix(".usda")
        found, count = compared(source, path)
        findings += [f"{source.name}: {line}" for line in found]
        samples += count
    print(f"tinyusdz: {len(paths)} stages, {samples} samples, {len(findings)} findings")
    sys.exit("\n".join(findings) or 0)


def compared(source: Path, text: Path) -> tuple[list[str], int]:
    """Return what differs, and how many samples were compared."""
    stages = [Usd.Stage.Open(str(path)) for path in (source, text)]
    findings, samples = [], 0
    holders = [prim for prim in stages[0].Traverse() if prim.HasVariantSets()]
    variants = holders[0].GetVariantSet("representation").GetVariantNames() if holders else [""]
    for name in variants:
        if name:
            for stage in stages:
                stage.SetEditTarget(stage.GetSessionLayer())
                prim = stage.GetPrimAtPath(holders[0].GetPath())
                prim.GetVariantSet("representation").SetVariantSelection(name)
        for prim in stages[0].Traverse():
            for attribute in prim.GetAuthoredAttributes():
                other = stages[1].GetAttributeAtPath(attribute.GetPath())
                count = len(attribute.GetTimeSamples())
                samples += count
                if not other or not same(attribute, other):
                    what = "differs" if other else "is not there"
                    findings.append(f"{name} {attribute.GetPath()} {what}")
    return findings, samples


def same(attribute: Usd.Attribute, other: Usd.Attribute) -> bool:
    """Tell whether two attributes have the same values at the same times."""
    if not alike(attribute.Get(), other.Get()):
        return False
    times = attribute.GetTimeSamples()
    found = set(other.GetTimeSamples())
    printed = {time: float(f"{time:.{DIGITS}g}") for time in times}
    if found != set(printed.values()):
        return False
    return all(
        any(alike(attribute.Get(time), other.Get(at)) for time in times if printed[time] == at)
        for at in found
    )


def alike(value: Any, other: Any) -> bool:
    """Tell whether two values are one, but for what printing rounds."""
    if isinstance(value, Sdf.AssetPath):
        return isinstance(other, Sdf.AssetPath) and value.path == other.path
    if hasattr(value, "__len__") and not isinstance(value, str) and not len(value):
        return other is None
    if isinstance(value, str | bool) or value is None or other is None:
        return value == other
    pair = [_numbers(one) for one in (value, other)]
    if any(isinstance(one[0], str) for one in pair if one):
        return pair[0] == pair[1]
    return np.allclose(*pair, rtol=SAME, atol=1e-9)


def _numbers(value: Any) -> list[Any]:
    if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
        return [value.GetReal(), *value.GetImaginary()]
    return list(value) if hasattr(value, "__iter__") else [value]


if __name__ == "__main__":
    main()
