# SPDX-License-Identifier: Apache-2.0
"""The controls: each function draws one and changes the state; none draws with OpenGL itself."""

from imgui_bundle import imgui

from asglight.viewer.state import (
    EXPOSURE_EV_MAX,
    EXPOSURE_EV_STEP,
    Display,
    ToneCurve,
    ViewerState,
)

_EVERYWHERE = int(imgui.InputFlags_.route_global) | int(imgui.InputFlags_.repeat)


def frame_slider(state: ViewerState) -> None:
    """Choose the frame; the arrow keys step."""
    frames = state.tracks.frames
    changed, frame = imgui.slider_int("frame", state.frame, frames[0], frames[-1])
    imgui.set_item_tooltip("Frame of the stage. Left, Right: previous, next frame")
    if changed:
        state.go_to(frame)
    if imgui.shortcut(imgui.Key.right_arrow, _EVERYWHERE):
        state.step(1)
    if imgui.shortcut(imgui.Key.left_arrow, _EVERYWHERE):
        state.step(-1)


def exposure_slider(display: Display) -> None:
    """Choose the exposure; E and Shift+E step it."""
    _, display.exposure_ev = imgui.slider_float(
        "exposure (EV)",
        display.exposure_ev,
        -EXPOSURE_EV_MAX,
        EXPOSURE_EV_MAX,
        "%.1f",
        imgui.SliderFlags_.clamp_on_input,
    )
    imgui.set_item_tooltip("Radiance is multiplied by 2^EV. E, Shift+E: brighter, darker")
    # As integers: joining the enums themselves fails on Python 3.11.2.
    if imgui.shortcut(int(imgui.Key.mod_shift) | int(imgui.Key.e), _EVERYWHERE):
        display.expose(-EXPOSURE_EV_STEP)
    if imgui.shortcut(imgui.Key.e, _EVERYWHERE):
        display.expose(EXPOSURE_EV_STEP)


def tone_curve_choice(display: Display) -> None:
    """Choose the tone curve; T takes the next one."""
    curves = list(ToneCurve)
    _, chosen = imgui.combo("tone curve", curves.index(display.tone_curve), list(map(str, curves)))
    imgui.set_item_tooltip("What happens to radiance above 1. T: next tone curve")
    if imgui.shortcut(imgui.Key.t, int(imgui.InputFlags_.route_global)):
        chosen = (chosen + 1) % len(curves)
    display.tone_curve = curves[chosen]
