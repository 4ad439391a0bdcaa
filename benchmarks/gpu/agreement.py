# SPDX-License-Identifier: Apache-2.0
"""The processor against the device: J, its slope and matrix at the same lobes, and whole fits."""

import math
from collections.abc import Iterator
from itertools import islice

from benchmarks.gpu.data import maps
from benchmarks.gpu.rows import Given, Row
from benchmarks.steps import rounding

MAPS, LOBES, SHORT_LOBES = 3, 15, 3

SAME = {"J": 1e-4, "slope": 1e-2, "matrix": 1e-3}
"""Relative differences at most. Sums of some 10,000 adaptive cells in float32 round by 1e-5. A
slope near an end is a small difference of large ones, and the exponent of a lobe of sharpness
60,000, a polynomial of the direction in float32, rounds by 60,000 * 6e-8 = 3.5e-3. The processor's
compiled steps turn each direction into the lobe's frame first and lose nothing."""

FITTED = 1.5
"""Factor of an error of a fit at most: what rounding alone does (docs/results/bench.md, A gate)."""


def measure(given: Given) -> Iterator[Row]:
    """Compare on a few maps, by `rounding.py`."""
    count, some = (SHORT_LOBES, 1) if given.short else (LOBES, MAPS)
    own = {name: rounding.of_map(each, count) for name, each in islice(maps(given).items(), some)}
    for name, found in rounding.compared(own, "float32", given.device).items():
        # where two cells were as good, other ones were refined: J is of something else there
        apart = {what: found[what] for what in SAME if not math.isnan(found[what])}
        at_most = {what: SAME[what] for what in apart}
        yield Row(f"{name}: relative difference at the same lobes", dict(apart), at_most)
        ratios: dict[str, float | str] = {
            what: (found[f"fitted {what}"] + 1e-4) / (found[f"fitted {what} float32"] + 1e-4)
            for what in rounding.JUDGED
        }
        at_most = {what: FITTED for what in ratios}
        yield Row(f"{name}: error of a fit there over one here", ratios, at_most)
