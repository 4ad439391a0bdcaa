# SPDX-License-Identifier: Apache-2.0
"""From the numbers of a file to linear Rec.709: a curve where they are encoded, and a matrix."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from asglight.images import colour, ocio
from asglight.images.decoding import luminance_chroma
from asglight.images.decoding.header import Header
from asglight.images.infinite import HALF_MAX

CURVE_MAX = 1e38
"""What a curve makes at most: a third of float32's end, so that means of it do not pass that."""

WHITE = 1.0
"""The largest number of an encoded space that any display shows."""

Curve = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Takes [H, W, 3] to [H, W, 3]."""


@dataclass(frozen=True)
class Linearisation:
    """What makes the numbers of a file linear Rec.709.

    Attributes:
        curve: Taken first; None where the numbers are in proportion to light.
        matrix: Taken then, for column vectors; None for none.  [3, 3]
        brightest: What an infinite number of the file stands for, at least.
    """

    curve: Curve | None = None
    matrix: NDArray[np.float64] | None = None
    brightest: float = HALF_MAX

    def bent(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return values after the curve, where there is one.  [H, W, 3]."""
        if self.curve is None:
            return values
        with np.errstate(over="ignore", invalid="ignore"):  # what is NaN stays NaN
            made = self.curve(values)
        return np.clip(made, -CURVE_MAX, CURVE_MAX).astype(np.float32)


def linearisation_of(header: Header) -> Linearisation:
    """Return what makes the numbers of an image linear Rec.709.

    What has been multiplied in (EXPOSURE, COLORCORR) is divided out after GAMMA is undone, before
    the primaries are converted.
    """
    space, curve = header.colour, None
    scale = np.diag(1 / np.array(header.multiplier))
    matrix, brightest = scale, HALF_MAX
    if header.layer.kind == "luminance-chroma":
        curve = partial(luminance_chroma.to_rgb, chromaticities=header.luminance_of)
    if header.gamma != 1:
        curve, brightest = partial(_power, exponent=header.gamma), WHITE
    if space.config_name is not None and not ocio.is_linear(space.config_name):
        curve = _after(curve, partial(ocio.converted, source=space.config_name))
        brightest = WHITE
    elif space.config_name is not None:
        matrix = ocio.matrix(space.config_name, ocio.REC709) @ scale
    elif space.chromaticities is not None:
        matrix = colour.to_rec709(space.chromaticities) @ scale
    is_plain = np.array_equal(matrix, np.eye(3))
    return Linearisation(curve, None if is_plain else matrix, brightest)


def _after(first: Curve | None, then: Curve) -> Curve:
    """Return two curves as one."""
    return then if first is None else lambda values: then(first(values))


def _power(values: NDArray[np.float32], exponent: float) -> NDArray[np.float32]:
    """Raise values to an exponent; the sign stays."""
    raised = np.sign(values) * np.abs(values.astype(np.float64)) ** exponent
    return raised.astype(np.float32)
