# SPDX-License-Identifier: Apache-2.0
"""Where the ridge of the last solution for the light acts: with it, and without, on every map.

    python -m benchmarks.steps.ridge --maps ../shared/hdri

Each map is fitted (`fast`). The fit's last step, the amplitudes alone (light.py), is then done
again from its own input with the ridge and with one a millionth as large, which is none but for
float64's rounding. Lobes that stand in for others are told apart by `condition.trades`.
"""

import statistics
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from unittest import mock

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import light
from asglight.fitting.steps.condition import LIMIT, trades
from asglight.lobes import asg
from benchmarks.given import maps_given

NO_RIDGE = 1e-6 * light.RIDGE

Row = tuple[str, int, float, int, float, float]
"""Map; lobes apart, largest change of one; lobes that trade, largest change of one; of all light.

A change is that of an amplitude relative to the lobe's brightest channel."""


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map, print a table."""
    maps = maps_given("ridge", __doc__, argv)
    rows = [measured(name, radiance) for name, radiance in maps.items()]
    print(table(rows))
    return 0


def measured(name: str, reference: Tensor) -> Row:
    """Return what the ridge changes in the fit of a map.  [H, 2 H, 3]."""
    given: list[tuple[lobe_images.Images, objective.Target]] = []
    own = light.solve_amplitudes

    def noted(
        shown: lobe_images.Images, frame: objective.Target, still: Tensor | None = None
    ) -> object:
        given.append((shown, frame))
        return own(shown, frame, still)

    with mock.patch.object(light, "solve_amplitudes", noted):
        fit_frame(reference, FitOptions(), None)
    shown, frame = given[-1]
    found = own(shown, frame).lobes[0]
    with without_ridge():
        free = own(shown, frame).lobes[0]
    traded = torch.zeros(found.count, dtype=torch.bool)
    for pair in trades(found, LIMIT):
        traded[list(pair.lobes)] = True
    brightest = free.amplitude.amax(-1).clamp(min=1e-30)
    change = (found.amplitude - free.amplitude).abs().amax(-1) / brightest
    flux = asg.flux(found.to(torch.float64)).sum() / asg.flux(free.to(torch.float64)).sum()
    apart = ~traded & (free.amplitude.amax(-1) > 0)
    return (
        name,
        int(apart.sum()),
        float(change[apart].max()) if bool(apart.any()) else 0.0,
        int(traded.sum()),
        float(change[traded].max()) if bool(traded.any()) else 0.0,
        abs(float(flux) - 1),
    )


@contextmanager
def without_ridge() -> Iterator[None]:
    """Solve with a ridge that is none."""
    with mock.patch.object(light, "RIDGE", NO_RIDGE):
        yield


def table(rows: Sequence[Row]) -> str:
    """Return a row a map, and the median and largest of each change."""
    lines = ["| map | lobes apart | largest change | lobes that trade | largest change | of flux |"]
    lines.append("|---|--:|--:|--:|--:|--:|")
    for name, apart, change, traded, theirs, flux in rows:
        lines.append(f"| {name} | {apart} | {change:.1e} | {traded} | {theirs:.1e} | {flux:.1e} |")
    changes = [(change, theirs, flux) for _, _, change, _, theirs, flux in rows]
    for word, pick in (("median", statistics.median), ("largest", max)):
        change, theirs, flux = map(pick, zip(*changes, strict=True))
        lines.append(f"| {word} | | {change:.1e} | | {theirs:.1e} | {flux:.1e} |")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
