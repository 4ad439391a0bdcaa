# SPDX-License-Identifier: Apache-2.0
"""What panels share: keys, tooltips, choices, labels over pictures."""

from collections.abc import Sequence
from enum import StrEnum
from typing import TypeVar

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.viewer.state.commands import COMMANDS, Command, command
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import ListRoom

E = TypeVar("E", bound=StrEnum)

ACCENT = ImVec4(1.0, 0.62, 0.18, 1.0)
"""What is selected, and the playhead: orange, which no scale of the pictures uses."""

FAINT = ImVec4(1.0, 1.0, 1.0, 0.45)
"""What is there but not selected."""

_EVERYWHERE = int(imgui.InputFlags_.route_global)
_REPEAT = int(imgui.InputFlags_.repeat)
_SPECIAL_KEYS = {
    "Left": imgui.Key.left_arrow,
    "Right": imgui.Key.right_arrow,
    "[": imgui.Key.left_bracket,
    "]": imgui.Key.right_bracket,
    "0": imgui.Key._0,
}
_MODIFIERS = {"Ctrl": imgui.Key.mod_ctrl, "Shift": imgui.Key.mod_shift}


def chord(keys: str) -> int:
    """Return what Dear ImGui calls a key with its modifiers: `Ctrl+Shift+Z`."""
    *modifiers, name = keys.split("+")
    key = _SPECIAL_KEYS.get(name) or getattr(imgui.Key, name.lower())
    # As integers: joining the enums themselves fails on Python 3.11.2.
    result = int(key)
    for modifier in modifiers:
        result |= int(_MODIFIERS[modifier])
    return result


def handle_keys(state: ViewerState, flip_key: str) -> None:
    """Run the commands whose keys are pressed.

    Text fields keep their keys, and so does what has to be answered first. Escape closes what
    stands open - a menu, a list, a picker, the list of keys - before it means anything else.
    """
    if imgui.internal.get_top_most_popup_modal() is not None:
        return
    was_closed = imgui.is_key_pressed(imgui.Key.escape, False) and _close_topmost(state)
    for entry in COMMANDS:
        if was_closed and entry.keys == "Escape":
            continue
        flags = _EVERYWHERE | (_REPEAT if entry.repeats else 0)
        if imgui.shortcut(chord(entry.keys), flags):
            entry.run(state)
    is_typing = imgui.get_io().want_text_input
    is_flipped = not is_typing and imgui.is_key_down(imgui.Key(chord(flip_key)))
    state.compared.is_flipped = state.map_view.is_flipped = is_flipped


def _close_topmost(state: ViewerState) -> bool:
    """Close the popup that was opened last, else the list of keys; tell whether there was one."""
    popups = len(list(imgui.get_current_context().open_popup_stack))
    if popups:
        imgui.internal.close_popup_to_level(popups - 1, True)
        return True
    was_open, state.has_help = state.has_help, False
    return was_open


def em(count: float) -> float:
    """Return a length in points, in heights of the font: it follows the screen's density."""
    return count * imgui.get_font_size()


def tooltip(text: str, keys: str = "") -> None:
    """Explain the last widget, with its key."""
    if not imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        return
    # Over the widget, so that the next one below stays in view.
    text = f"{text}\nKey: {keys}" if keys else text
    corner, size = imgui.get_item_rect_min(), imgui.calc_text_size(text)
    if corner.y > size.y + em(1.5):
        padding = 2 * imgui.get_style().window_padding.x
        view = imgui.get_main_viewport()
        right = view.pos.x + view.size.x - size.x - padding
        place = ImVec2(max(view.pos.x, min(corner.x, right)), corner.y - em(0.3))
        imgui.set_next_window_pos(place, imgui.Cond_.always, ImVec2(0, 1))
    imgui.set_tooltip(text)


def button(
    state: ViewerState, name: str, label: str, explanation: str = "", width: float = 0.0
) -> None:
    """Show a button that runs a command; a width in em keeps what follows where it is."""
    entry = command(name)
    if imgui.button(label, ImVec2(em(width), 0)):
        entry.run(state)
    tooltip(explanation or f"{entry.name}.", entry.keys)


def checkbox(label: str, value: bool, entry: Command, explanation: str) -> bool:
    """Show a switch that a command's key turns as well."""
    _, value = imgui.checkbox(label, value)
    tooltip(explanation, entry.keys)
    return value


def choice(label: str, value: E, explanation: str, keys: str = "", members: Sequence[E] = ()) -> E:
    """Show a drop-down list of an enum's members, or of some of them."""
    members = members or list(type(value))
    _, place = imgui.combo(label, members.index(value), [str(member) for member in members])
    tooltip(explanation, keys)
    return members[place]


