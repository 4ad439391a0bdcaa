# SPDX-License-Identifier: Apache-2.0
"""Everything that a key does: one table for the keyboard, the tooltips and the list behind F1."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

from asglight.viewer.state.display import EXPOSURE_EV_STEP
from asglight.viewer.state.edits import acting, editing
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

E = TypeVar("E", bound=StrEnum)

ENVIRONMENT_STEP_DEG = 15.0
"""Degrees for one press of a key."""

FLIP_KEY = "F"
"""Held, not pressed: therefore not in the table of commands."""


@dataclass(frozen=True)
class Command:
    """What a key does.

    Attributes:
        group: Heading in the list of keys.
        keys: As it is written on the keys: `Ctrl+Shift+Z`.
        name: What it does, as a menu would say it.
        run: Does it.
        repeats: Whether holding the key does it again and again.
    """

    group: str
    keys: str
    name: str
    run: Callable[[ViewerState], Any]
    repeats: bool = False


def _following(value: E) -> E:
    """Return the next member of an enum, after the last the first."""
    members = list(type(value))
    return members[(members.index(value) + 1) % len(members)]


def _toggle_play(state: ViewerState) -> None:
    if state.playback.is_playing:
        state.playback.pause()
    else:
        state.playback.play(state.clock())


def _next_pace(state: ViewerState) -> None:
    was_playing = state.playback.is_playing
    state.playback.pace = _following(state.playback.pace)
    if was_playing:
        state.playback.play(state.clock())


def _toggle_loop(state: ViewerState) -> None:
    state.playback.loops = not state.playback.loops


def _next_transform(state: ViewerState) -> None:
    state.display.transform = _following(state.display.transform)


def _next_channel(state: ViewerState) -> None:
    state.display.channel = _following(state.display.channel)


def _toggle_zebra(state: ViewerState) -> None:
    state.display.zebra = not state.display.zebra


def _reset_exposure(state: ViewerState) -> None:
    state.display.exposure_ev = 0.0


def _meter(state: ViewerState) -> None:
    if not state.meter():
        state.message = "No light to meter."


def _next_comparison(state: ViewerState) -> None:
    if state.subjects:
        state.compared.comparison = _following(state.compared.comparison)
    else:
        state.message = (
            "Nothing to compare with. Drop an HDR image or sequence on the window, or open "
            "another stage as B."
        )


def _next_outlines(state: ViewerState) -> None:
    state.outlines = _following(state.outlines)


def _next_subject(state: ViewerState) -> None:
    subjects = state.subjects
    if subjects:
        place = subjects.index(state.subject) + 1
        state.compared.subject = subjects[place % len(subjects)]


def _next_material(state: ViewerState) -> None:
    state.material = _following(state.material)


def _toggle_pin(state: ViewerState) -> None:
    if state.probe is None:
        state.message = "Nothing is probed yet. Point at a ball or at the map."
    else:
        state.is_pinned = not state.is_pinned


def _next_scene(state: ViewerState) -> None:
    state.scene = _following(state.scene)


def _toggle_background(state: ViewerState) -> None:
    state.environment.is_shown = not state.environment.is_shown


def _of_selected(
    action: Callable[[ViewerState, tuple[int, ...]], None],
) -> Callable[[ViewerState], None]:
    def _run(state: ViewerState) -> None:
        if state.selected:
            action(state, state.selected)
        else:
            state.message = "No lobe is selected. Click one in the map or in the list."

    return _run


def _toggle_mute(state: ViewerState, lobes: tuple[int, ...]) -> None:
    state.toggle_mute(*lobes)


def _rename(state: ViewerState, lobes: tuple[int, ...]) -> None:
    acting.rename(state, lobes[0])


def _restore(state: ViewerState, lobes: tuple[int, ...]) -> None:
    editing.restore(state.history, lobes)


def _add_lobe(state: ViewerState) -> None:
    """Add one where the pointer was last, or where the camera looks."""
    if state.inspected is not None:
        acting.add_lobe(state, state.inspected.direction.tolist())
    else:
        acting.add_lobe(state, (state.camera.from_environment().T @ [0.0, 0.0, 1.0]).tolist())


def _select_every(state: ViewerState) -> None:
    first = state.selected[:1]
    order = [*first, *(lobe for lobe in state.history.present if lobe not in first)]
    if order:
        state.select(order[0])
        state.selection.others = tuple(order[1:])


def _all_lobes(state: ViewerState) -> None:
    state.selection.solo.clear()
    state.select(None)


def _undo(state: ViewerState) -> None:
    state.message = "Undone." if state.history.can_undo else "Nothing to undo."
    state.history.undo()


def _redo(state: ViewerState) -> None:
    state.message = "Done again." if state.history.can_redo else "Nothing to do again."
    state.history.redo()


def _toggle_panels(state: ViewerState) -> None:
    state.has_panels = not state.has_panels


def _toggle_help(state: ViewerState) -> None:
    state.has_help = not state.has_help


def _request(request: Request) -> Callable[[ViewerState], None]:
    return lambda state: state.requests.append(request)


COMMANDS = (
    Command("Time", "Space", "Play or pause", _toggle_play),
    Command("Time", "Right", "Next frame", lambda s: s.playback.step(1), repeats=True),
    Command("Time", "Left", "Previous frame", lambda s: s.playback.step(-1), repeats=True),
    Command(
        "Time", "Shift+Right", "Half a frame on", lambda s: s.playback.step_half(1), repeats=True
    ),
    Command(
        "Time", "Shift+Left", "Half a frame back", lambda s: s.playback.step_half(-1), repeats=True
    ),
    Command("Time", "Home", "First frame", lambda s: s.playback.go_to(s.playback.frames[0])),
    Command("Time", "End", "Last frame", lambda s: s.playback.go_to(s.playback.frames[-1])),
    Command("Time", "I", "In point here", lambda s: s.playback.mark_in()),
    Command("Time", "O", "Out point here", lambda s: s.playback.mark_out()),
    Command("Time", "Shift+I", "All frames between in and out", lambda s: s.playback.clear_marks()),
    Command("Time", "Shift+F", "All of the shot in the timeline", lambda s: s.span.show_all()),
    Command("Time", "L", "Loop", _toggle_loop),
    Command("Time", "P", "Real time (drops frames) or every frame", _next_pace),
    Command("Look", "E", "Brighter", lambda s: s.display.expose(EXPOSURE_EV_STEP), repeats=True),
    Command(
        "Look", "Shift+E", "Darker", lambda s: s.display.expose(-EXPOSURE_EV_STEP), repeats=True
    ),
    Command("Look", "0", "Exposure of 0 EV", _reset_exposure),
    Command("Look", "A", "Expose the mean radiance to middle grey", _meter),
    Command("Look", "T", "Next view transform", _next_transform),
    Command("Look", "C", "Next channel", _next_channel),
    Command("Look", "Z", "Zebra where the screen clips", _toggle_zebra),
    Command("Look", "M", "Metal or dielectric", _next_material),
    Command("Look", "B", "Environment behind the balls", _toggle_background),
    Command("Look", "G", "Row of balls, or a ball on the ground", _next_scene),
    Command(
        "Look",
        "]",
        "Turn the environment",
        lambda s: s.camera.turn_environment(ENVIRONMENT_STEP_DEG),
        repeats=True,
    ),
    Command(
        "Look",
        "[",
        "Turn the environment back",
        lambda s: s.camera.turn_environment(-ENVIRONMENT_STEP_DEG),
        repeats=True,
    ),
    Command("Look", "Y", "Pin the inspector, or let it go", _toggle_pin),
    Command("Look", "W", "All of the map", lambda s: s.map_frame.show_all()),
    Command("Look", "V", "Camera and environment at rest", lambda s: s.camera.reset()),
    Command("Compare", "R", "Next comparison", _next_comparison),
    Command("Compare", "Shift+R", "Overall, fit only, shading only or A and B", _next_subject),
    Command("Compare", "Ctrl+B", "Open another stage as B", _request(Request.OPEN_AGAINST)),
    Command("Compare", "Shift+B", "End A and B", lambda s: s.compare_against(None)),
    Command("Lobes", "S", "Solo the selected lobe", _of_selected(acting.toggle_solo)),
    Command("Lobes", "X", "Mute the selected lobe", _of_selected(_toggle_mute)),
    Command("Lobes", "N", "Add a lobe at the pointer", _add_lobe),
    Command("Lobes", "Delete", "Delete the selected lobe", _of_selected(acting.delete)),
    Command("Lobes", "F2", "Rename the selected lobe", _of_selected(_rename)),
    Command("Lobes", "Shift+X", "The selected lobe as it was fitted", _of_selected(_restore)),
    Command("Lobes", "Ctrl+A", "Select every lobe", _select_every),
    Command("Lobes", "H", "Outlines in the map: all, selected, none", _next_outlines),
    Command("Lobes", "Escape", "End the solo, select none", _all_lobes),
    Command("Lobes", "Ctrl+Z", "Undo", _undo, repeats=True),
    Command("Lobes", "Ctrl+Shift+Z", "Redo", _redo, repeats=True),
    Command("File", "Ctrl+O", "Open", _request(Request.OPEN)),
    Command("File", "Ctrl+S", "Save the edits as a layer", _request(Request.SAVE_EDITS)),
    Command("File", "Ctrl+P", "Save the picture", _request(Request.SAVE_PICTURE)),
    Command("File", "Ctrl+R", "Render the frames", _request(Request.RENDER)),
    Command("File", "Ctrl+L", "Render the frames with labels", _request(Request.RENDER_LABELLED)),
    Command("File", "Ctrl+T", "Render a turntable", _request(Request.RENDER_TURNTABLE)),
    Command("File", "Ctrl+Q", "Quit", _request(Request.QUIT)),
    Command("Window", "Tab", "Panels", _toggle_panels),
    Command("Window", "F1", "List of keys", _toggle_help),
)
"""In the order of the list."""


def command(name: str) -> Command:
    """Return a command by its name."""
    return next(command for command in COMMANDS if command.name == name)
