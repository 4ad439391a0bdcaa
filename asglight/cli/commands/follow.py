# SPDX-License-Identifier: Apache-2.0
"""`asglight follow`: a live feed, a line of JSON with its lobes for each frame."""

import argparse
import math
import os
import re
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from asglight.cli.options.parser import add_reading_options, one_line
from asglight.cli.options.reading import given, read_options
from asglight.errors import InputError
from asglight.images.message import shown

if TYPE_CHECKING:
    from asglight.arrays.feeds import RawFormat, Taken

EXAMPLE = (
    "asglight follow incoming/sky.####.exr | python examples/osc.py 192.168.0.9:9000\n"
    "         capture | asglight follow - --size 512x256 --type float16"
)

STANDARD_INPUT = "-"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `follow`."""
    add = parser.add_argument
    feed = "folder or pattern whose images come one by one, or - for raw frames on standard input"
    add("source", metavar="FEED", help=feed)
    add("--lobes", type=int, help="lobes lit at a time, at most (default: 15)")
    add("--device", default="cpu", help="where torch computes, such as cuda (default: %(default)s)")
    every = "take every frame in turn; without it the newest, and those that came meanwhile are not"
    add("--every", action="store_true", help=every)
    idle = "end after so long without a new image (default: never)"
    add("--idle", type=float, metavar="SECONDS", help=idle)
    size = "of raw frames: columns and rows, such as 512x256"
    add("--size", type=_size, metavar="WxH", help=size)
    kind = "numbers of raw frames, little-endian, linear Rec.709, RGB after RGB from the top left"
    add("--type", choices=("float16", "float32"), help=f"{kind} (default: float32)")
    add_reading_options(parser)


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r}; expected columns and rows such as 512x256")
    return int(match[1]), int(match[2])


def run(arguments: argparse.Namespace) -> int:
    """Fit frames as they come and print a line for each."""
    feed = _feed(arguments)
    from asglight.arrays.follower import Follower
    from asglight.export.frame_line import frame_line

    follower = Follower(arguments.lobes, device=arguments.device, repair=arguments.repair)
    is_empty = True
    for taken in feed:
        is_empty = False
        try:
            lobes = follower.follow(taken.radiance)
        except InputError as error:
            _say(f"frame {taken.number}: passed over: {str(error).partition(': ')[2]}")
            continue
        assert follower.repair is not None
        line = frame_line(
            lobes,
            follower.names,
            frame=taken.number,
            dropped=taken.dropped,
            seconds=round(time.monotonic() - taken.arrived, 4),
            repair=None if follower.repair.is_clean else follower.repair.sentence(),
        )
        print(line, flush=True)
    if is_empty and arguments.source != STANDARD_INPUT:
        raise InputError(
            f"{shown(arguments.source)}: no image came; expected some. Is it the folder that is "
            "written?"
        )
    return 0


def _feed(arguments: argparse.Namespace) -> "Iterator[Taken]":
    """Return the frames as they come.

    Raises:
        InputError: Options of one kind of feed are given with the other.
    """
    if arguments.source == STANDARD_INPUT:
        return _raw_frames(_raw_format(arguments), every=arguments.every)
    for option in ("--size", "--type"):
        if getattr(arguments, option.removeprefix("--")) is not None:
            raise InputError(f"{option}: given with images; expected it with raw frames only.")
    idle: float | None = arguments.idle
    if idle is not None and not (math.isfinite(idle) and idle > 0):
        raise InputError(f"idle: {idle:g}; expected a number of seconds above 0.")
    reading = read_options(arguments)
    reading.check()
    from asglight.arrays.feeds import Folder

    return Folder(
        arguments.source,
        reading,
        every=arguments.every,
        idle=idle,
        on_skip=lambda why: _say(f"passed over: {why}"),
    ).frames()


def _raw_frames(form: "RawFormat", *, every: bool) -> "Iterator[Taken]":
    from asglight.arrays.feeds import raw_frames

    # not Python's own: while a thread waits in it, the interpreter cannot end
    with os.fdopen(os.dup(sys.stdin.fileno()), "rb", buffering=0) as stream:
        yield from raw_frames(stream, form, every=every)


def _raw_format(arguments: argparse.Namespace) -> "RawFormat":
    from asglight.arrays.feeds import RawFormat

    reading = [name for name in given(read_options(arguments)) if name != "--repair"]
    for option in [*reading, *(["--idle"] if arguments.idle is not None else [])]:
        raise InputError(f"{option}: given with raw frames; expected it with images only.")
    if arguments.size is None:
        raise InputError("size: none of the raw frames; expected one. Add --size, such as 512x256.")
    width, height = arguments.size
    if width != 2 * height:
        raise InputError(f"size: {width}x{height}; expected twice as many columns as rows.")
    return RawFormat(width, height, arguments.type or "float32")


def _say(message: str) -> None:
    print(f"asglight: {one_line(message)}", file=sys.stderr)
