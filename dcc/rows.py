# SPDX-License-Identifier: Apache-2.0
"""One row a picture: how far it is from where it should be, and whether that is near enough.

Errors are relative root mean squares: sqrt(sum (a - b)^2 / sum b^2) over the judged pixels of both
views and the three channels.

    fit      integral of the lobes against that of the original image: what the fit costs
    export   render of the stage against the integral of the lobes: what the export costs
    reading  render of the stage against the integral of its lights as UsdLux defines them and
             images as the program interpolates them: what the program makes of the stage. The
             export's own part is what lies between
    total    render of the stage against the render of the original image in the same program
    noise    of a render, from the spread of its seeds
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from asglight.usd import Representation

Array = NDArray[np.float64]

NOISE_SHARE = 1 / 3
"""Of the limit: noise adds as squares do, so a third of the limit moves an error by 5 % of it."""


@dataclass(frozen=True)
class Limit:
    """What an error may be.

    Attributes:
        most: Largest allowed.
        of: Which error of a row.
        why: Why it is not the export, where it is not.
    """

    most: float
    of: Literal["export", "reading"] = "export"
    why: str = ""


_BETWEEN = (
    "between texels Cycles interpolates, while the fit takes them for even: how an image of 128 "
    "rows is to be read is no matter of the export"
)
_POLES = (
    "Mitsuba has the first row of an image on the pole, UsdLux and we half a row beside; and its "
    "samples are independent, so there is more noise"
)

LIMITS = {
    ("Blender", "original"): Limit(0.01, "reading", _BETWEEN),
    ("Blender", Representation.DOME): Limit(0.01),
    ("Blender", Representation.CARDS): Limit(0.03),
    ("Mitsuba", "original"): Limit(0.02, "reading", _POLES),
    ("Mitsuba", Representation.DOME): Limit(0.02, "reading", _POLES),
}
"""By program and representation; distant lights are judged one by one instead (`FACING_LIMIT`)."""

FACING_LIMIT = 0.02
"""Of the irradiance on a patch that faces a distant light."""

DIRECTION_LIMIT_DEG = 0.05
"""Blender keeps a light's direction in float32 matrices: 0.02 degrees were seen."""


@dataclass(frozen=True)
class Row:
    """One material of one picture; relative errors, None where there is no such thing."""

    program: str
    sequence: str
    frame: int
    up_axis: str
    representation: str
    material: str
    fit: float | None
    export: float
    mean_export: float
    reading: float
    total: float | None
    noise: float


@dataclass(frozen=True)
class FacingRow:
    """The distant lights of one frame, each by itself on a patch that faces it.

    Attributes:
        program: Which.
        sequence: Of which shot.
        frame: At which frame.
        up_axis: Of the stage.
        narrow: How many lights Blender makes no wider than a hemisphere.
        wide: How many are wider.
        narrow_error: Largest error of their irradiance, divided by 4.
        wide_error: The same of the others, divided by 4 / sin^2(angle).
        direction_deg: Largest angle between light and lobe.
    """

    program: str
    sequence: str
    frame: int
    up_axis: str
    narrow: int
    wide: int
    narrow_error: float
    wide_error: float
    direction_deg: float


def relative_rms(found: Array, expected: Array) -> float:
    """Return sqrt(sum (found - expected)^2 / sum expected^2)."""
    return float(np.sqrt(((found - expected) ** 2).sum() / (expected**2).sum()))


def relative_mean(found: Array, expected: Array) -> float:
    """Return sum |found - expected| / sum expected."""
    return float(np.abs(found - expected).sum() / expected.sum())


def noise(seeds: Array) -> float:
    """Return the relative RMS noise of the mean of S renders, from their spread.  [S, ...]."""
    variance = seeds.var(0, ddof=1) / len(seeds)
    return float(np.sqrt(variance.sum() / (seeds.mean(0) ** 2).sum()))


def limit_of(row: Row) -> Limit | None:
    """Return what holds for a row, for balls of all kinds alike."""
    return LIMITS.get((row.program, row.representation))


def failures(rows: Iterable[Row], facing: Iterable[FacingRow]) -> list[str]:
    """Return what is above its limit, one line each."""
    found = []
    for row in rows:
        limit = limit_of(row)
        if limit is None:
            continue
        name = f"{row.program} {row.sequence} {row.frame} {row.up_axis}-up {row.representation}"
        error = row.reading if limit.of == "reading" else row.export
        if error > limit.most:
            found.append(f"{name} {row.material}: {limit.of} {error:.2%}, above {limit.most:.1%}")
        if row.noise > limit.most * NOISE_SHARE:
            found.append(
                f"{name} {row.material}: noise {row.noise:.2%}, above a third of "
                f"{limit.most:.1%}; expected more --samples"
            )
    for row in facing:
        name = f"{row.program} {row.sequence} {row.frame} {row.up_axis}-up distant"
        for kind, error in (("narrow", row.narrow_error), ("wide", row.wide_error)):
            if error > FACING_LIMIT:
                found.append(f"{name}, {kind}: facing irradiance {error:.2%} off, above 2 %")
        if row.direction_deg > DIRECTION_LIMIT_DEG:
            found.append(f"{name}: a light {row.direction_deg:.3f} degrees off its lobe")
    return found


def as_json(rows: Iterable[Row], facing: Iterable[FacingRow]) -> dict[str, Any]:
    """Return all rows as JSON values."""
    return {"balls": [asdict(row) for row in rows], "facing": [asdict(row) for row in facing]}
