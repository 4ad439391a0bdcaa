# SPDX-License-Identifier: Apache-2.0
"""Shaders for the driver, and the driver's messages about them.

A table of where each line came from turns the driver's messages back into the file and line that
the reader can open; `#line` does not serve, because Mesa forgets its file number in the message
that matters most, "undeclared".
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import moderngl

from asglight.shader_files import Line, ShaderError, included_lines, shader_folder

_VERSION = re.compile(r"^\s*#\s*version\s+\d+")
# Mesa `0:31(5): error: x`, NVIDIA `0(31) : error C1: x`, Apple, AMD and Intel `ERROR: 0:31: x`
_MESSAGE = re.compile(
    r"^(?:(?P<kind>ERROR|WARNING): )?0(?::(?P<line>\d+)(?:\(\d+\))?|\((?P<paren>\d+)\))"
    r"\s*:\s*(?P<text>.*)$"
)


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


def fragment_shaders() -> list[str]:
    """Return the names of all passes, as `expanded` takes them."""
    return sorted(path.name for path in shader_folder().glob("*.frag"))


def expanded(
    name: str,
    defines: Mapping[str, float] | None = None,
    folder: Path | None = None,
    before: str = "",
) -> ShaderSource:
    """Read a shader file and expand its includes.

    Args:
        name: File name, relative to the folder.
        defines: Constants for `#define`.
        folder: Where the names start; by default `shader_folder()`.
        before: GLSL that stands before the file's.

    Raises:
        ShaderError: A file is missing, or there is no `#version`.
    """
    lines = included_lines(name, folder)
    version = next((line for line in lines if _VERSION.match(line.text)), None)
    if version is None:
        raise ShaderError(f"shaders/{name}: no #version; expected one in every shader stage.")
    lines.remove(version)
    constants = [
        Line(f"#define {key} {value}", f"constant {key}") for key, value in (defines or {}).items()
    ]
    generated = [
        Line(text, f"generated:{number}") for number, text in enumerate(before.splitlines(), 1)
    ]
    return ShaderSource((version, *constants, *generated, *lines))


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
