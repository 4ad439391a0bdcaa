# SPDX-License-Identifier: Apache-2.0
"""What the viewer can do: open a window, write a picture, check the shaders.

The command line (`cli/commands/view.py`) reads the arguments and says where images come from.
The packages that only the viewer needs are loaded here, when they are needed.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from asglight.errors import InputError
from asglight.shader_files import ShaderError
from asglight.viewer.colour import opencolorio
from asglight.viewer.state.session import Session
from asglight.viewer.state.views import Scene

if TYPE_CHECKING:
    from asglight.viewer.io.wanted import Wanted

_EXTRA = {"moderngl", "glcontext", "imgui_bundle", "glfw", "PIL", "imageio_ffmpeg", "filelock"}
"""Packages that only the viewer needs."""


def set_up(
    session: Session, frame: float | None, exposure_ev: float | None, view: str | None = None
) -> None:
    """Bring a new session into the state that the command line asks for.

    Args:
        session: Changed in place.
        frame: Frame to show, or a time between two; None for the first.
        exposure_ev: Stops; None to meter the first light.
        view: A member of ViewTransform, or CONFIG/SCREEN/RENDERING of OpenColorIO; None for the
            first, or the one that the window had last.

    Raises:
        InputError: The timeline has no such frame, or there is no such view.
    """
    state = session.state
    session.meters = exposure_ev is None
    state.display.exposure_ev = exposure_ev or 0.0
    if view is not None:
        session.has_view = True
        state.display.transform, state.display.colour_view = opencolorio.chosen(view)
    if frame is not None:
        frames = state.playback.frames
        is_between = frame != int(frame) and frames[0] < frame < frames[-1]
        if frame not in frames and not is_between:
            raise InputError(_missing_frame(frame, session.title, frames))
        state.playback.go_to_time(frame)
        state.select(state.brightest())


def show_ground(session: Session) -> None:
    """Begin with the ball on the ground."""
    session.state.scene = Scene.GROUND


def show(
    session: Session, opener: Callable[[str], Session | None], size: tuple[int, int] | None
) -> None:
    """Show a session until its window is closed.

    Args:
        session: What to show; the controls change its state.
        opener: Opens what is dropped on the window: a session, or None for images.
        size: The window's columns and rows at the start, (W, H); None for those it had last.

    Raises:
        InputError: A package is missing, there is no display, or no OpenGL that is new enough.
    """
    with _explained_imports():
        from asglight.viewer import running
    running.show(session, opener, size)


def write_screenshot(
    session: Session, path: Path, size: tuple[int, int], *, is_bare: bool = False
) -> None:
    """Write the window of a session's frame, off screen, as soon as its lobes are there.

    Args:
        session: What to show.
        path: The PNG file; its folder must exist.
        size: Columns and rows, (W, H).
        is_bare: Whether to leave the panels out: the balls alone.

    Raises:
        InputError: A package is missing, there is no OpenGL, the lobes cannot be had, the file
            cannot be written, or it is one that the session is read from.
    """
    with _explained_imports():
        from asglight.viewer.io import inputs, saving, screenshot
    inputs.check_apart(session, [path])
    session.wait()
    session.state.select(session.state.brightest())  # a fit had no light before
    saving.write_png(path, screenshot.window_picture(session, size, is_bare=is_bare))


def write_rendering(session: Session, wanted: "Wanted") -> Iterator[int]:
    """Write pictures of a session off screen.

    Args:
        session: What to render.
        wanted: Which pictures, and where.

    Yields:
        How many there will be, once for each that is written.

    Raises:
        InputError: A package is missing, there is no OpenGL, or a picture cannot be had or written.
    """
    with _explained_imports():
        from asglight.viewer.gl import context
        from asglight.viewer.gl.renderer import Renderer
        from asglight.viewer.io.rendering import Rendering
    gc.enable()  # a film may be long
    session.wait()
    if session.meters:
        session.update()
    opengl = context.standalone_context()
    rendering = Rendering(session, Renderer(opengl), wanted)
    try:
        while rendering.done < rendering.count:
            before = rendering.done
            rendering.step()
            if rendering.done > before:
                yield rendering.count
    finally:
        rendering.close()
        opengl.release()


def check() -> int:
    """Print what OpenGL there is and whether it takes each shader; 1 where it does not, else 0.

    Raises:
        InputError: A package is missing, or there is no OpenGL that is new enough.
    """
    with _explained_imports():
        from asglight.viewer.gl import context
    opengl = context.standalone_context()
    print(context.describe(opengl))
    from asglight.viewer.gl import glsl, passes

    failures = 0
    for name in glsl.fragment_shaders():
        try:
            passes.pass_program(opengl, name)
            print(f"shaders/{name}: ok")
        except ShaderError as error:
            print(error)
            failures += 1
    opengl.release()
    return 1 if failures else 0


def _missing_frame(frame: float, title: str, frames: tuple[int, ...]) -> str:
    held = f"{frames[0]}-{frames[-1]}, {len(frames)} frames"
    return f"--frame {frame:.10g}: not in {title}; expected one that it holds ({held})."


@contextlib.contextmanager
def _explained_imports() -> Iterator[None]:
    """Turn a failed import of the viewer's own packages into one line on what to install.

    Raises:
        InputError: A package, or a system library that it loads, is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in _EXTRA:
            raise
        raise InputError(
            f"viewer: the Python package {package} is not installed; "
            "run: pip install 'asglight[view]'"
        ) from error
    except ImportError as error:
        if (error.name or "").startswith("asglight"):
            raise
        raise InputError(
            f"viewer: {error}; expected the OpenGL libraries of the system. "
            "On Debian or Ubuntu: apt install libegl1 libgl1."
        ) from error
