# SPDX-License-Identifier: Apache-2.0
"""What is measured, by which commands: parts.toml."""

import shlex
import sys
import tomllib
from dataclasses import dataclass, field, fields
from glob import glob
from itertools import chain
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.message import shown
from benchmarks.given import read_text

PARTS_FILE = Path(__file__).with_name("parts.toml")

PLACES = {
    "maps": "../shared/hdri",
    "sequences": "../shared/sequences",
    "sequences2x": "../shared/sequences2x",
}
"""Folders as pages name them, beside the repository; options of the command say others."""


@dataclass(frozen=True)
class Part:
    """Commands that are run together, and what they leave.

    Attributes:
        name: Of the part, as `make results PART=` takes it.
        commands: In their order; a {name} is a place, {output} the part's own folder.
        source: What holds the tables: `stdout` of the last command, in Markdown or as the JSON that
            `reader` understands, or a file in the output folder.
        reader: Function of readers.py that makes tables of JSON; None for Markdown and HTML.
        page: File in the output folder that a block `NAME.page` takes as a whole.
        pictures: By their path in the repository, the file in the output folder, or its pattern.
        minutes: Of two cores, about.
    """

    name: str
    commands: tuple[str, ...]
    source: str = "stdout"
    reader: str | None = None
    page: str | None = None
    pictures: dict[str, str] = field(default_factory=dict)
    minutes: float = 1.0

    def shown(self) -> str:
        """Return the commands as a page names them."""
        places = {**PLACES, "output": f"results-output/{self.name}"}
        return " && ".join(command.format(**places) for command in self.commands)

    def words(self, places: dict[str, str], output: Path, root: Path) -> list[list[str]]:
        """Return the commands as they are run, by this Python; paths are relative to the root."""
        filled = [command.format(**places, output=output) for command in self.commands]
        return [_by_this_python(shlex.split(command), root) for command in filled]


def _by_this_python(words: list[str], root: Path) -> list[str]:
    """Return a command as it is run: patterns of files expanded, programs those of this Python."""
    own = {
        "python": [sys.executable],
        "asglight": [sys.executable, "-c", "from asglight.cli.main import main as m; exit(m())"],
    }
    files = [sorted(glob(word, root_dir=root)) or [word] for word in words[1:]]
    return [*own.get(words[0], [words[0]]), *chain.from_iterable(files)]


def read_parts(path: Path = PARTS_FILE) -> dict[str, Part]:
    """Read the parts by their names.

    Raises:
        InputError: It cannot be read, or is none.
    """
    expected = "the parts as TOML. Without --parts-file those of the repository are read."
    text = read_text(path, expected)
    try:
        parts = tomllib.loads(text)
    except ValueError as error:
        raise InputError(f"{shown(path)}: is no TOML; expected {expected}") from error
    return {name: _part(path, name, entry) for name, entry in parts.items()}


def _part(path: Path, name: str, entry: Any) -> Part:
    """Return a part as the file has it.

    Raises:
        InputError: It has no list of commands, or something that no part has.
    """
    is_part = isinstance(entry, dict) and isinstance(entry.get("commands"), list)
    if not is_part or not set(entry) <= {each.name for each in fields(Part)} - {"name"}:
        raise InputError(
            f"{shown(path)}: {shown(name)}: is no part; expected commands and what they leave. "
            "Correct the entry."
        )
    return Part(name, tuple(entry.pop("commands")), **entry)


def chosen(parts: dict[str, Part], names: list[str]) -> list[Part]:
    """Return the parts of these names, all where none is named.

    Raises:
        InputError: There is no such part.
    """
    unknown = [name for name in names if name not in parts]
    if unknown:
        raise InputError(f"part: {unknown[0]!r}; expected some of {', '.join(parts)}.")
    return [parts[name] for name in names or parts]
