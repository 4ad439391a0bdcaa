# SPDX-License-Identifier: Apache-2.0
"""Histogram and waveform of what the balls or the map show, in stops from middle grey."""

import math

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui, implot

from asglight.viewer.colour import scopes as numbers
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.panels import widgets
from asglight.viewer.state.display import MIDDLE_GREY
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import ScopeKind

WHITE_EV = math.log2(1 / MIDDLE_GREY)
"""Stops of a radiance of 1, where sRGB clips."""

_COLOURS = (ImVec4(1, 0.3, 0.25, 1), ImVec4(0.3, 0.85, 0.35, 1), ImVec4(0.4, 0.55, 1, 1))

_LINE_EV = 4
"""Stops between the lines of a waveform."""


def scopes(state: ViewerState, renderer: Renderer) -> None:
    """Draw the choices and the scope."""
    scope = state.scope
    for name, choice, tip in (
        ("kind", "##kind", "histogram: how much of the picture is how bright. waveform: where."),
        ("place", "##place", "The balls, or the map by solid angle."),
        ("side", "##side", "The fit, or what it is compared with."),
    ):
        imgui.set_next_item_width(widgets.em(7))
        setattr(scope, name, widgets.choice(choice, getattr(scope, name), tip))
        imgui.same_line()
    imgui.new_line()
    found = renderer.scoped(state)
    if found is None:
        imgui.text_disabled("There is nothing to measure.")
        return
    exposure = state.display.exposure_ev + state.environment.intensity_ev
    if scope.kind is ScopeKind.HISTOGRAM:
        _histogram(found.histogram, exposure)
    else:
        _waveform(found.texture, exposure)


def _histogram(shares: np.ndarray, exposure: float) -> None:
    """Plot shares of the picture over stops."""
    if not implot.begin_plot("##histogram", ImVec2(-1, -1), implot.Flags_.no_mouse_text):
        return
    implot.setup_axes(
        "EV from middle grey, exposed", "share of the picture, %", 0, implot.AxisFlags_.auto_fit
    )
    low, high = numbers.STOPS_LOW + exposure, numbers.STOPS_HIGH + exposure
    implot.setup_axis_limits(implot.ImAxis_.x1, -10, 10, implot.Cond_.once)
    implot.setup_axis_limits_constraints(implot.ImAxis_.x1, low, high)
    stops = numbers.centres() + exposure
    for name, colour, share in zip("RGB", _COLOURS, shares, strict=True):
        spec = implot.Spec()
        spec.line_color = colour
        implot.plot_line(name, stops, 100 * share, spec=spec)
    spec = implot.Spec()
    spec.line_color = widgets.ACCENT
    implot.plot_inf_lines("sRGB clips", np.array([WHITE_EV]), spec=spec)
    implot.end_plot()


def _waveform(texture: int, exposure: float) -> None:
    """Show densities, with lines of stops over them."""
    room = imgui.get_content_region_avail()
    size = ImVec2(max(1.0, room.x), max(1.0, room.y))
    origin = imgui.get_cursor_screen_pos()
    imgui.image(imgui.ImTextureRef(texture), size)
    draw = imgui.get_window_draw_list()
    span = numbers.STOPS_HIGH - numbers.STOPS_LOW

    def line(stops: float, colour: int, text: str) -> None:
        y = origin.y + (numbers.STOPS_HIGH + exposure - stops) / span * size.y
        if origin.y <= y <= origin.y + size.y:
            draw.add_line_h(origin.x, origin.x + size.x, y, colour, 1.0)
            widgets.label_over(origin.x + widgets.em(0.3), y, text)

    first = math.ceil((numbers.STOPS_LOW + exposure) / _LINE_EV) * _LINE_EV
    for stops in range(first, first + int(span) + 1, _LINE_EV):
        line(stops, widgets.colour(widgets.FAINT, 0.5), f"{stops:+d} EV" if stops else "0 EV")
    line(WHITE_EV, widgets.colour(widgets.ACCENT), "sRGB clips")
