# SPDX-License-Identifier: Apache-2.0
"""How the picture is looked at: exposure, view, comparison, environment, material."""

from imgui_bundle import imgui

from asglight.errors import InputError
from asglight.viewer.colour import opencolorio
from asglight.viewer.panels import widgets
from asglight.viewer.state.commands import ENVIRONMENT_STEP_DEG, FLIP_KEY, command
from asglight.viewer.state.display import EXPOSURE_EV_MAX, ColourView, ViewTransform
from asglight.viewer.state.viewer_state import INTENSITY_EV_MAX, ViewerState
from asglight.viewer.state.views import Scene

_CONFIG_TIP = "ACES as OpenColorIO has it, or the studio's config, where OCIO names one."


def look(state: ViewerState) -> None:
    """Draw the controls."""
    imgui.push_item_width(-widgets.em(6.5))
    _view(state)
    _comparison(state)
    _environment(state)
    _balls(state)
    imgui.pop_item_width()


def _view(state: ViewerState) -> None:
    imgui.separator_text("View")
    display = state.display
    _, display.exposure_ev = widgets.slider(
        "exposure",
        display.exposure_ev,
        (-EXPOSURE_EV_MAX, EXPOSURE_EV_MAX),
        "EV",
        "Radiance is multiplied by 2^EV before it is shown; nothing is shaded anew.",
        "E, Shift+E; 0 for 0 EV",
    )
    display.transform = widgets.choice(
        "view",
        display.transform,
        "sRGB: clipped at 1. filmic: a curve that keeps lights below white (Narkowicz 2015).\n"
        "false colour: luminance in stops from middle grey, 0.18.\n"
        "OpenColorIO: a view of ACES, or of the config that OCIO names.",
        command("Next view transform").keys,
    )
    if display.transform is ViewTransform.OPENCOLORIO:
        _colour_view(state)
    display.channel = widgets.choice(
        "channel",
        display.channel,
        "One channel as grey; Y is luminance.",
        command("Next channel").keys,
    )
    zebra = command("Zebra where the screen clips")
    display.zebra = widgets.checkbox(
        "zebra", display.zebra, zebra, "Stripes where a channel is above 1: the screen clips it."
    )


def _colour_view(state: ViewerState) -> None:
    """Choose config, display and view; without the library, or its config, say so and show sRGB."""
    display = state.display
    try:
        before = opencolorio.completed(display.colour_view)
        config = widgets.one_of("config", before.config, opencolorio.configs(), _CONFIG_TIP)
        screens = opencolorio.displays(config)
        screen = before.display if before.display in screens else screens[0]
        screen = widgets.one_of("screen", screen, screens, "What this screen is set to.")
        found = opencolorio.views(config, screen)
        view = before.view if before.view in found else found[0]
        view = widgets.one_of("rendering", view, found, "How radiance is brought to the screen.")
        display.colour_view = opencolorio.completed(ColourView(config, screen, view))
        opencolorio.view_shader(display.colour_view)
    except InputError as error:
        state.message = str(error)
        display.transform = ViewTransform.SRGB


def _comparison(state: ViewerState) -> None:
    imgui.separator_text("Compare")
    if not state.subjects:
        imgui.text_wrapped(
            "Drop an HDR image or sequence on the window, or start with --reference."
        )
    else:
        _compared(state)
    widgets.button(
        state,
        "Open another stage as B",
        "stage B...",
        "Hold another fit of this shot, B, against this one, A.",
    )
    if state.against is not None:
        imgui.same_line()
        widgets.button(state, "End A and B", "end", f"Close {state.against.name}, which is B.")
        imgui.same_line()
        imgui.text_disabled(state.against.name)


def _compared(state: ViewerState) -> None:
    compared = state.compared
    compared.comparison = widgets.choice(
        "show",
        compared.comparison,
        f"What is shown of both. Hold {FLIP_KEY}: flip to the other one.",
        command("Next comparison").keys,
    )
    compared.subject = widgets.choice(
        "error",
        state.subject,
        "overall: the balls under the lights against the balls under the HDRI.\n"
        "fit only: both sampled, so that only what the lights lack is left.\n"
        "shading only: the lights by formula and sampled: what the formulas lack.\n"
        "A and B: two fits; where there is an HDRI, the errors of both against it.",
        command("Overall, fit only, shading only or A and B").keys,
        members=state.subjects,
    )


def _environment(state: ViewerState) -> None:
    imgui.separator_text("Environment")
    _, state.camera.environment_deg = widgets.slider(
        "rotation",
        state.camera.environment_deg,
        (-180.0, 180.0),
        "deg",
        f"Turns the lights around +Y. A key turns by {ENVIRONMENT_STEP_DEG:g} degrees.",
        "[, ]",
    )
    _, state.environment.intensity_ev = widgets.slider(
        "intensity",
        state.environment.intensity_ev,
        (-INTENSITY_EV_MAX, INTENSITY_EV_MAX),
        "EV",
        "Stops added to all lights; nothing is shaded anew.",
    )
    background = command("Environment behind the balls")
    state.environment.is_shown = widgets.checkbox(
        "background", state.environment.is_shown, background, "Show it behind the balls."
    )
    imgui.same_line()
    widgets.button(state, "Camera and environment at rest", "reset camera")


def _balls(state: ViewerState) -> None:
    imgui.separator_text("Balls")
    state.scene = widgets.choice(
        "scene",
        state.scene,
        "row of balls: all roughnesses beside each other.\n"
        "ball on the ground: one of them and a post, with a shadow for each lobe.\n"
        "Solo (S) shows which shadow is whose.",
        command("Row of balls, or a ball on the ground").keys,
    )
    if state.scene is Scene.GROUND:
        names = [ball.name for ball in state.balls]
        name = widgets.one_of("ball", names[state.ground_ball], names, "What stands on the ground.")
        state.ground_ball = names.index(name)
    state.material = widgets.choice(
        "material",
        state.material,
        "metal: reflects in the base colour. dielectric: F0 0.04 over diffuse light.",
        command("Metal or dielectric").keys,
    )
    changed, colour = imgui.color_edit3(
        "base colour", list(state.base_colour), imgui.ColorEditFlags_.float
    )
    widgets.tooltip("Linear RGB reflectance of the metal, or of the diffuse light")
    if changed:
        red, green, blue = colour
        state.base_colour = red, green, blue
