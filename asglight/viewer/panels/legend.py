# SPDX-License-Identifier: Apache-2.0
"""The line below a picture: its exposure, and the scale of false colour or of differences."""

from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.viewer.gl.display_pass import DIVERGING_SCALE, STOPS_SCALE, scale_colours
from asglight.viewer.panels import widgets
from asglight.viewer.state.display import (
    FALSE_COLOUR_EV,
    MIDDLE_GREY,
    RATIO_EV,
    Comparison,
    Subject,
    ViewTransform,
)
from asglight.viewer.state.viewer_state import ViewerState

_STEPS = 64

HEIGHT_EM = 1.5
"""Heights of the font."""

BAR_EM = 24.0
"""Length of a scale at most: numbers on it stay apart."""


def room_below() -> float:
    """Return the height in points of the line below a picture, with or without a scale.

    It is always there: a view that took room from the picture would shade the balls anew.
    """
    return widgets.em(HEIGHT_EM)


def legend(state: ViewerState, shown: Comparison, origin: ImVec2, width: float) -> None:
    """Draw the line below a picture: how it is exposed, and the scale that it uses, if any.

    Args:
        state: The session.
        shown: What the picture shows of fit and reference.
        origin: Where the line begins, in points.
        width: Its width.
    """
    exposure = state.display.exposure_ev + state.environment.intensity_ev
    draw = imgui.get_window_draw_list()
    top = origin.y + widgets.em(0.2)
    faint = widgets.ink(0.65)
    found = scale_of(state, shown)
    if found is None or width > widgets.em(2 * BAR_EM):
        text = f"{state.display.name}  {exposure:+.1f} EV"
        draw.add_text(ImVec2(origin.x, top), faint, text)
    if found is None:
        return
    name, title, numbers = found
    length = min(widgets.em(BAR_EM), 0.55 * width)
    left = origin.x + width - length - widgets.em(1.2)  # half of a number stands out
    title_width = imgui.calc_text_size(title).x
    draw.add_text(ImVec2(left - title_width - widgets.em(1.8), top), faint, title)
    colours = scale_colours(name) / 255
    for step in range(_STEPS):
        red, green, blue = map(float, colours[round((step + 0.5) / _STEPS * 255)])
        # On whole points: antialiased edges would show as lines.
        begin, end = (round(left + share / _STEPS * length) for share in (step, step + 1))
        shade = imgui.get_color_u32(ImVec4(red, green, blue, 1))
        draw.add_rect_filled(ImVec2(begin, top), ImVec2(end, top + widgets.em(1.1)), shade)
    for share, number in numbers:
        widgets.label_over(left + share * length, top, number, align=0.5)


def scale_of(
    state: ViewerState, shown: Comparison
) -> tuple[str, str, list[tuple[float, str]]] | None:
    """Return the scale that a picture uses.

    Args:
        state: The session.
        shown: What the picture shows of fit and reference.

    Returns:
        Its name, its title, and its numbers with their places in [0, 1]; None if it
        uses none.
    """
    exposure = state.display.exposure_ev + state.environment.intensity_ev
    is_b = state.subject is Subject.AGAINST
    first, second = ("A", "B") if is_b else ("fit", "reference")
    if shown is Comparison.DIFFERENCE:
        unit = 2.0**-exposure
        numbers = [(share, f"{(2 * share - 1) * unit:+.3g}") for share in (0.0, 0.25, 0.75, 1.0)]
        return DIVERGING_SCALE, f"{first} - {second}, radiance", [*numbers, (0.5, "0")]
    if shown is Comparison.RATIO:
        stops = range(-int(RATIO_EV), int(RATIO_EV) + 1)
        places = [(0.5 + stop / (2 * RATIO_EV), f"{stop:+d}" if stop else "0") for stop in stops]
        return DIVERGING_SCALE, f"{first} / {second}, EV", places
    if state.display.transform is ViewTransform.FALSE_COLOUR:
        stops = range(-int(FALSE_COLOUR_EV), int(FALSE_COLOUR_EV) + 1, 2)
        places = [
            (0.5 + stop / (2 * FALSE_COLOUR_EV), f"{stop:+d}" if stop else "0") for stop in stops
        ]
        return STOPS_SCALE, f"EV from {MIDDLE_GREY}, exposed", places
    return None
