# SPDX-License-Identifier: Apache-2.0
"""The window: hello_imgui owns it and its OpenGL context, moderngl draws into the same context.

Points are Dear ImGui's units, texels those of the screen; on a screen of high density a point is
several texels wide.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import moderngl
from imgui_bundle import glfw_utils, hello_imgui, imgui
from imgui_bundle import portable_file_dialogs as dialogs

# After imgui_bundle: the first of the two to be imported decides whose GLFW both use.
import glfw  # isort: skip

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.viewer import settings
from asglight.viewer.commands import FLIP_KEY
from asglight.viewer.panels import help as help_panel
from asglight.viewer.panels import widgets
from asglight.viewer.panels.balls import balls
from asglight.viewer.panels.curves import curves
from asglight.viewer.panels.inspector import inspector
from asglight.viewer.panels.lobes import lobes
from asglight.viewer.panels.look import look
from asglight.viewer.panels.map import latlong_map
from asglight.viewer.panels.timeline import timeline
from asglight.viewer.reference import open_reference
from asglight.viewer.renderer import Renderer
from asglight.viewer.saving import display_pixels, edited, save_edits, write_png
from asglight.viewer.session import Session
from asglight.viewer.state import Request, ViewerState

RECENT_MAX = 8
"""Files in the list of recent ones."""

_BALLS = "Balls"
_RECENT, _SETTINGS = "recent", "settings"

Opener = Callable[[str], Session | None]
"""Opens what a user dropped or chose: a session; None for images, which are compared with."""


class Window:
    """One viewer window; the callbacks that hello_imgui calls in turn."""

    def __init__(self, session: Session, opener: Opener) -> None:
        """Take what to show, and what opens other files."""
        self.session = session
        self._opener = opener
        self._dialog: dialogs.open_file | dialogs.save_file | None = None
        self._dialog_is_for = Request.OPEN
        self._recent: list[str] = []
        self._dropped: list[str] = []
        self._has_panels = True
        self._writer = ThreadPoolExecutor(1)
        self._saving: tuple[Path, Future[None]] | None = None
        self.failure: BaseException | None = None
        self.is_open = False

    @property
    def state(self) -> ViewerState:
        """What is shown."""
        return self.session.state

    def opened(self) -> None:
        """Adopt the window's OpenGL context."""
        # create_context() would look for a context of its own where another one exists already.
        moderngl.init_context()
        self.context = moderngl.get_context()
        self.is_open = True
        # What a panel left open when it raised is closed for it; `run` raises the error itself.
        imgui.get_io().config_error_recovery_enable_assert = False
        self.renderer = Renderer(self.context)
        if _remembers():
            settings.restore(self.state, hello_imgui.load_user_pref(_SETTINGS))
            with suppress(ValueError, TypeError):
                recent = json.loads(hello_imgui.load_user_pref(_RECENT))
                self._recent = [str(path) for path in recent]
        self._handle: Any = glfw_utils.glfw_window_hello_imgui()
        self._on_drop: Any = lambda _window, paths: self.dropped(paths)  # GLFW keeps no reference
        glfw.set_drop_callback(self._handle, self._on_drop)

    def before_picture(self) -> None:
        """Bring the state to this moment: time, sources, files."""
        state = self.state
        io = imgui.get_io()
        pressed = imgui.is_mouse_down(0) or imgui.is_mouse_down(1)
        state.is_dragging = imgui.is_any_item_active() and pressed and not io.want_text_input
        self.renderer.learn()
        state.playback.tick(state.clock())
        status = self.session.update(int(state.playback.is_playing))
        is_busy = state.playback.is_playing or not status.is_finished or self._saving is not None
        is_busy |= self.renderer.reference_progress < 1 or self._is_reading()
        hello_imgui.get_runner_params().fps_idling.enable_idling = not is_busy
        for path in self._dropped:
            self.open(path)
        self._dropped.clear()
        self._requests()
        self._finish_saving()
        self._show_panels()

    def keys(self) -> None:
        """Take the keys and show their list; the panels follow."""
        widgets.handle_keys(self.state, FLIP_KEY)
        help_panel.keys_window(self.state)

    def panels(self) -> list[hello_imgui.DockableWindow]:
        """Return the panels and where they are docked at first."""
        drawers: Sequence[tuple[str, str, Callable[[], None]]] = (
            (_BALLS, "MainDockSpace", lambda: balls(self.state, self.renderer)),
            ("Timeline", "TimelineSpace", lambda: timeline(self.state)),
            ("Map", "LowerSpace", lambda: latlong_map(self.state, self.renderer)),
            ("Curves", "CurvesSpace", lambda: curves(self.state)),
            ("Look", "RightSpace", lambda: look(self.state)),
            ("Lobes", "LobesSpace", lambda: lobes(self.state)),
            ("Inspector", "InspectorSpace", lambda: inspector(self.state)),
        )
        return [
            hello_imgui.DockableWindow(name, space, self.guarded(draw))
            for name, space, draw in drawers
        ]

    def bare(self) -> None:
        """Draw the balls alone, over all of the window."""
        balls(self.state, self.renderer)
        self.keys()

    def status(self) -> None:
        """Draw the line at the bottom."""
        help_panel.status_line(self.state, self.session, self.renderer)

    def menus(self) -> None:
        """Draw the menus beside those of hello_imgui."""
        if imgui.begin_menu("File"):
            if imgui.menu_item_simple("Open...", "Ctrl+O"):
                self.state.requests.append(Request.OPEN)
            if imgui.begin_menu("Recent", bool(self._recent)):
                for path in list(self._recent):
                    if imgui.menu_item_simple(path):
                        self.open(path)
                imgui.end_menu()
            imgui.separator()
            if imgui.menu_item_simple("Save the edits as a layer...", "Ctrl+S"):
                self.state.requests.append(Request.SAVE_EDITS)
            if imgui.menu_item_simple("Save the picture...", "Ctrl+P"):
                self.state.requests.append(Request.SAVE_PICTURE)
            imgui.end_menu()
        if imgui.begin_menu("Help"):
            _, self.state.has_help = imgui.menu_item("Keys", "F1", self.state.has_help)
            imgui.end_menu()

    def dropped(self, paths: Sequence[str]) -> None:
        """Remember what was dropped; it is opened before the next picture."""
        self._dropped.extend(paths)

    def open(self, path: str) -> None:
        """Open a stage or folder, or compare with images; what goes wrong becomes the message."""
        state = self.state
        try:
            session = self._opener(path)
            if session is None:
                state.compare_with(open_reference(path))
            else:
                self._take_over(session)
        except InputError as error:
            state.message = str(error)
            return
        self.state.message = f"Opened {shown(Path(path).name)}."
        self._recent = [path, *(other for other in self._recent if other != path)][:RECENT_MAX]
        if _remembers():
            hello_imgui.save_user_pref(_RECENT, json.dumps(self._recent))

    def save(self, request: Request, path: Path) -> None:
        """Save what is asked for; what came of it becomes the message.

        Edits are written beside the loop, because the images of a long shot's dome take seconds.
        """
        if request is Request.SAVE_PICTURE:
            pixels = display_pixels(self.renderer.shown_balls)
            self._saving = path, self._writer.submit(write_png, path, pixels)
        else:
            self._saving = path, self._writer.submit(save_edits, edited(self.session), path)
        self.state.message = f"Saving {shown(path.name)} ..."

    def closed(self) -> None:
        """End what runs beside, and give the context back so that another can be adopted."""
        if _remembers():
            hello_imgui.save_user_pref(_SETTINGS, settings.as_text(self.state))
        self._writer.shutdown()  # what is being written is finished
        self.session.close()
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

    def _take_over(self, session: Session) -> None:
        """Show another session as this one was looked at."""
        before = self.state
        session.state.display, session.state.camera = before.display, before.camera
        session.state.environment, session.state.material = before.environment, before.material
        self.session.close()
        self.session = session
        glfw.set_window_title(self._handle, f"{session.title} - asglight")

    def _finish_saving(self) -> None:
        """Say what came of a save, once it has ended."""
        if self._saving is None or not self._saving[1].done():
            return
        path, written = self._saving
        self._saving = None
        try:
            written.result()
            self.state.message = f"Saved {shown(path.name)}."
        except InputError as error:
            self.state.message = str(error)

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
        for request in self.state.requests:
            self._dialog = _dialog(request, self.session)
            self._dialog_is_for = request
        self.state.requests.clear()
        if self._dialog is None or not self._dialog.ready(0):
            return
        result = self._dialog.result()
        self._dialog = None
        if not result:
            return
        if self._dialog_is_for is Request.OPEN:
            self.open(result[0])
        else:
            assert isinstance(result, str)
            self.save(self._dialog_is_for, Path(result))


def _remembers() -> bool:
    """Tell whether this window is a user's, whose habits are kept; a screenshot's is not."""
    return not hello_imgui.get_runner_params().ini_disable


def _dialog(request: Request, session: Session) -> dialogs.open_file | dialogs.save_file:
    if request is Request.OPEN:
        kinds = ["Stages and images", "*.usda *.usdc *.usd *.exr *.hdr", "All files", "*"]
        return dialogs.open_file("Open", "", kinds)
    if request is Request.SAVE_EDITS:
        return dialogs.save_file("Save the edits", f"{session.title}_edits.usda", ["USD", "*.usda"])
    return dialogs.save_file("Save the picture", f"{session.title}.png", ["PNG", "*.png"])
