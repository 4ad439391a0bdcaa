# SPDX-License-Identifier: Apache-2.0
"""What the selected lobe is, in degrees, stops and colours, to be dragged or typed."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from imgui_bundle import ImVec2, imgui

from asglight.lobes import Form
from asglight.usd.lights.colour_temperature import KELVIN_LIMITS, rgb_of
from asglight.viewer.panels import widgets
from asglight.viewer.state.display import EXPOSURE_EV_MAX
from asglight.viewer.state.edits.absolute import Lamp, lamp_of
from asglight.viewer.state.edits.editing import SOFT_MAX, Scope
from asglight.viewer.state.edits.hue import SATURATION_MAX, hue_of, with_hue
from asglight.viewer.state.viewer_state import ViewerState

_TINT_LIMITS = (-3.0, 3.0)
"""Stops of green: beyond them a light is magenta or green and no lamp."""


class _Field(NamedTuple):
    """A number of a lobe, its unit, its decimals, what it can be, what it is."""

    name: str
    unit: str
    decimals: int
    limits: tuple[float, float]
    explanation: str


_OPEN = imgui.TreeNodeFlags_.default_open

_STOPS = (-EXPOSURE_EV_MAX, EXPOSURE_EV_MAX)

_FIELDS = (
    _Field("azimuth", "deg", 1, (-180.0, 180.0), "Degrees around +Y: 0 at +Z, 90 at +X."),
    _Field("elevation", "deg", 1, (-90.0, 90.0), "Degrees above the horizon."),
    _Field("roll", "deg", 1, (-180.0, 180.0), "Degrees by which it is turned about its direction."),
    _Field("width", "deg", 2, (0.1, 180.0), "Full angle at half of the peak, across."),
    _Field("height", "deg", 2, (0.1, 180.0), "Full angle at half of the peak, the other way."),
    _Field("intensity", "EV", 2, _STOPS, "Stops of the peak from middle grey, 0.18."),
)

_KEY_FIELDS = (
    *_FIELDS[:3],
    _Field("width", "deg", 2, (0.1, 130.0), "Full angle of the rectangle, across."),
    _Field("height", "deg", 2, (0.1, 130.0), "Full angle of the rectangle, the other way."),
    _Field("intensity", "EV", 2, _STOPS, "Stops of the rectangle from middle grey, 0.18."),
)
"""The same of keys."""


def edit_controls(state: ViewerState) -> None:
    """Draw the controls of the selected lobes, and under them those of all edits."""
    selected = state.selected
    none = f"No {'key' if state.history.are_keys else 'lobe'} selected"
    title = state.lobe_names[selected[0]] if selected else none
    if len(selected) > 1:
        title += f" and {len(selected) - 1} more, which change alike"
    _buttons(state)
    imgui.separator_text(title)
    if selected:
        imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(widgets.em(0.3), 1))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, ImVec2(widgets.em(0.3), 3))
        _controls(state, selected[0])
        imgui.pop_style_var(2)


def _buttons(state: ViewerState) -> None:
    """Show what is done with the list and with all edits."""
    widgets.button(state, "Undo", "undo")
    imgui.same_line()
    widgets.button(state, "Redo", "redo")
    imgui.same_line()
    place = "where the pointer was last in the map or on a ball"
    kind = "square key" if state.history.are_keys else "lobe"
    widgets.button(state, "Add a lobe at the pointer", "add", f"Add a {kind} {place}.")
    imgui.same_line()
    imgui.begin_disabled(not state.selected)
    widgets.button(state, "Delete the selected lobe", "delete")
    imgui.end_disabled()
    imgui.same_line()
    imgui.begin_disabled(not state.history.is_changed)
    explanation = "Write the edits as a layer over the stage, which stays as it is."
    widgets.button(state, "Save the edits as a layer", "save layer...", explanation)
    imgui.end_disabled()


def _scope(state: ViewerState) -> None:
    """Choose where an edit holds."""
    editing = state.editing
    editing.scope = widgets.choice(
        "frames",
        editing.scope,
        "Where an edit holds: in every frame, in the shown one, or from the in to the out point.",
    )
    if editing.scope is not Scope.RANGE:
        return
    changed, soft = imgui.slider_int(
        "soft ends", editing.soft, 0, SOFT_MAX, "%d frames", imgui.SliderFlags_.clamp_on_input
    )
    widgets.tooltip("Frames over which the edit comes before the in point and goes after the out.")
    if changed:
        editing.soft = soft
    if not editing.reaches(state.moment):
        imgui.text_disabled("Go between in and out to edit.")


def _controls(state: ViewerState, lobe: int) -> None:
    is_key = state.history.are_keys
    lamp = lamp_of(state.lobes[lobe], is_key=is_key)

    def fitted() -> Lamp:  # wanted where a control is reset, which is seldom
        return lamp_of(state.fitted_lobe(lobe), is_key=is_key)

    imgui.push_item_width(-widgets.em(6.5))
    _scope(state)
    is_black = not math.isfinite(lamp.intensity)
    if is_black:
        imgui.text_disabled("It gives no light in this frame.")
    reaches = state.editing.reaches(state.moment)
    imgui.begin_disabled(is_black or state.playback.is_between or not reaches)
    if imgui.collapsing_header("place and size", _OPEN):
        _numbers(state, lamp, fitted, _KEY_FIELDS[:-1] if is_key else _FIELDS[:-1])
    if imgui.collapsing_header("light and colour", _OPEN):
        _numbers(state, lamp, fitted, _KEY_FIELDS[-1:] if is_key else _FIELDS[-1:])
        _radiance(state, lamp)
        _colour(state, lamp, fitted)
    imgui.end_disabled()
    imgui.pop_item_width()


def _numbers(
    state: ViewerState, lamp: Lamp, fitted: Callable[[], Lamp], fields: Sequence[_Field]
) -> None:
    """Show numbers of a lobe as sliders."""
    first = "cut" if state.history.are_keys else "fitted"
    is_round = state.tracks.lobes.form is Form.SG
    for field in fields:
        if is_round and field.name in ("roll", "height"):
            continue
        changed, value = widgets.slider(
            field.name,
            getattr(lamp, field.name),
            field.limits,
            field.unit,
            f"{field.explanation}\nRight click: as it was {first}",
            decimals=field.decimals,
        )
        _live(state, changed, field.name, value)
        if widgets.wants_reset():
            _set(state, field.name, getattr(fitted(), field.name))
            state.editing.commit(state.history)


def _radiance(state: ViewerState, lamp: Lamp) -> None:
    changed, value = imgui.input_float(
        "radiance", lamp.radiance, 0, 0, "%.4g", imgui.InputTextFlags_.enter_returns_true
    )
    widgets.tooltip("The same as a number: luminance, linear. Type it and press Enter")
    if changed and value > 0:
        _set(state, "intensity", lamp.intensity + math.log2(value / lamp.radiance))
        state.editing.commit(state.history)


def _colour(state: ViewerState, lamp: Lamp, fitted: Callable[[], Lamp]) -> None:
    peak = max(lamp.colour)
    shown = [channel / peak for channel in lamp.colour]
    changed, colour = imgui.color_edit3("colour", shown, int(imgui.ColorEditFlags_.float))
    widgets.tooltip(
        "Linear RGB, the largest 1; the intensity stays.\nRight click: as it was fitted"
    )
    _live_colour(state, changed, lambda: colour)
    if widgets.wants_reset():
        _set_colour(state, fitted().colour)
        state.editing.commit(state.history)
    hue, saturation = hue_of(lamp.colour)
    changed, hue = widgets.slider(
        "hue", hue, (0.0, 360.0), "deg", "0 red, 120 green, 240 blue.", decimals=0
    )
    _live_colour(state, changed, lambda: with_hue(lamp.colour, hue=hue))
    changed, saturation = widgets.slider(
        "saturation", saturation, (0.0, SATURATION_MAX), "", "0 is grey.", decimals=3
    )
    _live_colour(state, changed, lambda: with_hue(lamp.colour, saturation=saturation))
    kelvin, tint = lamp.kelvin, lamp.tint
    changed, kelvin = widgets.slider(
        "temperature", kelvin, KELVIN_LIMITS, "K", "Colour of a black body, as in USD.", decimals=0
    )
    _live_colour(state, changed, lambda: rgb_of(kelvin, lamp.tint))
    changed, tint = widgets.slider(
        "tint", tint, _TINT_LIMITS, "stops", "Magenta to green, beside the temperature.", decimals=2
    )
    _live_colour(state, changed, lambda: rgb_of(lamp.kelvin, tint))


def _live(state: ViewerState, changed: bool, field: str, value: float) -> None:
    """Show an edit while its control moves; when it is let go, make it one step of the history."""
    if changed:
        _set(state, field, value)
    if imgui.is_item_deactivated_after_edit():
        state.editing.commit(state.history)


def _live_colour(
    state: ViewerState, changed: bool, colour: Callable[[], list[float] | tuple[float, ...]]
) -> None:
    if changed:
        _set_colour(state, colour())
    if imgui.is_item_deactivated_after_edit():
        state.editing.commit(state.history)


def _set(state: ViewerState, field: str, value: float) -> None:
    state.editing.set_value(state.history, state.selected, state.moment, field, value)


def _set_colour(state: ViewerState, colour: list[float] | tuple[float, ...]) -> None:
    state.editing.set_colour(state.history, state.selected, state.moment, colour)
