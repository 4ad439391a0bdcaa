# SPDX-License-Identifier: Apache-2.0
"""What scripts are given: every map of a folder, `--maps`, the frames of a sequence, files."""

import argparse
import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from torch import Tensor

from asglight.cli.options.parser import one_line
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong
from asglight.images.message import shown
from asglight.images.sequence import open_sequence


@contextlib.contextmanager
def refused_in_a_line(parser: argparse.ArgumentParser) -> Iterator[None]:
    """Let a script end with one line and exit status 2 where an input is the user's to mend.

    Args:
        parser: Of the script.
    """
    try:
        yield
    except InputError as error:
        parser.error(one_line(str(error)))


def positive(text: str) -> int:
    """Parse how many of something: a whole number from 1 on."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; expected a whole number from 1 on")
    return number


def read_map(path: Path, height: int = FIT_HEIGHT) -> Tensor:
    """Read a map.  [H, 2 H, 3].

    Args:
        path: The image.
        height: Rows to which a finer one is averaged down: those that are fitted.

    Raises:
        InputError: It cannot be read, or is black.
    """
    radiance = read_latlong(path, height=height).radiance
    if float(radiance.max()) <= 0:
        raise InputError(f"{shown(path)}: is black; expected a map with some light in it.")
    return radiance


def map_paths(parser: argparse.ArgumentParser, folder: Path) -> list[Path]:
    """Return the maps of a folder by name.

    Args:
        parser: Of the script.
        folder: What `--maps` names.

    Raises:
        SystemExit: There is no map; one line says so.
    """
    paths = sorted(folder.glob("*.exr"))
    if not paths:
        parser.error(f"--maps: {folder}: has no .exr; expected latlong OpenEXR files")
    return paths


def maps_given(program: str, text: str | None, argv: Sequence[str] | None) -> dict[str, Tensor]:
    """Parse the command line and read the maps.

    Args:
        program: Name of the script.
        text: What `--help` says of it.
        argv: Its arguments; None for those of the process.

    Returns:
        Repaired radiance [H, 2 H, 3] by name.

    Raises:
        SystemExit: There is no map, or one cannot be read; one line says so.
    """
    parser = argparse.ArgumentParser(prog=program, description=text)
    parser.add_argument("--maps", type=Path, required=True, metavar="DIR", help="latlong OpenEXR")
    paths = map_paths(parser, parser.parse_args(argv).maps)
    with refused_in_a_line(parser):
        return {path.stem: read_map(path) for path in paths}


def add_sequence(parser: argparse.ArgumentParser) -> None:
    """Let a script be given a sequence, or the first frames of one."""
    parser.add_argument("sequence", metavar="DIR", help="a sequence of latlong maps")
    parser.add_argument("--frames", type=positive, metavar="N", help="the first N of it (all)")


def frames_given(parser: argparse.ArgumentParser, options: argparse.Namespace) -> list[Tensor]:
    """Read the frames of the sequence of `add_sequence`.

    Args:
        parser: Of the script.
        options: What it parsed.

    Returns:
        Repaired radiance [H, 2 H, 3] of each.

    Raises:
        SystemExit: It cannot be read, or has fewer than two frames; one line says so.
    """
    with refused_in_a_line(parser):
        sequence = open_sequence(options.sequence)
        maps = [sequence.read(frame).radiance for frame in sequence.frames[: options.frames]]
    if len(maps) < 2:
        parser.error(f"{options.sequence}: {len(maps)} frame; expected two or more to follow")
    return maps


def read_text(path: Path, expected: str) -> str:
    """Read a text file that is given.

    Args:
        path: The file.
        expected: What it is to be, and how it comes to be that, in a message.

    Raises:
        InputError: It is no file, or cannot be read.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise InputError(f"{shown(path)}: is no file; expected {expected}")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{shown(path)}: {error.strerror}; expected {expected}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{shown(path)}: is no text; expected {expected}") from error