def one_of(label: str, value: str, members: Sequence[str], explanation: str) -> str:
    """Show a drop-down list of names."""
    _, place = imgui.combo(label, members.index(value), list(members))
    tooltip(explanation)
    return members[place]


def slider(
    label: str,
    value: float,
    limits: tuple[float, float],
    unit: str,
    explanation: str,
    keys: str = "",
    decimals: int = 1,
) -> tuple[bool, float]:
    """Show a slider; Ctrl+click takes a number.

    Returns:
        Whether the value changed, and the value.
    """
    if abs(value) < 0.5 * 10.0**-decimals:
        value = 0.0  # and not -0
    changed, value = imgui.slider_float(
        label, value, *limits, f"%.{decimals}f {unit}".rstrip(), imgui.SliderFlags_.clamp_on_input
    )
    tooltip(f"{explanation}\nCtrl+click: type a number", keys)
    return changed, value


def split(room: ListRoom, top: float, height: float) -> None:
    """Show the lower edge of a list, to be dragged; a double click lets it find its own place.

    Args:
        room: Takes the list's share.
        top: Of the list, in points of the screen.
        height: Of the panel.
    """
    imgui.invisible_button("##split", ImVec2(-1, em(0.5)))
    tooltip("Drag: height of the list. Double click: as high as fits")
    corner, end = imgui.get_item_rect_min(), imgui.get_item_rect_max()
    is_held = imgui.is_item_active() or imgui.is_item_hovered()
    middle, strength = (corner.y + end.y) / 2, 0.6 if is_held else 0.2
    imgui.get_window_draw_list().add_line(
        ImVec2(corner.x, middle), ImVec2(end.x, middle), ink(strength), 2.0
    )
    if is_held:
        imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ns)
    moved = imgui.get_io().mouse_delta.y
    if imgui.is_item_active() and moved:
        points = corner.y - imgui.get_style().item_spacing.y - top + moved
        room.share = max(0.1, min(0.9, points / height))
    if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
        room.share = None


def line(name: str, text: str, is_selected: bool) -> bool:
    """Show a line of a list, whatever it says: a label would end before `##`.

    Returns:
        Whether it was clicked, once or twice.
    """
    flags = int(imgui.SelectableFlags_.span_all_columns) | int(
        imgui.SelectableFlags_.allow_double_click
    )
    clicked, _ = imgui.selectable(name, is_selected, flags)
    imgui.same_line(0, 0)
    imgui.text(text)
    return clicked


def ink(alpha: float) -> int:
    """Return the colour of the theme's text, more or less faint, as draw lists take it."""
    text = imgui.get_style_color_vec4(imgui.Col_.text)
    return imgui.get_color_u32(ImVec4(text.x, text.y, text.z, alpha))


def wants_reset() -> bool:
    """Tell whether the last widget was right-clicked."""
    return imgui.is_item_clicked(imgui.MouseButton_.right)


def colour(vector: ImVec4, alpha: float = 1.0) -> int:
    """Return a colour as draw lists take it."""
    return imgui.get_color_u32(ImVec4(vector.x, vector.y, vector.z, vector.w * alpha))


def hues(amplitudes: np.ndarray) -> list[tuple[float, float, float]]:
    """Return the colours of lights without their strength, for sRGB.

    Args:
        amplitudes: Linear RGB.  [N, 3]
    """
    peaks = np.maximum(amplitudes.max(-1, keepdims=True), 1e-30)  # 1e-30: a dark lobe is black
    shown = (np.clip(amplitudes / peaks, 0, 1) ** (1 / 2.2)).tolist()
    return [(red, green, blue) for red, green, blue in shown]


def cross(x: float, y: float) -> None:
    """Mark a place of a picture, visible on bright and dark."""
    draw, arm = imgui.get_window_draw_list(), em(0.6)
    for shade, width in ((ImVec4(0, 0, 0, 0.85), 3.0), (ACCENT, 1.0)):
        ink_ = imgui.get_color_u32(shade)
        draw.add_line(ImVec2(x - arm, y), ImVec2(x + arm, y), ink_, width)
        draw.add_line(ImVec2(x, y - arm), ImVec2(x, y + arm), ink_, width)


def label_over(x: float, y: float, text: str, align: float = 0.0) -> None:
    """Write over a picture, readable on bright and dark, aligned 0 left to 1 right of x."""
    draw = imgui.get_window_draw_list()
    x -= align * imgui.calc_text_size(text).x
    draw.add_text(ImVec2(x + 1, y + 1), imgui.get_color_u32(ImVec4(0, 0, 0, 0.85)), text)
    draw.add_text(ImVec2(x, y), imgui.get_color_u32(ImVec4(1, 1, 1, 0.92)), text)
