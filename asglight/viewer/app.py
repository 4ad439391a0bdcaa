# SPDX-License-Identifier: Apache-2.0
"""The viewer's command line: read a stage, then a window, a picture in a file, or a check."""

import argparse
import contextlib
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from asglight.errors import InputError

SIZE = (1024, 512)
"""Columns and rows of the picture."""

SIZE_MAX = 16384
"""Texels along a side: what every OpenGL 4.1 can draw into."""

_EXTRA = {"moderngl", "glcontext", "imgui_bundle", "glfw", "PIL"}
"""Packages that only the viewer needs."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the viewer.

    Args:
        argv: Arguments without the program's name; by default those of the process.

    Returns:
        Exit code: 0 done, 1 a shader does not compile (only --check), 2 the input is at fault.
    """
    arguments = parser().parse_args(argv)
    try:
        if arguments.check:
            return _check()
        _view(arguments)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the viewer's arguments."""
    result = argparse.ArgumentParser(
        description="Show the lobes of a stage.",
        epilog="example: python viewer.py shot.usda --frame 1001 --screenshot shot.png",
    )
    result.add_argument("stage", nargs="?", type=Path, help="USD file written by asglight")
    result.add_argument("--frame", type=int, help="frame to show first (default: the first)")
    result.add_argument(
        "--screenshot", type=Path, metavar="PNG", help="write the picture to a file, no window"
    )
    result.add_argument(
        "--size", type=_size, default=SIZE, metavar="WxH", help="texels (default: 1024x512)"
    )
    result.add_argument(
        "--exposure-ev", type=_exposure, default=0.0, metavar="EV", help="stops (default: 0)"
    )
    result.add_argument(
        "--check", action="store_true", help="compile every shader and say what OpenGL there is"
    )
    return result


def _view(arguments: argparse.Namespace) -> None:
    """Show or write what the arguments ask for."""
    if arguments.stage is None:
        raise InputError("stage: none given; expected a .usda, .usdc or .usd file. See --help.")
    output: Path | None = arguments.screenshot
    if output is not None and output.suffix.lower() != ".png":
        raise InputError(f"--screenshot {output}: not a PNG file; expected a name ending in .png.")
    from asglight.usd import read_usd
    from asglight.viewer.state import Display, ViewerState

    tracks = read_usd(arguments.stage)
    state = ViewerState(tracks, display=Display(arguments.exposure_ev))
    if arguments.frame is not None:
        if arguments.frame not in tracks.frames:
            raise InputError(_missing_frame(arguments.frame, arguments.stage, tracks.frames))
        state.go_to(arguments.frame)
    if output is not None:
        with _explained_imports():
            from asglight.viewer import screenshot
        screenshot.write_png(output, screenshot.picture(state, arguments.size))
    else:
        with _explained_imports():
            from asglight.viewer import window
        window.show(state, f"{arguments.stage.name} - asglight", arguments.size)


def _check() -> int:
    """Print what OpenGL there is and whether it takes each shader."""
    with _explained_imports():
        from asglight.viewer import context
    opengl = context.standalone_context()
    print(context.describe(opengl))
    from asglight.viewer import glsl, passes

    failures = 0
    for name in glsl.fragment_shaders():
        try:
            passes.pass_program(opengl, name)
            print(f"shaders/{name}: ok")
        except glsl.ShaderError as error:
            print(error)
            failures += 1
    opengl.release()
    return 1 if failures else 0


def _missing_frame(frame: int, stage: Path, frames: tuple[int, ...]) -> str:
    held = f"{frames[0]}-{frames[-1]}, {len(frames)} frames"
    return f"--frame {frame}: not in {stage.name}; expected one that it holds ({held})."


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
        raise InputError(
            f"viewer: {error}; expected the OpenGL libraries of the system. "
            "On Debian or Ubuntu: apt install libegl1 libgl1."
        ) from error


def _size(text: str) -> tuple[int, int]:
    """Read `1024x512`."""
    columns, cross, rows = text.lower().partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r}; expected COLUMNSxROWS, such as 1024x512")
    size = int(columns), int(rows)
    if not all(1 <= side <= SIZE_MAX for side in size):
        raise argparse.ArgumentTypeError(f"{text!r}; expected sides of 1 to {SIZE_MAX} texels")
    return size


def _exposure(text: str) -> float:
    """Read a number of stops."""
    from asglight.viewer.state import EXPOSURE_EV_MAX

    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and abs(value) <= EXPOSURE_EV_MAX:
            return value
    limit = f"{EXPOSURE_EV_MAX:g}"
    raise argparse.ArgumentTypeError(f"{text!r}; expected stops between -{limit} and {limit}")
