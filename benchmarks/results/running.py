# SPDX-License-Identifier: Apache-2.0
"""Run a part and put what it made into the pages."""

import datetime
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from asglight.judging.machine import machine
from benchmarks.results.blocks import Block, blocks, loose_numbers, with_blocks
from benchmarks.results.parts import Part
from benchmarks.results.readers import read_tables

PAGES = ("README.md", "docs/results/*.md")
"""Whose tables of numbers all have a command."""

NOTE = "*Made by `"
"""How the line below a table begins that says the command, the machine and the commit."""


class PartError(Exception):
    """A part could not be made; the message says why."""


@dataclass(frozen=True)
class Where:
    """The machine and the state of the sources, as a page says it."""

    machine: str
    commit: str
    day: str

    def note(self, command: str) -> str:
        """Return the line below a table."""
        return f"{NOTE}{command}`, on {self.machine}, at commit {self.commit}, {self.day}.*"


def here(root: Path) -> Where:
    """Return where and when something is measured now."""
    at = machine()
    commit = _git(root, "rev-parse", "--short", "HEAD")
    changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    return Where(
        f"{at['processor']}, {at['cores']} cores",
        f"{commit} and changes after it" if changed else commit,
        datetime.date.today().isoformat(),
    )


def _git(root: Path, *words: str) -> str:
    found = subprocess.run(["git", "-C", root, *words], capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def pages(root: Path) -> list[Path]:
    """Return the pages that hold results."""
    return [path for pattern in PAGES for path in sorted(root.glob(pattern))]


def complaints(root: Path, parts: dict[str, Part]) -> list[str]:
    """Return what is wrong with the pages: numbers without a command, blocks without a part."""
    found: list[str] = []
    named: set[str] = set()
    for path in pages(root):
        text = path.read_text()
        found += [f"{path.name}: no command for the table {head}" for head in loose_numbers(text)]
        for block in blocks(text):
            part, _, what = block.name.partition(".")
            named.add(part)
            if part not in parts:
                found.append(f"{path.name}: [{block.name}]: parts.toml has no such part")
            elif block.command != parts[part].shown():
                found.append(f"{path.name}: [{block.name}]: names another command than parts.toml")
            elif what.isdecimal() and not 1 <= int(what) <= parts[part].tables:
                found.append(f"{path.name}: [{block.name}]: the part has no such table")
    return found + [f"parts.toml: {name}: is in no page" for name in parts if name not in named]


def renamed(root: Path, parts: dict[str, Part]) -> None:
    """Write the commands of parts.toml into the comments of all blocks; nothing is run."""
    for path in pages(root):
        text = path.read_text()
        path.write_text(
            with_blocks(
                text,
                {
                    block.name: Block(block.name, parts[name].shown(), block.content)
                    for block in blocks(text)
                    if (name := block.name.partition(".")[0]) in parts
                },
            )
        )


def make(part: Part, root: Path, places: dict[str, str], output: Path, where: Where) -> None:
    """Run the commands of a part, and write what they made into the pages.

    Raises:
        PartError: A command failed, or made something else than the part says.
    """
    output.mkdir(parents=True, exist_ok=True)
    printed = ""
    for words in part.words(places, output):
        run = subprocess.run(words, cwd=root, stdout=subprocess.PIPE, text=True, check=False)
        printed = run.stdout
        if run.returncode:
            raise PartError(f"{' '.join(words)}: ended with status {run.returncode}")
    (output / "stdout.txt").write_text(printed)
    content = _contents(part, output, printed)
    for target, source in part.pictures.items():
        if not (output / source).is_file():
            raise PartError(f"drew no {source}")
        shutil.copyfile(output / source, root / target)
    note = where.note(part.shown())
    for path in pages(root):
        text = path.read_text()
        made = {
            block.name: Block(
                block.name,
                part.shown(),
                f"{content.get(block.name, _without_note(block.content))}\n\n{note}",
            )
            for block in blocks(text)
            if block.name.partition(".")[0] == part.name
        }
        path.write_text(with_blocks(text, made))


def _contents(part: Part, output: Path, printed: str) -> dict[str, str]:
    """Return what the blocks of a part hold; a picture's block keeps its link."""
    made: dict[str, str] = {}
    if part.page is not None:
        made[f"{part.name}.page"] = (output / part.page).read_text().strip()
    if part.tables:
        text = printed if part.source == "stdout" else (output / part.source).read_text()
        found = read_tables(text, Path(part.source).suffix, part.reader)
        if len(found) != part.tables:
            raise PartError(f"made {len(found)} tables; parts.toml says {part.tables}")
        made |= {f"{part.name}.{index}": table for index, table in enumerate(found, 1)}
    return made


def _without_note(content: str) -> str:
    return "\n".join(line for line in content.split("\n") if not line.startswith(NOTE)).rstrip()
