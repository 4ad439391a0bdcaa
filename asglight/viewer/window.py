# SPDX-License-Identifier: Apache-2.0
"""The window: hello_imgui owns it and its OpenGL context, moderngl draws into the same context.

Points are Dear ImGui's units, texels those of the screen; on a screen of high density a point is
several texels wide.
"""

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
from imgui_bundle import ImVec4, glfw_utils, hello_imgui, imgui
from imgui_bundle import portable_file_dialogs as dialogs

# After imgui_bundle: the first of the two to be imported decides whose GLFW both use.
import glfw  # isort: skip

from asglight.errors import InputError
from asglight.viewer import layout
from asglight.viewer.gl.context import collects
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.io import native
from asglight.viewer.io.documents import RECENT_MAX, Documents, Opener
from asglight.viewer.io.rendering import Rendering
from asglight.viewer.io.saving import display_pixels
from asglight.viewer.io.wanted import TURNTABLE, Wanted
from asglight.viewer.pacing import wait_for_frame
from asglight.viewer.panels import help as help_panel
from asglight.viewer.panels import widgets
from asglight.viewer.panels.balls import balls
from asglight.viewer.panels.curves import curves
from asglight.viewer.panels.dialogs.browser import browser
from asglight.viewer.panels.dialogs.progress import progress
from asglight.viewer.panels.dialogs.question import question
from asglight.viewer.panels.inspector import inspector
from asglight.viewer.panels.lights.history import history
from asglight.viewer.panels.lights.lobes import lobes
from asglight.viewer.panels.look import look
from asglight.viewer.panels.map import latlong_map
from asglight.viewer.panels.menus import menus
from asglight.viewer.panels.scopes import scopes
from asglight.viewer.panels.timeline import timeline
from asglight.viewer.state import settings
from asglight.viewer.state.commands import FLIP_KEY
from asglight.viewer.state.session import Session
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import RENDERS, Request, Theme

_BALLS = "Balls"
_THEMES = {
    Theme.DARK: hello_imgui.ImGuiTheme_.imgui_colors_dark,
    Theme.LIGHT: hello_imgui.ImGuiTheme_.imgui_colors_light,
}
_HANDLE = ImVec4(0.3, 0.6, 0.95, 0.4)
"""Of a slider: its number is read through it."""

MESSAGE_SECONDS = 20.0
"""After which a message has been read, or is about what is no more."""

_UNSCROLLED = {_BALLS, "Timeline", "Map", "Curves", "Scopes"}
"""Panels that fill their room; the wheel does something else in them."""

_RECENT, _SETTINGS = "recent", "settings"


