# SPDX-License-Identifier: Apache-2.0
"""Primaries: from the chromaticities a file states to Rec.709, linearly.

A set of chromaticities is eight numbers, the CIE 1931 x and y of red, green, blue and white, in
the order of OpenEXR's `chromaticities` attribute. The matrix from RGB to XYZ follows SMPTE
RP 177 (1993); a different white is adapted to D65 with the Bradford transform (Lam 1985). Without
a statement OpenEXR means Rec.709.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Chromaticities = tuple[float, float, float, float, float, float, float, float]

REC709: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
KNOWN: dict[str, Chromaticities] = {
    "Rec.709": REC709,
    "ACES AP0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
    "ACEScg (AP1)": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "Rec.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "P3-D65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "DCI-P3": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),
    "Adobe RGB": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290),
    "CIE XYZ": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3),
}
# The linear spaces of the Color Interop Forum that a file may name instead of stating numbers.
INTEROP: dict[str, str] = {
    "lin_rec709_scene": "Rec.709",
    "lin_ap0_scene": "ACES AP0",
    "lin_ap1_scene": "ACEScg (AP1)",
    "lin_rec2020_scene": "Rec.2020",
    "lin_p3d65_scene": "P3-D65",
    "lin_adobergb_scene": "Adobe RGB",
}

# Writers round to three or four decimals: 0.0005 each way, for the file and for the table.
ROUNDING = 0.001
# Area of the triangle of primaries, in the xy plane, below which three colours are one line.
AREA_MIN = 1e-4
_BRADFORD = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))


@dataclass(frozen=True)
class ColourSpace:
    """What the numbers of an image mean, and who says so.

    Attributes:
        name: As a user is told.
        said_by: The attribute, line or option that says so; empty where nothing does.
        chromaticities: Primaries and white of a linear space that is given by numbers.
        config_name: OpenColorIO's name of a space that is given by name. With neither of the two
            the numbers are linear Rec.709.
    """

    name: str
    said_by: str = ""
    chromaticities: Chromaticities | None = None
    config_name: str | None = None

    @property
    def is_rec709(self) -> bool:
        """True where nothing has to be converted."""
        return self.chromaticities is None and self.config_name is None

    def sentence(self) -> str:
        """Say which space it is, and who says so."""
        return f"{self.name} ({self.said_by or 'assumed: the file states nothing'})"


ASSUMED = ColourSpace("linear Rec.709")
"""What a file means that states nothing, as OpenEXR has it."""


def is_colour_space(chromaticities: Chromaticities) -> bool:
    """Say whether the numbers can be primaries: finite, not on one line, with a white of Y > 0."""
    if not all(map(math.isfinite, chromaticities)) or chromaticities[7] <= 0:
        return False
    rx, ry, gx, gy, bx, by, _, _ = chromaticities
    return abs((gx - rx) * (by - ry) - (bx - rx) * (gy - ry)) / 2 >= AREA_MIN


def name_of(chromaticities: Chromaticities) -> str:
    """Return the name of known primaries, else their numbers."""
    for name, known in KNOWN.items():
        if all(abs(a - b) <= ROUNDING for a, b in zip(chromaticities, known, strict=True)):
            return name
    return "primaries " + " ".join(f"{value:.4g}" for value in chromaticities)


def to_rec709(chromaticities: Chromaticities) -> NDArray[np.float64]:
    """Return the matrix from linear RGB of these primaries to linear Rec.709.

    White goes to white: (1, 1, 1) is kept whatever the two white points are.

    Args:
        chromaticities: Primaries that `is_colour_space` accepts.

    Returns:
        Matrix for column vectors.  [3, 3]
    """
    source, target = _to_xyz(chromaticities), _to_xyz(REC709)
    bradford = np.array(_BRADFORD)
    gain = (bradford @ target.sum(axis=1)) / (bradford @ source.sum(axis=1))
    adapt = np.linalg.solve(bradford, gain[:, None] * bradford)
    return np.linalg.solve(target, adapt @ source)


def luminance_weights(chromaticities: Chromaticities) -> NDArray[np.float64]:
    """Return how much red, green and blue of 1 add to a luminance of 1 of their white.  [3]."""
    return _to_xyz(chromaticities)[1]


def _to_xyz(chromaticities: Chromaticities) -> NDArray[np.float64]:
    """Return the matrix from RGB to XYZ, scaled so that white has Y = 1.  [3, 3]."""
    xy = np.array(chromaticities, dtype=np.float64).reshape(4, 2)
    # Columns (x, y, 1 - x - y) are XYZ up to a scale; no division by y, which may be 0 (XYZ files).
    columns = np.vstack([xy.T, 1 - xy.sum(axis=1)])  # [3, 4]
    white = columns[:, 3] / columns[1, 3]
    return columns[:, :3] * np.linalg.solve(columns[:, :3], white)
