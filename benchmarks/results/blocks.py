# SPDX-License-Identifier: Apache-2.0
"""Blocks: what a command made in a page, between two comments that name the command.

    <!-- made by: python -m benchmarks.some --maps ../shared/hdri [some.1] -->

    | map | error |
    ...

    <!-- end -->

`some.1` is the first table of the part `some` (parts.toml), `some.page` a file that it wrote,
`some.picture` a link to a picture that it drew.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

START = re.compile(r"^<!-- made by: (?P<command>.+) \[(?P<name>[\w-]+\.\w+)\] -->$")
END = "<!-- end -->"

NUMBER = re.compile(r"[-+]?[\d.,]*\d[\d.,]*(e[-+]?\d+)?(\W|$)")
"""How a cell of a number begins; what follows may be a unit, a bracket or a second number."""

NUMBERS_SHARE = 0.25
"""Share of the cells below a head from which a table is one of numbers. Tables that explain have
limits and defaults in a cell or two of a row; those of measurements have a column of names."""


@dataclass(frozen=True)
class Block:
    """What a command made in a page.

    Attributes:
        name: `PART.N`, `PART.page` or `PART.picture`.
        command: As the page names it.
        content: The lines between the comments, without empty ones around them.
    """

    name: str
    command: str
    content: str

    def text(self) -> str:
        """Return the block as it stands in a page."""
        # with empty lines: a comment and a table would be one block of HTML to some readers
        return f"<!-- made by: {self.command} [{self.name}] -->\n\n{self.content}\n\n{END}"


def pieces(page: str) -> Iterator[str | Block]:
    """Cut a page into its blocks and the text between them.

    Raises:
        ValueError: A block has no end, or an end has no block.
    """
    held: list[str] = []
    start: re.Match[str] | None = None
    for line in page.split("\n"):
        found = START.match(line)
        if found is not None and start is not None:
            raise ValueError(f"{start['name']}: has no {END} before {found['name']}")
        if found is not None:
            yield from ["\n".join(held)] if held else []
            held, start = [], found
        elif line == END and start is None:
            raise ValueError(f"{END} without a block before it")
        elif line == END and start is not None:
            yield Block(start["name"], start["command"], "\n".join(held).strip("\n"))
            held, start = [], None
        else:
            held.append(line)
    if start is not None:
        raise ValueError(f"{start['name']}: has no {END}")
    yield from ["\n".join(held)] if held else []


def blocks(page: str) -> list[Block]:
    """Return the blocks of a page."""
    return [piece for piece in pieces(page) if isinstance(piece, Block)]


def with_blocks(page: str, change: Callable[[Block], Block]) -> str:
    """Return a page with each of its blocks changed, and the text between them as it was."""
    return "\n".join(
        change(piece).text() if isinstance(piece, Block) else piece for piece in pieces(page)
    )


def tables(markdown: str) -> list[str]:
    """Return the tables of a text in Markdown, in their order."""
    found: list[list[str]] = []
    previous = ""
    for line in markdown.split("\n"):
        if line.startswith("|"):
            if not previous.startswith("|"):
                found.append([])
            found[-1].append(line.rstrip())
        previous = line
    return ["\n".join(lines) for lines in found]


def is_of_numbers(table: str) -> bool:
    """Tell whether a table holds measurements: many of its cells begin with a number."""
    rows = [line.strip("|").split("|") for line in table.split("\n")[2:]]
    cells = [cell.strip(" *`~<>≤×x±") for row in rows for cell in row]
    return sum(bool(NUMBER.match(cell)) for cell in cells) >= NUMBERS_SHARE * max(len(cells), 1)


def loose_numbers(page: str) -> list[str]:
    """Return the heads of the tables of numbers that no block names the command of."""
    text = "\n".join(piece for piece in pieces(page) if isinstance(piece, str))
    return [table.split("\n")[0] for table in tables(text) if is_of_numbers(table)]
