# SPDX-License-Identifier: Apache-2.0
"""Edits of a lobe's light and width by how much, as tests make them."""

import math

from asglight.viewer.state.edits.edit import Edit, Span


def scale_amplitude(
    lobe: int,
    span: Span | None,
    stops: float,
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Edit:
    """Make a lobe brighter by some stops, and multiply its colour by a tint."""
    red, green, blue = (stops + math.log2(factor) for factor in tint)
    return Edit(lobe, span, gain_log2=(red, green, blue))


def scale_sharpness(lobe: int, span: Span | None, along_x: float, along_y: float) -> Edit:
    """Multiply the sharpness along the axes by powers of 2."""
    return Edit(lobe, span, sharpness_log2=(along_x, along_y))