class Window:
    """One viewer window; the callbacks that hello_imgui calls in turn."""

    def __init__(self, session: Session, opener: Opener, autosaves: Path | None = None) -> None:
        """Take what to show, what opens other files, and where unsaved edits are kept."""
        self.documents = Documents(session, opener, autosaves)
        self._dialog: tuple[Request, dialogs.save_file] | None = None
        self._dropped: list[str] = []
        self._has_panels = True
        self._docked: dict[str, bool] = {}
        self._title = ""
        self._message = "", 0.0
        self._theme: Theme | None = None
        self._to_render: tuple[Request, Path] | None = None
        self.rendering: Rendering | None = None
        self.failure: BaseException | None = None
        self.is_open = False

    @property
    def session(self) -> Session:
        """What is shown, and what brings it in."""
        return self.documents.session

    @property
    def state(self) -> ViewerState:
        """What is shown."""
        return self.session.state

    def opened(self) -> None:
        """Adopt the window's OpenGL context."""
        # create_context() would look for a context of its own where another one exists already.
        moderngl.init_context()
        self.context = collects(moderngl.get_context())
        self.is_open = True
        self._lay_out()
        # What a panel left open when it raised is closed for it; `run` raises the error itself.
        imgui.get_io().config_error_recovery_enable_assert = False
        self.renderer = Renderer(self.context, screens_wait=True)
        if _remembers():
            chosen = self.state.display.transform, self.state.display.colour_view
            settings.restore(self.state, hello_imgui.load_user_pref(_SETTINGS))
            if self.session.has_view:
                self.state.display.transform, self.state.display.colour_view = chosen
            with suppress(ValueError, TypeError):
                recent = json.loads(hello_imgui.load_user_pref(_RECENT))
                self.documents.recent = [str(path) for path in recent][:RECENT_MAX]
        self._handle: Any = glfw_utils.glfw_window_hello_imgui()
        self._on_drop: Any = lambda _window, paths: self.dropped(paths)  # GLFW keeps no reference
        glfw.set_drop_callback(self._handle, self._on_drop)

    def _lay_out(self) -> None:
        """Divide the window by the size of its font, which the screen's density has chosen."""
        params = hello_imgui.get_runner_params()
        size = params.app_window_params.window_geometry.size
        em = layout.FONT_POINTS * hello_imgui.dpi_window_size_factor()
        docking = params.docking_params
        docking.docking_splits = layout.splits((size[0], size[1]), em)
        for panel in docking.dockable_windows:
            if panel.label == "Lobes":
                is_stacked = layout.has_room((size[0], size[1]), em)
                panel.dock_space_name = "LobesSpace" if is_stacked else "RightSpace"
        style = imgui.get_style()
        style.hover_flags_for_tooltip_mouse = int(imgui.HoveredFlags_.delay_normal) | int(
            imgui.HoveredFlags_.stationary
        )

    def before_picture(self) -> None:
        """Bring the state to this moment: time, sources, files."""
        if self.rendering is None:
            wait_for_frame(self.state)
        self.documents.update()
        state = self.state
        io = imgui.get_io()
        pressed = imgui.is_mouse_down(0) or imgui.is_mouse_down(1)
        state.is_dragging = imgui.is_any_item_active() and pressed and not io.want_text_input
        self.renderer.learn()
        state.playback.tick(state.clock())
        status = self.session.update(int(state.playback.is_playing))
        is_busy = state.playback.is_playing or not status.is_finished or self.documents.is_busy
        is_busy |= self.rendering is not None
        is_busy |= self.renderer.reference_progress < 1 or self._is_reading()
        hello_imgui.get_runner_params().fps_idling.enable_idling = not is_busy
        for path in self._dropped:
            self.documents.open(path)
        self._dropped.clear()
        self._requests()
        self._go_on_rendering()
        self._show_panels()
        self._let_message_go()
        self._show_title()
        self._show_theme()
        if self.documents.has_quit:
            self.leave()

    def leave(self) -> None:
        """End the loop after this picture."""
        hello_imgui.get_runner_params().app_shall_exit = True

    def confirm_exit(self) -> bool:
        """Tell whether the window may close at once; else a question follows."""
        self.documents.quit()
        return self.documents.has_quit

    def keys(self) -> None:
        """Take the keys and show their list; the panels follow."""
        widgets.handle_keys(self.state, FLIP_KEY)
        help_panel.keys_window(self.state)
        question(self.documents)
        browser(self.documents, self.save)
        if self.rendering is not None and progress("Rendering", self.rendering):
            self.leave_rendering()

    def panels(self) -> list[hello_imgui.DockableWindow]:
        """Return the panels and where they are docked at first."""
        drawers: Sequence[tuple[str, str, Callable[[], None]]] = (
            (_BALLS, "MainDockSpace", lambda: balls(self.state, self.renderer)),
            ("Timeline", "TimelineSpace", lambda: timeline(self.state)),
            ("Map", "LowerSpace", lambda: latlong_map(self.state, self.renderer)),
            ("Curves", "CurvesSpace", lambda: curves(self.state)),
            ("Scopes", "CurvesSpace", lambda: scopes(self.state, self.renderer)),
            ("Look", "RightSpace", lambda: look(self.state)),
            ("Lobes", "LobesSpace", lambda: lobes(self.state)),
            ("Inspector", "InspectorSpace", lambda: inspector(self.state, self.renderer)),
            ("History", "InspectorSpace", lambda: history(self.state)),
        )
        windows = [
            hello_imgui.DockableWindow(name, space, self.guarded(partial(self._panel, name, draw)))
            for name, space, draw in drawers
        ]
        for window in windows:
            window.imgui_window_flags = _flags(window.label)
        return windows

    def _panel(self, name: str, draw: Callable[[], None]) -> None:
        """Draw a panel, and let it paint its ground from now on only where it floats over others.

        A docked one stands on the ground of the window, which has the same colour: without a GPU
        half of what the panels took was to paint it once more.
        """
        draw()
        is_docked = imgui.is_window_docked()
        if is_docked is self._docked.get(name):
            return
        self._docked[name] = is_docked
        for panel in hello_imgui.get_runner_params().docking_params.dockable_windows:
            if panel.label == name:
                bare = int(imgui.WindowFlags_.no_background) if is_docked else 0
                panel.imgui_window_flags = _flags(name) | bare

    def bare(self) -> None:
        """Draw the balls alone, over all of the window."""
        balls(self.state, self.renderer)
        self.keys()

    def status(self) -> None:
        """Draw the line at the bottom."""
        help_panel.status_line(self.state, self.session)

    def drawn(self) -> None:
        """Bring pictures to the screen when all panels have said what they show."""
        self.renderer.draw_screens()

    def menus(self) -> None:
        """Draw the menus."""
        menus(self.documents)

    def dropped(self, paths: Sequence[str]) -> None:
        """Remember what was dropped; it is opened before the next picture."""
        self._dropped.extend(paths)

    def save(self, request: Request, path: Path) -> None:
        """Save what is asked for."""
        if request in RENDERS:
            self._to_render = request, path  # with the next picture, when the GPU is ours
            return
        is_picture = request is Request.SAVE_PICTURE
        pixels = display_pixels(self.renderer.shown_balls) if is_picture else None
        self.documents.save(request, path, pixels)

    def _render(self, request: Request, path: Path) -> None:
        """Begin to write pictures, as large as the balls are shown."""
        columns, rows = self.renderer.shown_balls.size
        wanted = Wanted(
            path,
            (columns // 2 * 2, rows // 2 * 2),  # which every kind of file takes
            is_labelled=request is Request.RENDER_LABELLED,
            turntable=TURNTABLE if request is Request.RENDER_TURNTABLE else None,
        )
        try:
            self.rendering = Rendering(self.session, Renderer(self.context), wanted)
        except InputError as error:
            self.state.message = str(error)

    def _go_on_rendering(self) -> None:
        """Draw a little more of what is being written."""
        if self._to_render is not None:
            to_render, self._to_render = self._to_render, None
            self._render(*to_render)
        rendering = self.rendering
        if rendering is None:
            return
        try:
            is_over = rendering.step()
        except InputError as error:
            rendering.close()
            self.state.message, self.rendering = str(error), None
            return
        if is_over:
            self.state.message, self.rendering = f"Rendered {rendering.count} pictures.", None

    def leave_rendering(self) -> None:
        """Stop writing; the pictures that are written stay, a film is removed."""
        if self.rendering is not None:
            self.state.message = f"Stopped after {self.rendering.done} pictures."
            self.rendering.close()
            self.rendering = None

    def closed(self) -> None:
        """End what runs beside, and give the context back so that another can be adopted."""
        if _remembers():
            hello_imgui.save_user_pref(_SETTINGS, settings.as_text(self.state))
            hello_imgui.save_user_pref(_RECENT, json.dumps(self.documents.recent))
        self.leave_rendering()
        self.documents.close(is_wanted=self.failure is None and self.documents.has_quit)
        self.context.release()

    def raise_failure(self) -> None:
        """Raise what a panel raised, if one did."""
        if self.failure is not None:
            raise self.failure

    def guarded(self, draw: Callable[[], None]) -> Callable[[], None]:
        """Make a callback safe: keep what it raises for `run`, give the framebuffer back.

        An exception that goes through Dear ImGui ends the process without a word. It draws into
        whatever framebuffer is bound.
        """

        def _guarded() -> None:
            if self.failure is not None:
                return
            try:
                draw()
            except BaseException as error:  # Ctrl-C as well
                self.failure = error
                hello_imgui.get_runner_params().app_shall_exit = True
            self.context.screen.use()

        return _guarded

    def _let_message_go(self) -> None:
        """Forget a message some time after it came."""
        state = self.state
        if state.message != self._message[0]:
            self._message = state.message, state.clock()
        elif state.clock() - self._message[1] > MESSAGE_SECONDS:
            state.message = ""

    def _show_title(self) -> None:
        """Keep the window's title in step with what it shows."""
        if self._title != self.documents.title:
            self._title = self.documents.title
            glfw.set_window_title(self._handle, self._title)

    def _show_theme(self) -> None:
        """Give the window the colours that were chosen."""
        if self._theme is not self.state.theme:
            self._theme = self.state.theme
            hello_imgui.apply_theme(_THEMES[self._theme])
            style = imgui.get_style()
            ground = style.color_(imgui.Col_.window_bg)
            params = hello_imgui.get_runner_params().imgui_window_params
            params.background_color = ImVec4(ground.x, ground.y, ground.z, 1.0)
            style.set_color_(imgui.Col_.docking_empty_bg, ground)
            for colour in (imgui.Col_.slider_grab, imgui.Col_.slider_grab_active):
                style.set_color_(colour, _HANDLE)

    def _show_panels(self) -> None:
        """Hide or show the panels beside the balls, when that was asked for."""
        if self.state.has_panels == self._has_panels:
            return
        self._has_panels = self.state.has_panels
        for panel in hello_imgui.get_runner_params().docking_params.dockable_windows:
            panel.is_visible = self._has_panels or panel.label == _BALLS

    def _is_reading(self) -> bool:
        references = self.state.references
        if references is None or self.state.reference_image is not None:
            return False
        return references.message(self.state.playback.frame) is None

    def _requests(self) -> None:
        """Ask for files, and use those that were chosen."""
        requests = list(self.state.requests)
        self.state.requests.clear()
        for request in requests:
            if request is Request.QUIT:
                self.documents.quit()
            elif self.documents.ask(request):
                self._ask_for_file(request)
        if self._dialog is None or not self._dialog[1].ready(0):
            return
        request, dialog = self._dialog
        self._dialog = None
        path = dialog.result()
        if path:
            self.save(request, Path(path))
        else:
            self.documents.leave_saving()

    def _ask_for_file(self, request: Request) -> None:
        """Let a file be named, by the system where it can; it knows no sequences to open."""
        if request in (Request.OPEN, Request.OPEN_AGAINST) or not native.has_dialog():
            self.documents.browse(request)
        else:
            self._dialog = request, native.save_dialog(request, *self.documents.proposed(request))


def _flags(name: str) -> int:
    """Return how Dear ImGui treats a panel."""
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
    return int(flags) if name in _UNSCROLLED else 0


def _remembers() -> bool:
    """Tell whether this window is a user's, whose habits are kept; a screenshot's is not."""
    return not hello_imgui.get_runner_params().ini_disable
