# SPDX-License-Identifier: Apache-2.0
"""How bright a colour is to the eye."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Of linear Rec.709 red, green and blue of 1 each [ITU-R BT.709-6, table 3]."""


def luminance(radiance: "Tensor") -> "Tensor":
    """Return the luminance of linear Rec.709.  [..., 3] -> [...]."""
    return radiance @ radiance.new_tensor(LUMINANCE)
