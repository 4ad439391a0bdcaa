# SPDX-License-Identifier: Apache-2.0
"""Cases by chance, judged: a row for each, and the worst of each kind."""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd

from asglight.images import open_sequence, write_exr
from asglight.usd.options import KeyLights, KeyOptions
from benchmarks.keyed.cases import Case, Quad, cases
from benchmarks.keyed.rows import Row, print_head, print_row, stage_row, written
from benchmarks.keyed.seen import Light, corners, lights


def key_options(options: argparse.Namespace) -> KeyOptions:
    """Return how many keys, and as what, the command asks for."""
    return KeyOptions(options.keys, KeyLights.RECT, options.texture)


def print_synthetic(options: argparse.Namespace, heads: Sequence[str]) -> None:
    """Judge cases by chance, print a row for each, then the worst of each kind and of all."""
    print_head(heads)
    found: list[tuple[Row, float | None]] = []
    for case in cases(options.synthetic, options.seed, options.rows):
        found.append(judged_case(case, options))
        print_row(_case_cells(*found[-1]))
    print()
    print_head(heads)
    kinds = dict.fromkeys(row.name.rsplit(" ", 1)[0] for row, _ in found)
    for kind in [*kinds, ""]:
        of_kind = [one for one in found if one[0].name.startswith(kind)]
        print_row(_case_cells(*_worst(of_kind, kind or "all")))


def _case_cells(row: Row, corners: float | None) -> list[str]:
    return [*row.figures(), "–" if corners is None else f"{corners:.3f}"]


def _worst(found: Sequence[tuple[Row, float | None]], name: str) -> tuple[Row, float | None]:
    rows = [row for row, _ in found]

    def most(values: Sequence[float | None]) -> float | None:
        return max((one for one in values if one is not None), default=None)

    worst = {key: max(row.worst[key] for row in rows) for key in rows[0].worst}
    whole = Row(
        name,
        max(row.keys for row in rows),
        max(row.share for row in rows),
        worst,
        most([row.rim for row in rows]),
        most([row.pump for row in rows]),
        0,
    )
    return whole, most([corners for _, corners in found])


def judged_case(case: Case, options: argparse.Namespace) -> tuple[Row, float | None]:
    """Cut the keys of a case, and judge its stage.

    Returns:
        Its row, and how far corners are off, None where none are known.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        numbers = range(1001, 1001 + len(case.frames))
        for number, image in zip(numbers, case.frames, strict=True):
            write_exr(folder / f"case.{number}.exr", image)
        sequence = open_sequence(folder / "case.####.exr")
        report = written(sequence, key_options(options), folder / "keys.usdc")
        told = report.keys or {}
        row = stage_row(sequence, folder / "keys.usdc", told, report.bytes)
        row = replace(row, name=case.name)
        if not case.quads or options.texture or not told["keys"]:
            return row, None
        stage = Usd.Stage.Open(str(folder / "keys.usdc"))
        texel = np.pi / len(case.frames[0])
        return row, corners_off(lights(stage, numbers[0]), case.quads, texel)


def corners_off(found: Sequence[Light], quads: Sequence[Quad], texel: float) -> float | None:
    """Return how far corners are off, the worst of the lights that stand on a lamp.

    It is over the shorter side of a lamp, or three texels, where that is more.
    """
    worst = None
    for light in found:
        own = corners(light)
        for quad in quads:
            if not quad.covers(own.mean(0)[None])[0]:
                continue
            orders = [np.roll(one, k, 0) for one in (own, own[::-1]) for k in range(4)]
            away = min(
                float(np.arccos(np.clip((one * quad.corners).sum(-1), -1, 1)).max())
                for one in orders
            )
            sides = np.arccos((quad.corners * np.roll(quad.corners, 1, 0)).sum(-1))
            worst = max(worst or 0.0, away / max(float(sides.min()), 3 * texel))
    return worst
