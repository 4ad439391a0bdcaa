# SPDX-License-Identifier: GPL-3.0-or-later
"""Linear colour spaces that a stage can name, and matrices between them.

SMPTE RP 177-1993 makes a matrix of the chromaticities of primaries and white; where whites differ,
Bradford's matrix adapts one to the other (Lindbloom, "Chromatic Adaptation"). Blender's own
`Gf.ColorSpace` is not used: USD 25.2 returns colours that are not even linear in the given ones.
"""

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

REC709 = "lin_rec709_scene"

_D65, _ACES = (0.3127, 0.3290), (0.32168, 0.33767)

CHROMATICITIES = {
    REC709: ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), _D65),
    "lin_ap1_scene": ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), _ACES),
    "lin_ap0_scene": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), _ACES),
    "lin_rec2020_scene": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65),
    "lin_p3d65_scene": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
    "lin_adobergb_scene": ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), _D65),
}
"""x, y of red, green, blue and white, by Color Interop ID."""

BLENDER_NAMES = {
    REC709: "Linear Rec.709",
    "lin_ap1_scene": "ACEScg",
    "lin_ap0_scene": "ACES2065-1",
    "lin_rec2020_scene": "Linear Rec.2020",
    "lin_p3d65_scene": "Linear DCI-P3 D65",
}
"""What Blender's configuration calls them; it has no linear Adobe RGB."""

_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def between(source: str, target: str) -> Matrix:
    """Return the matrix that turns colours of one space into those of another.

    Args:
        source: A key of `CHROMATICITIES`.
        target: Another.

    Returns:
        For column vectors.  [3, 3]
    """
    if source == target:
        return np.eye(3)
    white, wanted = (_xyz(CHROMATICITIES[space][3]) for space in (source, target))
    gain = np.diag((_BRADFORD @ wanted) / (_BRADFORD @ white))
    adapted = np.linalg.inv(_BRADFORD) @ gain @ _BRADFORD
    return np.linalg.inv(_to_xyz(target)) @ adapted @ _to_xyz(source)


def _to_xyz(space: str) -> Matrix:
    *primaries, white = CHROMATICITIES[space]
    columns = np.stack([_xyz(one) for one in primaries], axis=1)
    return columns * np.linalg.solve(columns, _xyz(white))


def _xyz(place: tuple[float, float]) -> Matrix:
    x, y = place
    return np.array([x / y, 1.0, (1 - x - y) / y])
