# SPDX-License-Identifier: Apache-2.0
"""The files of shaders/: where they are, what they include, the numbers that stand for enums.

GLSL has no `#include`. Here it is expanded, nested and each file once.
"""

import functools
import re
from enum import Enum
from pathlib import Path
from typing import NamedTuple

VERTEX_SHADER = "fullscreen.vert"
"""The vertex stage of every pass; by it the folder is known."""

_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"\s*(?://.*)?$')


class ShaderError(RuntimeError):
    """A shader cannot be assembled, or the driver refuses it."""


class Line(NamedTuple):
    """One line of GLSL and the place, `shaders/file:line`, that it was written in."""

    text: str
    place: str


@functools.cache
def shader_folder() -> Path:
    """Return the folder of the shaders: in an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    for folder in (package / "shaders", package.parent / "shaders"):
        if (folder / VERTEX_SHADER).is_file():
            return folder
    raise ShaderError(
        f"shaders: no {VERTEX_SHADER} in {package / 'shaders'} or {package.parent / 'shaders'}; "
        "expected the shaders of asglight there. Is the installation complete?"
    )


def included_lines(name: str, folder: Path | None = None) -> list[Line]:
    """Read a shader file with its includes in place.

    Args:
        name: File name, relative to the folder.
        folder: Where the names start; by default `shader_folder()`.

    Raises:
        ShaderError: A file is missing.
    """
    folder = shader_folder() if folder is None else folder
    return _included_lines(name, folder, seen=set(), asked_by="")


def enum_defines(enum: type[Enum]) -> dict[str, int]:
    """Number the members of an enum: `ViewTransform.SRGB` gives `VIEW_TRANSFORM_SRGB`."""
    prefix = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", enum.__name__).upper()
    return {f"{prefix}_{member.name}": enum_number(member) for member in enum}


def enum_number(member: Enum) -> int:
    """Return the number that stands for an enum member in GLSL: its place in the enum."""
    return list(type(member)).index(member)


def _included_lines(name: str, folder: Path, seen: set[str], asked_by: str) -> list[Line]:
    """Return a file's lines with its includes in place; `seen` collects what was read."""
    seen.add(name)
    try:
        text = (folder / name).read_text(encoding="utf-8")
    except OSError as error:
        raise ShaderError(
            f"{asked_by or f'shaders/{name}'}: {name} cannot be read ({error.strerror}); "
            f"expected a file in {folder}."
        ) from error
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        place = f"shaders/{name}:{number}"
        match = _INCLUDE.match(line)
        if match is None:
            lines.append(Line(line, place))
        elif match[1] not in seen:
            lines += _included_lines(match[1], folder, seen, asked_by=place)
    return lines
