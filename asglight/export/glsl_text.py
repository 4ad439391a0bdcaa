# SPDX-License-Identifier: Apache-2.0
"""Taking the text of shaders/ apart: what a scene needs of it, under names of its own.

It relies on how shaders/ is written: what a file defines starts in the first column, and a blank
line parts it from comments that belong to nothing.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

_DEFINITION = re.compile(r"^(?:struct (?P<struct>\w+)|(?:const )?\w+ (?P<name>\w+)\s*[(\[=])")
_CONDITION = re.compile(r"^\s*#\s*(?P<kind>ifdef|ifndef|else|endif)\b\s*(?P<name>\w*)")
# Not the name of a Python file in a comment.
_WORD = re.compile(r"\b[A-Za-z_]\w*\b(?!\.py)")


class Block(NamedTuple):
    """A function, a struct or a constant.

    Attributes:
        name: What it defines.
        text: Its lines and the comment above it.
    """

    name: str
    text: str

    @property
    def words(self) -> set[str]:
        """The identifiers in it, comments left out."""
        return set(_WORD.findall(re.sub(r"//.*", "", self.text)))


def resolved(lines: Iterable[str], defined: Collection[str]) -> list[str]:
    """Keep of each `#ifdef` and `#ifndef` the side that holds; they may nest."""
    kept: list[str] = []
    sides: list[bool] = []
    for line in lines:
        match = _CONDITION.match(line)
        if match is None:
            if all(sides):
                kept.append(line)
        elif match["kind"] == "else":
            sides[-1] = not sides[-1]
        elif match["kind"] == "endif":
            sides.pop()
        else:
            sides.append((match["name"] in defined) == (match["kind"] == "ifdef"))
    return kept


def blocks(lines: Iterable[str]) -> list[Block]:
    """Take lines apart; comments that belong to no definition are dropped.

    Raises:
        ValueError: A line is neither a comment nor part of a definition, or one has no end.
    """
    found: list[Block] = []
    pending: list[str] = []
    name, depth = "", 0
    for line in lines:
        code = line.split("//")[0].rstrip()
        if not name:
            if not code:
                pending = [*pending, line] if line.strip() else []
                continue
            match = _DEFINITION.match(code)
            if match is None:
                raise ValueError(f"no definition: {line}")
            name = match["struct"] or match["name"]
        pending.append(line)
        depth += sum(map(code.count, "({[")) - sum(map(code.count, ")}]"))
        if depth == 0 and code.endswith((";", "}")):
            found.append(Block(name, "\n".join(pending)))
            pending, name = [], ""
    if name:
        raise ValueError(f"no end: {name}")
    return found


def reached(every: Sequence[Block], roots: Iterable[str]) -> list[Block]:
    """Return the blocks that the roots need, themselves included, in their order."""
    wanted = set(roots)
    while True:
        chosen = [block for block in every if block.name in wanted]
        grown = wanted.union(*(block.words for block in chosen))
        if grown == wanted:
            return chosen
        wanted = grown


def prefixed(names: Iterable[str]) -> dict[str, str]:
    """Return names that are unlikely to meet those of another shader: `PI` becomes `ASG_PI`."""
    return {name: _prefix(name) + name for name in names if not name.lower().startswith("asg")}


def renamed(text: str, names: Mapping[str, str]) -> str:
    """Replace identifiers, those in comments too."""
    return _WORD.sub(lambda match: names.get(match[0], match[0]), text)


def _prefix(name: str) -> str:
    if name.isupper():
        return "ASG_"
    return "Asg" if name[0].isupper() else "asg_"
