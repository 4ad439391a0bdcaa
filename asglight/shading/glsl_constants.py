# SPDX-License-Identifier: Apache-2.0
"""The constants that shaders/lib needs to evaluate and shade lobes, named as there."""

from collections.abc import Mapping

from asglight.lobes import Form
from asglight.shader_files import enum_defines
from asglight.shading import ggx_layer, ggx_lobes, occlusion
from asglight.shading.sheets import Window

_GGX_LAYER = (
    "ROUGHNESS_MIN",
    "ROUGHNESS_MAX",
    "SHARE_MIN",
    "HALF_MIN",
    "UNSHARP_MIN",
    "GAIN_REACH",
)

_GGX_LOBES = (
    *("COS_VIEW_MIN", "SIN_VIEW_MIN", "OPPOSITE_MIN", "PROBABILITY_MIN"),
    *("COS_LIGHT_MIN", "DISC_A", "DISC_B", "DISC_C"),
)

_OCCLUSION = (
    *("POWER_MIN", "AREA_MIN", "BROAD_VARIANCE", "EDGE_Z_MIN", "LIGHT_MIN", "SQUARE_ELLIPSE"),
    *("RATIO_LOW", "RATIO_HIGH", "WIDE_LOW", "WIDE_HIGH", "CIRCLE_VARIANCE", "SEEN_MIN"),
)

CONSTANTS: Mapping[str, float] = {
    "BROAD_TERMS": ggx_lobes.TERMS,
    **{name: getattr(ggx_layer, name) for name in _GGX_LAYER},
    **{name: getattr(ggx_lobes, name) for name in _GGX_LOBES},
    **{name: getattr(occlusion, name) for name in _OCCLUSION},
    **enum_defines(Form),
    **enum_defines(Window),
}
"""For `#define`; an integer stays one in GLSL."""
