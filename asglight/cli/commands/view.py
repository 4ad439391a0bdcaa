# SPDX-License-Identifier: Apache-2.0
"""`asglight view`: show lobes and images in a window or write a picture (also `viewer.py`)."""

import argparse
import contextlib
import gc
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from asglight.cli.options.parser import (
    add_follow_option,
    add_input_options,
    add_rig_option,
    one_line,
)
from asglight.cli.options.reading import read_options
from asglight.cli.sources.opening import Request, opened, opened_in_window
from asglight.errors import InputError

if TYPE_CHECKING:
    from asglight.viewer.state.session import Session

EXAMPLE = "asglight view shot.usda --reference sky.####.exr --frame 1001"

SIZE = (1600, 1000)
"""Columns and rows of the window."""

SIZE_MAX = 16384
"""Texels along a side: what every OpenGL 4.1 can draw into."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `view`."""
    add = parser.add_argument
    stage = "a stage, also one that asglight fit is still writing; a folder that holds one; or"
    images = "images: a file, a folder, or a pattern such as sky.####.exr"
    nothing = "(default: the built-in environment, fitted as it plays)"
    add("input", nargs="?", metavar="INPUT", help=f"{stage} {images} {nothing}")
    add("--reference", metavar="IMAGES", help="images to compare a stage with")
    against = "another fit of the shot, B, to hold against INPUT, A: a stage or its folder"
    add("--against", metavar="STAGE", help=against)
    add("--live", action="store_true", help="fit the images while they are shown")
    add("--lobes", type=int, metavar="N", help="number of lobes of a live fit (default: 15)")
    add_input_options(parser)
    frame = "frame to show, or a time between two such as 1012.5 (default: the first)"
    add("--frame", type=_frame, metavar="N", help=frame)
    add("--screenshot", type=Path, metavar="PNG", help="write the window to a file; no display")
    add("--bare", action="store_true", help="with --screenshot: the balls alone, no panels")
    output = "write the balls over all frames: out.####.png, out.####.exr or out.mp4; no display"
    add("--render", type=Path, metavar="OUT", help=output)
    add("--turntable", type=int, metavar="N", help="with --render: one turn of N pictures")
    add("--labels", action="store_true", help="with --render: names, frame and exposure in them")
    size = "window (default: as it was last; of a picture 1600x1000)"
    add("--size", type=_size, metavar="WxH", help=size)
    add("--exposure-ev", type=_exposure, metavar="EV", help="stops (default: metered)")
    views = "sRGB, filmic, 'false colour', or a view of OpenColorIO: CONFIG[/SCREEN[/RENDERING]]"
    add("--view", metavar="VIEW", help=f"{views} with CONFIG 'ACES 2.0', 'ACES 1.3' or '$OCIO'")
    add("--ground", action="store_true", help="show a ball and a post on the ground")
    add_rig_option(parser)
    add_follow_option(parser)
    add("--check", action="store_true", help="compile every shader and say what OpenGL there is")


def run(arguments: argparse.Namespace) -> int:
    """Show or write what the arguments ask for."""
    gc.disable()  # until the window runs: packages and stage are objects that stay
    try:
        return _run(arguments)
    finally:
        gc.enable()


def _run(arguments: argparse.Namespace) -> int:
    if arguments.check:
        from asglight.viewer import app

        return app.check()
    _check_rendering(arguments)
    output: Path | None = arguments.screenshot
    if output is not None and output.suffix.lower() != ".png":
        raise InputError(f"--screenshot {output}: not a PNG file; expected a name ending in .png.")
    request = Request(
        input=arguments.input,
        reference=arguments.reference,
        against=arguments.against,
        frames=arguments.frames,
        reading=read_options(arguments),
        live=arguments.live,
        lobes=arguments.lobes,
        rig=arguments.rig,
    )
    with contextlib.closing(opened(request)) as session:
        from asglight.viewer import app  # after the start of a live fit, which need not wait for it

        app.set_up(session, arguments.frame, arguments.exposure_ev, arguments.view)
        if arguments.ground:
            app.show_ground(session)
        status = session.source.status()
        is_after = status.is_finished and output is not None  # the picture may fail, and say why
        if status.message and not is_after and (status.is_finished or output is not None):
            print(f"asglight: {one_line(status.message)}", file=sys.stderr)
        if arguments.render is not None:
            _render(session, arguments)
        elif output is None:
            app.show(session, opened_in_window, arguments.size)
        else:
            app.write_screenshot(session, output, arguments.size or SIZE, is_bare=arguments.bare)
        if status.message and is_after:
            print(f"asglight: {one_line(status.message)}", file=sys.stderr)
    return 0


def _check_rendering(arguments: argparse.Namespace) -> None:
    """Refuse options of a rendering that contradict each other or would have no effect."""
    for name in ("turntable", "labels"):
        if getattr(arguments, name) and arguments.render is None:
            raise InputError(f"--{name}: given without --render; expected both or neither.")
    if arguments.render is not None and arguments.screenshot is not None:
        raise InputError("--render: given with --screenshot; expected one of the two.")
    if arguments.turntable is not None and arguments.turntable < 1:
        raise InputError(f"--turntable {arguments.turntable}: expected 1 picture or more.")


def _render(session: "Session", arguments: argparse.Namespace) -> None:
    """Write pictures with a bar on the terminal."""
    from asglight.cli.progress import reporter
    from asglight.viewer import app
    from asglight.viewer.io.wanted import Wanted

    wanted = Wanted(arguments.render, arguments.size or SIZE, arguments.labels, arguments.turntable)
    count = arguments.turntable or len(session.state.playback.frames)
    with reporter() as report:
        for _ in report.follow(app.write_rendering(session, wanted), "rendering", count):
            pass


def _size(text: str) -> tuple[int, int]:
    """Read `1024x512`."""
    columns, cross, rows = text.lower().partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r}; expected COLUMNSxROWS, such as 1024x512")
    size = int(columns), int(rows)
    if not all(1 <= side <= SIZE_MAX for side in size):
        raise argparse.ArgumentTypeError(f"{text!r}; expected sides of 1 to {SIZE_MAX} texels")
    return size


def _frame(text: str) -> float:
    """Read a frame number or a time between two."""
    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}; expected a frame such as 1012, or 1012.5")


def _exposure(text: str) -> float:
    """Read a number of stops."""
    from asglight.viewer.state.display import EXPOSURE_EV_MAX

    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and abs(value) <= EXPOSURE_EV_MAX:
            return value
    limit = f"{EXPOSURE_EV_MAX:g}"
    raise argparse.ArgumentTypeError(f"{text!r}; expected stops between -{limit} and {limit}")
