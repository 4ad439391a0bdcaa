# SPDX-License-Identifier: Apache-2.0
"""How hello_imgui runs the window: its loop, its layout, its OpenGL."""

import contextlib
import gc
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

from imgui_bundle import hello_imgui, imgui, immapp

# After imgui_bundle: the first of the two to be imported decides whose GLFW both use.
import glfw  # isort: skip

from asglight.errors import InputError
from asglight.threads import one_thread
from asglight.viewer import layout
from asglight.viewer.gl.context import GL_VERSION
from asglight.viewer.io.documents import Opener
from asglight.viewer.state.session import Session
from asglight.viewer.window import Window

SIZE = (1600, 1000)
"""Columns and rows of the first window."""

FPS_MAX = 60.0
"""Pictures per second at most: without vertical sync the loop would take all of a core."""

FPS_IDLE = 0.5
"""Pictures per second while nothing changes and no event comes: any event draws one at once."""


_CONFIG = hello_imgui.IniFolderType.app_user_config_folder


def show(session: Session, opener: Opener, size: tuple[int, int] | None) -> None:
    """Show a session until its window is closed.

    Args:
        session: What to show; the controls change its state.
        opener: Opens other files.
        size: The window's columns and rows at the start, in points, (W, H); None for those that
            it had last.

    Raises:
        InputError: There is no display, or no OpenGL that is new enough.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glfw.GLFWError)  # said in the InputError instead
        if not glfw.init():
            raise InputError(
                "window: no display; expected a desktop session. "
                "Use --screenshot, which needs no display."
            )
    folder = settings_folder()
    kept = None if settings_finding(folder) else folder / "unsaved"
    run(Window(session, opener, kept), size or SIZE, keeps_size=size is None)


def run(
    window: Window,
    size: tuple[int, int],
    *,
    is_bare: bool = False,
    is_hidden: bool = False,
    keeps_size: bool = False,
) -> None:
    """Run a window's loop until it is closed.

    Args:
        window: The window.
        size: Columns and rows at the start, in points.
        is_bare: Whether to leave the panels out.
        keeps_size: Whether the window is as large as it was last.
        is_hidden: Whether nobody looks: it is not shown, and the user's layout stays untouched.

    Raises:
        InputError: There is no OpenGL that is new enough.
    """
    params = runner_params(window, size, is_bare=is_bare)
    params.app_window_params.restore_previous_geometry = keeps_size
    finding = "" if is_hidden else settings_finding(settings_folder())
    if finding:
        params.ini_disable = True
        window.state.message = finding
    if is_hidden:
        params.ini_disable = params.app_window_params.hidden = True
        params.fps_idling.enable_idling, params.fps_idling.fps_max = False, 0.0
    try:
        with as_pictures_need():
            immapp.run(params, immapp.AddOnsParams(with_implot=True))
    except RuntimeError as error:
        if window.is_open:
            raise
        version = ".".join(map(str, GL_VERSION))
        raise InputError(
            f"window: cannot be opened; expected OpenGL {version} or later. "
            "Update the graphics driver; --check says what it has."
        ) from error
    window.raise_failure()


@contextlib.contextmanager
def as_pictures_need() -> Iterator[None]:
    """Compute on one thread, and look for garbage only in what is made from now on.

    A picture needs too little to be worth waking other threads. What is loaded by now are 230,000
    objects that stay: to go through them takes a tenth of a second, two frames of a shot.
    """
    gc.freeze()
    gc.enable()
    try:
        with one_thread():
            yield
    finally:
        gc.unfreeze()


def settings_folder() -> Path:
    """Return where settings, layout, recent files and unsaved edits are kept."""
    return Path(hello_imgui.ini_folder_location(_CONFIG)) / "asglight"


def settings_finding(folder: Path) -> str:
    """Return why nothing can be kept in a folder, in one line; empty where it can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (
            f"{folder}: cannot be written ({error.strerror}); settings, layout, recent files and "
            "unsaved edits are not kept. Make the folder writable."
        )


def runner_params(
    window: Window, size: tuple[int, int], *, is_bare: bool = False
) -> hello_imgui.RunnerParams:
    """Return how hello_imgui is to run a window."""
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = f"{window.session.title} - asglight"
    params.app_window_params.window_geometry.size = size
    params.ini_folder_type = _CONFIG
    params.ini_filename = "asglight/viewer.ini"
    options = params.renderer_backend_options.open_gl_options
    options.major_version, options.minor_version = GL_VERSION
    options.use_core_profile = options.use_forward_compat = True
    options.glsl_version = "410"
    options.anti_aliasing_samples = 0  # the pictures are antialiased by themselves
    params.fps_idling.fps_max = FPS_MAX
    params.fps_idling.fps_idle = FPS_IDLE
    params.callbacks.post_init = window.opened
    params.callbacks.pre_new_frame = window.guarded(window.before_picture)
    params.callbacks.before_imgui_render = window.guarded(window.drawn)
    params.callbacks.before_exit = window.closed
    params.callbacks.confirm_exit = window.confirm_exit
    kinds = hello_imgui.DefaultImGuiWindowType
    if is_bare:
        params.imgui_window_params.default_imgui_window_type = kinds.provide_full_screen_window
        params.callbacks.show_gui = window.guarded(window.bare)
        return params
    params.imgui_window_params.default_imgui_window_type = kinds.provide_full_screen_dock_space
    params.imgui_window_params.show_menu_bar = True
    params.imgui_window_params.show_menu_app = False
    params.imgui_window_params.show_menu_view = False
    params.imgui_window_params.show_status_bar = True
    params.imgui_window_params.show_status_fps = False
    params.callbacks.show_menus = window.guarded(window.menus)
    params.callbacks.show_status = window.guarded(window.status)
    params.callbacks.show_gui = window.guarded(window.keys)
    params.docking_params.dockable_windows = window.panels()
    params.docking_params.main_dock_space_node_flags = int(imgui.DockNodeFlags_.none)
    params.docking_params.docking_splits = layout.splits(size, layout.FONT_POINTS)
    return params
