# SPDX-License-Identifier: Apache-2.0
"""Shader files: where they are, what they include, and the driver's messages about them.

GLSL has no `#include`. Here it is expanded, nested and each file once. A table of where each line
came from turns the driver's messages back into the file and line that the reader can open; `#line`
does not serve, because Mesa forgets its file number in the message that matters most, "undeclared".
"""

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import moderngl

VERTEX_SHADER = "fullscreen.vert"

_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"\s*(?://.*)?$')
_VERSION = re.compile(r"^\s*#\s*version\s+\d+")
# Mesa `0:31(5): error: x`, NVIDIA `0(31) : error C1: x`, Apple, AMD and Intel `ERROR: 0:31: x`
_MESSAGE = re.compile(
    r"^(?:(?P<kind>ERROR|WARNING): )?0(?::(?P<line>\d+)(?:\(\d+\))?|\((?P<paren>\d+)\))"
    r"\s*:\s*(?P<text>.*)$"
)


class ShaderError(RuntimeError):
    """A shader cannot be assembled, or the driver refuses it."""


class Line(NamedTuple):
    """One line of GLSL and the place, `shaders/file:line`, that it was written in."""

    text: str
    place: str


@dataclass(frozen=True)
class ShaderSource:
    """GLSL ready for the driver.

    Attributes:
        lines: The lines in the order of compilation; the first is `#version`.
    """

    lines: tuple[Line, ...]

    @property
    def text(self) -> str:
        """The one string that the driver takes."""
        return "".join(f"{line.text}\n" for line in self.lines)


@functools.cache
def shader_folder() -> Path:
    """Return the folder of the shaders: in an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "shaders", package.parent / "shaders"):
        if (folder / VERTEX_SHADER).is_file():
            return folder
    raise ShaderError(
        f"shaders: no {VERTEX_SHADER} in {package / 'shaders'} or {package.parent / 'shaders'}; "
        "expected the shaders of asglight there. Is the installation complete?"
    )


def fragment_shaders() -> list[str]:
    """Return the names of all passes, as `expanded` takes them."""
    return sorted(path.name for path in shader_folder().glob("*.frag"))


def enum_defines(enum: type[Enum]) -> dict[str, int]:
    """Number the members of an enum: `ViewTransform.SRGB` gives `VIEW_TRANSFORM_SRGB`."""
    prefix = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", enum.__name__).upper()
    return {f"{prefix}_{member.name}": enum_number(member) for member in enum}


def enum_number(member: Enum) -> int:
    """Return the number that stands for an enum member in GLSL: its place in the enum."""
    return list(type(member)).index(member)


def expanded(
    name: str, defines: Mapping[str, float] | None = None, folder: Path | None = None
) -> ShaderSource:
    """Read a shader file and expand its includes.

    Args:
        name: File name, relative to the folder.
        defines: Constants for `#define`.
        folder: Where the names start; by default `shader_folder()`.

    Raises:
        ShaderError: A file is missing, or there is no `#version`.
    """
    folder = shader_folder() if folder is None else folder
    lines = _expanded_lines(name, folder, seen=set(), asked_by="")
    version = next((line for line in lines if _VERSION.match(line.text)), None)
    if version is None:
        raise ShaderError(f"shaders/{name}: no #version; expected one in every shader stage.")
    lines.remove(version)
    constants = [
        Line(f"#define {key} {value}", f"constant {key}") for key, value in (defines or {}).items()
    ]
    return ShaderSource((version, *constants, *lines))


def program(
    context: moderngl.Context, vertex: ShaderSource, fragment: ShaderSource
) -> moderngl.Program:
    """Compile and link a program.

    Raises:
        ShaderError: The driver refuses it; each message names the file and the line.
    """
    try:
        return context.program(vertex_shader=vertex.text, fragment_shader=fragment.text)
    except moderngl.Error as error:
        message = str(error)
        stage = vertex if "\nvertex_shader\n" in message else fragment
        raise ShaderError(readable(message, stage)) from error


def readable(message: str, source: ShaderSource) -> str:
    """Turn a driver's message into lines of `shaders/file:line: what is wrong`.

    Args:
        message: What moderngl raises: a heading, the stage, then the driver's own lines. Without
            a line that names a place, as from a linker, it is returned as it is.
        source: What was compiled.
    """
    located = []
    for match in filter(None, map(_MESSAGE.match, message.splitlines())):
        number = int(match["line"] or match["paren"])
        # A missing brace is found one line after the last.
        place = source.lines[min(number, len(source.lines)) - 1].place
        kind = f"{match['kind'].lower()}: " if match["kind"] else ""
        located.append(f"{place}: {kind}{match['text']}")
    return "\n".join(located) or message.strip()


def _expanded_lines(name: str, folder: Path, seen: set[str], asked_by: str) -> list[Line]:
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
            lines += _expanded_lines(match[1], folder, seen, asked_by=place)
    return lines
