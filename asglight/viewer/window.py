# SPDX-License-Identifier: Apache-2.0
"""The window: hello_imgui owns it and its OpenGL context, moderngl draws into the same context.

Points are Dear ImGui's units, texels those of the screen; on a screen of high density a point is
several texels wide.
"""

import math
import warnings

import moderngl
from imgui_bundle import ImVec2, hello_imgui, imgui, immapp

# After imgui_bundle: the first of the two to be imported decides whose GLFW both use.
import glfw  # isort: skip

from asglight.errors import InputError
from asglight.viewer import panels
from asglight.viewer.context import GL_VERSION
from asglight.viewer.passes import target_texture
from asglight.viewer.renderer import Renderer
from asglight.viewer.state import ViewerState

FPS_MAX = 60.0
"""Pictures per second at most: without vertical sync the loop would take all of a core."""

FPS_IDLE = 5.0
"""Pictures per second while nobody touches the window."""


class Window:
    """One viewer window; the callbacks that hello_imgui calls in turn."""

    def __init__(self, state: ViewerState, size: tuple[int, int]) -> None:
        """Take the state to show and change, and the picture's size at the start, (W, H)."""
        self._state = state
        self._size = size
        self.is_open = False

    def opened(self) -> None:
        """Adopt the window's OpenGL context."""
        # create_context() would look for a context of its own where another one exists already.
        moderngl.init_context()
        self._context = moderngl.get_context()
        self.is_open = True
        self._renderer = Renderer(self._context, self._size)

    def draw(self) -> None:
        """Draw the controls and, below them, the picture as large as it fits."""
        panels.frame_slider(self._state)
        panels.exposure_slider(self._state.display)
        panels.tone_curve_choice(self._state.display)
        room = imgui.get_content_region_avail()
        points = latlong_size(room.x, room.y)
        density = imgui.get_io().display_framebuffer_scale
        self._renderer.resize((round(points[0] * density.x), round(points[1] * density.y)))
        texture = target_texture(self._renderer.draw(self._state))
        # Dear ImGui draws into whatever framebuffer is bound.
        self._context.screen.use()
        imgui.image(imgui.ImTextureRef(texture.glo), ImVec2(*points))

    def closed(self) -> None:
        """Give the context back, so that another one can be adopted in this process."""
        self._context.release()


def latlong_size(width: float, height: float) -> tuple[int, int]:
    """Return the largest 2:1 size within a room, in points and at least 2 x 1."""
    rows = max(1, math.floor(min(width / 2, height)))
    return 2 * rows, rows


def show(state: ViewerState, title: str, size: tuple[int, int]) -> None:
    """Show a state until its window is closed.

    Args:
        state: What to show; the controls change it.
        title: The window's title.
        size: The picture's columns and rows at the start, (W, H).

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
    window = Window(state, size)
    try:
        immapp.run(runner_params(window, title, size))
    except RuntimeError as error:
        if window.is_open:
            raise
        version = ".".join(map(str, GL_VERSION))
        raise InputError(
            f"window: cannot be opened; expected OpenGL {version} or later. "
            "Update the graphics driver; --check says what it has."
        ) from error


def runner_params(window: Window, title: str, size: tuple[int, int]) -> hello_imgui.RunnerParams:
    """Return how hello_imgui is to run a window."""
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = title
    # Room for the three controls above the picture.
    params.app_window_params.window_geometry.size = (size[0], size[1] + 110)
    params.ini_folder_type = hello_imgui.IniFolderType.app_user_config_folder
    params.ini_filename = "asglight/viewer.ini"
    options = params.renderer_backend_options.open_gl_options
    options.major_version, options.minor_version = GL_VERSION
    options.use_core_profile = options.use_forward_compat = True
    options.glsl_version = "410"
    options.anti_aliasing_samples = 0  # the picture is drawn texel by texel
    params.fps_idling.fps_max = FPS_MAX
    params.fps_idling.fps_idle = FPS_IDLE
    params.callbacks.post_init = window.opened
    params.callbacks.show_gui = window.draw
    params.callbacks.before_exit = window.closed
    return params
