# SPDX-License-Identifier: Apache-2.0
"""The constants that Python and GLSL share, injected into every shader."""

from collections.abc import Mapping

from asglight import shader_files
from asglight.shading.glsl_constants import CONSTANTS
from asglight.viewer.state.display import (
    FALSE_COLOUR_EV,
    MIDDLE_GREY,
    RATIO_EV,
    Channel,
    Comparison,
    ViewTransform,
)
from asglight.viewer.state.viewer_state import MAX_LOBES, SHEETS_MAX

DEFINES: Mapping[str, float] = {
    "MAX_LOBES": MAX_LOBES,
    "MAX_SHEETS": SHEETS_MAX,
    **CONSTANTS,
    "MIDDLE_GREY": MIDDLE_GREY,
    "FALSE_COLOUR_EV": FALSE_COLOUR_EV,
    "RATIO_EV": RATIO_EV,
    **shader_files.enum_defines(ViewTransform),
    **shader_files.enum_defines(Channel),
    **shader_files.enum_defines(Comparison),
}
"""The constants that Python and GLSL share."""

SURROUND = (0.16, 0.16, 0.16)
"""sRGB around the balls: dark and neutral, so that neither edge nor colour of a ball is misread."""
