# SPDX-License-Identifier: Apache-2.0
"""What rounding does to a fit: float32 against float64, and the processor against CUDA.

    python -m benchmarks.steps.rounding --maps ../shared/hdri -o rounding.json
    python -m benchmarks.steps.rounding --stress

Every map is fitted (`fast`) in each arithmetic (rounding_worker.py). J, its slope and matrix, what
lobes show and what the judge says of them are then taken in each at the lobes of the first.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from asglight.cli.folders import write_text
from asglight.fitting.options import FIT_HEIGHT, LOBES
from asglight.judging.metrics import frame_errors
from asglight.judging.stress.cases import CASES
from asglight.lobes import Form, Lobes
from benchmarks.given import map_paths, read_map, refused_in_a_line

ROOT = Path(__file__).resolve().parents[2]

Arrays = dict[str, np.ndarray]
Figures = dict[str, float]

LOOKS = ("J", "slope", "matrix", "shown", "irr", "r0.5")
"""What is compared at the same lobes."""

JUDGED = ("irr", "r0.5")
"""What is compared of two fits."""


def main(argv: Sequence[str] | None = None) -> int:
    """Fit and look in each arithmetic; print a table of each comparison, write every number."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.steps.rounding", description=__doc__
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--maps", type=Path, metavar="DIR", help="latlong OpenEXR files")
    source.add_argument("--stress", action="store_true", help="the maps of `asglight stress`")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="every number as JSON")
    options = parser.parse_args(argv)
    paths = [] if options.stress else map_paths(parser, options.maps)
    with refused_in_a_line(parser):
        given = {path.stem: of_map(read_map(path)) for path in paths} or dict(stress_maps())
    document: dict[str, dict[str, Figures]] = {}
    for name, arithmetic, device in (("float64", "float64", "cpu"), ("cuda", "float32", "cuda")):
        if device == "cuda" and not torch.cuda.is_available():
            print("cuda: skipped: torch finds no CUDA device here")
            continue
        document[name] = compared(given, arithmetic, device)
        print(f"{table(document[name], f'float32 against {name}')}\n")
    if options.output is not None:
        write_text(options.output, json.dumps(document, indent=1) + "\n")
    return 0


def stress_maps() -> Iterator[tuple[str, Arrays]]:
    """Return the last frame of each stress case that is fitted as it is, repaired."""
    for case in CASES:
        if case.refused is None:
            radiance = torch.nan_to_num(case.frames()[-1], 0.0, 0.0, 0.0).clamp(min=0)
            if len(radiance) <= FIT_HEIGHT and float(radiance.sum()) > 0:
                yield f"{case.group}-{case.name}", of_map(radiance, case.lobes, case.form)


def of_map(radiance: torch.Tensor, lobes: int = LOBES, form: Form = Form.ASG) -> Arrays:
    """Return what the worker is given of a map.  [H, 2 H, 3]."""
    return {"map": radiance.numpy(), "lobes": np.array(lobes), "form": np.array(form.value)}


def compared(given: Mapping[str, Arrays], arithmetic: str, device: str) -> dict[str, Figures]:
    """Compare the processor's float32 with another arithmetic.

    Args:
        given: Maps by name, as of `of_map`.
        arithmetic: `float32` or `float64`.
        device: Of torch.

    Returns:
        By map: of `LOOKS` the difference at the same lobes, relative to the value, for a vector or
        an image relative to its length; of `JUDGED` the error of each fit, `irr float32`, `irr`.
    """
    fits = [worked(given, "float32", "cpu"), worked(given, arithmetic, device)]
    at = {name: given[name] | fits[0][name] for name in given}
    looks = [worked(at, "float32", "cpu"), worked(at, arithmetic, device)]
    found: dict[str, Figures] = {}
    for name, own in given.items():
        radiance, form = torch.from_numpy(own["map"]), Form(str(own["form"]))
        judged = [frame_errors(_lobes(each[name], form), radiance).values for each in fits]
        apart = differences(looks[0][name], looks[1][name])
        ends = {f"fitted {what}": judged[1][what] for what in JUDGED}
        ends |= {f"fitted {what} float32": judged[0][what] for what in JUDGED}
        found[name] = apart | ends
    return found


def differences(found: Arrays, exact: Arrays) -> Figures:
    """Return relative differences of what was seen at the same lobes.

    Slope and matrix are taken in units in which the exact matrix has the diagonal 1: radians,
    shapes and light differ by orders of magnitude. Where the frames refined other cells, of which
    two were as good, J is of something else and there is nothing to compare: NaN.
    """
    same = np.array_equal(found["cells"], exact["cells"])
    diagonal = np.diagonal(exact["matrix"])
    unit = np.where(diagonal > 0, diagonal, np.inf) ** -0.5
    units = {"slope": unit, "matrix": unit[:, None] * unit}
    apart = {}
    for name in LOOKS:
        by = units.get(name, 1.0)
        length = np.linalg.norm(exact[name] * by)
        comparable = same or name not in ("J", "slope", "matrix")
        off = np.linalg.norm((found[name] - exact[name]) * by)
        apart[name] = float(off / length) if comparable and length > 0 else float("nan")
    return apart


def worked(given: Mapping[str, Arrays], arithmetic: str, device: str) -> dict[str, Arrays]:
    """Fit maps, or look at their lobes, in another process.

    Raises:
        subprocess.CalledProcessError: It failed.
    """
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        source, target = Path(folder) / "given.npz", Path(folder) / "found.npz"
        stored = {f"{name}/{key}": each for name, own in given.items() for key, each in own.items()}
        np.savez(source, **stored)  # pyright: ignore[reportArgumentType]
        words = [sys.executable, "-m", "benchmarks.steps.rounding_worker", arithmetic, device]
        subprocess.run([*words, str(source), str(target)], check=True, cwd=ROOT)
        found: dict[str, Arrays] = {name: {} for name in given}
        with np.load(target) as values:
            for key in values:
                name, _, what = key.rpartition("/")
                found[name][what] = values[key]
    return found


def _lobes(own: Arrays, form: Form) -> Lobes:
    axes, sharpness, amplitude = (
        torch.from_numpy(own[name]).float() for name in ("axes", "sharpness", "amplitude")
    )
    return Lobes(axes, sharpness, amplitude, form)


def table(found: Mapping[str, Figures], head: str) -> str:
    """Return a comparison by map, and the median and the largest of each difference."""
    names = [f"fitted {what}{suffix}" for what in JUDGED for suffix in (" float32", "")]
    lines = [f"| {head} | {' | '.join((*LOOKS, *names))} |"]
    lines.append("|---|" + "--:|" * (len(LOOKS) + len(names)))
    for stem, figures in found.items():
        cells = [f"{figures[name]:.1e}" for name in LOOKS]
        cells += [f"{figures[name]:.5f}" for name in names]
        lines.append(f"| {stem} | {' | '.join(cells)} |")
    for word, pick in (("median", statistics.median), ("largest", max)):
        known = [[each[name] for each in found.values()] for name in LOOKS]
        values = [[value for value in column if value == value] for column in known]
        cells = [f"{pick(column):.1e}" if column else "" for column in values]
        lines.append(f"| {word} | {' | '.join(cells)} |{' |' * len(names)}")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
