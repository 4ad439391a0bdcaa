# SPDX-License-Identifier: Apache-2.0
"""From spectra and CIE XYZ to linear Rec.709.

The colour matching functions are the multi-lobe fits of Wyman, Sloan and Shirley 2013, "Simple
Analytic Approximations to the CIE XYZ Color Matching Functions"; they need no table.
"""

import torch
from torch import Tensor

# IEC 61966-2-1: CIE XYZ (D65) to linear RGB with the primaries of Rec.709.
_REC709_FROM_XYZ = (
    (3.2406, -1.5372, -0.4986),
    (-0.9689, 1.8758, 0.0415),
    (0.0557, -0.2040, 1.0570),
)


def rec709_from_xyz(xyz: Tensor) -> Tensor:
    """Convert CIE XYZ to linear Rec.709 without white-point adaptation (daylight stays bluish).

    Colours outside the gamut are brought to its edge: a deep red low sun has a blue a little below
    zero, and a light cannot have that.

    Args:
        xyz: Tristimulus values.  [..., 3]

    Returns:
        Linear RGB, >= 0, in the unit of Y.  [..., 3]
    """
    return (xyz @ torch.tensor(_REC709_FROM_XYZ, dtype=xyz.dtype).T).clamp(min=0)


def colour_matching(wavelength: Tensor) -> Tensor:
    """Return the CIE 1931 colour matching functions (Wyman et al. 2013).

    Args:
        wavelength: Nanometres.  [K]

    Returns:
        x, y, z bar.  [K, 3]
    """

    def lobe(peak: float, height: float, below: float, above: float) -> Tensor:
        scale = torch.where(wavelength < peak, below, above)
        return height * torch.exp(-0.5 * ((wavelength - peak) * scale) ** 2)

    x = (
        lobe(442.0, 0.362, 0.0624, 0.0374)
        + lobe(599.8, 1.056, 0.0264, 0.0323)
        + lobe(501.1, -0.065, 0.0490, 0.0382)
    )
    y = lobe(568.8, 0.821, 0.0213, 0.0247) + lobe(530.9, 0.286, 0.0613, 0.0322)
    z = lobe(437.0, 1.217, 0.0845, 0.0278) + lobe(459.0, 0.681, 0.0385, 0.0725)
    return torch.stack([x, y, z], dim=-1)
