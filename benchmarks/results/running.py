# SPDX-License-Identifier: Apache-2.0
"""Run a part and put what it made into the pages."""

import contextlib
import datetime
import os
import shutil
import subprocess
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from asglight.cli.folders import write_text
from asglight.images.output import written_beside
from asglight.judging.machine import machine
from benchmarks.results.blocks import Block, blocks, loose_numbers, with_blocks
from benchmarks.results.parts import Part
from benchmarks.results.readers import read_tables

PAGES = ("README.md", "docs/results/*.md")
"""Whose tables of numbers all have a command."""

NOTE = "*Made by `"
"""How the line below a table begins that says the command, the machine and the commit."""

HIDDEN = "<!-- Made by `"
"""How it begins in README.md, whose readers came for the picture."""


class PartError(Exception):
    """A part could not be made; the message says why."""


@dataclass(frozen=True)
class Where:
    """The machine and the state of the sources, as a page says it."""

    machine: str
    commit: str
    day: str

    def note(self, command: str, *, is_hidden: bool = False) -> str:
        """Return the line below a table."""
        start, end = (HIDDEN, ". -->") if is_hidden else (NOTE, ".*")
        return f"{start}{command}`, on {self.machine}, at commit {self.commit}, {self.day}{end}"


def here(root: Path) -> Where:
    """Return where and when something is measured now."""
    at = machine()
    commit = _git(root, "rev-parse", "--short", "HEAD") or "unknown"
    sources = (".", ":!docs", ":!README.md")  # pages change while parts are made
    changed = _git(root, "status", "--porcelain", "--untracked-files=no", "--", *sources)
    return Where(
        f"{at['processor']}, {at['cores']} cores",
        f"{commit} and changes after it" if changed else commit,
        datetime.date.today().isoformat(),
    )


def _git(root: Path, *words: str) -> str:
    found = subprocess.run(["git", "-C", root, *words], capture_output=True, text=True, check=False)
    return found.stdout.strip()


def pages(root: Path) -> list[Path]:
    """Return the pages that hold results."""
    return [path for pattern in PAGES for path in sorted(root.glob(pattern))]


def broken(root: Path) -> list[str]:
    """Return which pages have a block without its end, or an end without its block."""
    found: list[str] = []
    for path in pages(root):
        try:
            blocks(path.read_text())
        except ValueError as error:
            found.append(f"{path.name}: {error}")
    return found


def complaints(root: Path, parts: dict[str, Part]) -> list[str]:
    """Return what is wrong with the pages: numbers without a command, blocks without a part."""
    found = broken(root)
    if found:
        return found
    named: set[str] = set()
    for path in pages(root):
        text = path.read_text()
        found += [f"{path.name}: no command for the table {head}" for head in loose_numbers(text)]
        for block in blocks(text):
            part = block.name.partition(".")[0]
            named.add(part)
            if part not in parts:
                found.append(f"{path.name}: [{block.name}]: parts.toml has no such part")
            elif block.command != parts[part].shown():
                found.append(f"{path.name}: [{block.name}]: names another command than parts.toml")
    return found + [f"parts.toml: {name}: is in no page" for name in parts if name not in named]


def renamed(root: Path, parts: dict[str, Part]) -> None:
    """Write the commands of parts.toml into the comments of all blocks; nothing is run."""

    def change(block: Block) -> Block:
        name = block.name.partition(".")[0]
        return replace(block, command=parts[name].shown()) if name in parts else block

    for path in pages(root):
        write_text(path, with_blocks(path.read_text(), change))


def make(part: Part, root: Path, places: dict[str, str], output: Path, where: Where) -> None:
    """Run the commands of a part, and write what they made into the pages.

    Raises:
        PartError: A command failed, or made something else than the part says.
    """
    output.mkdir(parents=True, exist_ok=True)
    left = _stamps(output)  # by an earlier run
    printed = ""
    for words in part.words(places, Path(os.path.relpath(output, root)), root):
        try:
            run = subprocess.run(words, cwd=root, stdout=subprocess.PIPE, text=True, check=False)
        except OSError as error:
            raise PartError(f"{words[0]}: {error.strerror}") from error
        printed = run.stdout
        if run.returncode:
            raise PartError(f"{' '.join(words)}: ended with status {run.returncode}")
    write_text(output / "stdout.txt", printed)
    new = {path for path, stamp in _stamps(output).items() if left.get(path) != stamp}
    content = _contents(part, output, printed, new)
    missing = _asked(part, root) - content.keys()
    if missing:
        raise PartError(f"made no {', '.join(sorted(missing))}")
    drawn = {root / target: _newly(source, output, new) for target, source in part.pictures.items()}
    changed: dict[Path, str] = {}
    for path in pages(root):
        before, note = path.read_text(), where.note(part.shown(), is_hidden=path.parent == root)
        after = with_blocks(before, partial(_made, part, content, note))
        changed |= {path: after} if after != before else {}
    _put(changed, drawn)


def _put(changed: dict[Path, str], drawn: dict[Path, Path]) -> None:
    """Write pages and the pictures they show: all beside their targets, then all are renamed.

    Args:
        changed: Text by page.
        drawn: What a picture is copied from, by picture.
    """
    with contextlib.ExitStack() as renamed_last_first:
        for page, text in changed.items():
            beside = renamed_last_first.enter_context(written_beside(page))
            beside.write_text(text, encoding="utf-8")
        for picture, source in drawn.items():
            picture.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, renamed_last_first.enter_context(written_beside(picture)))


def _stamps(folder: Path) -> dict[Path, int]:
    """Return when each file of a folder was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def _newly(pattern: str, output: Path, new: set[Path]) -> Path:
    """Return the file of a pattern that a part has just made.

    Raises:
        PartError: There is none, or one of an earlier run.
    """
    made = [path for path in sorted(output.glob(pattern)) if path in new]
    if not made:
        raise PartError(f"made no {pattern}")
    return made[0]


def _made(part: Part, content: dict[str, str], note: str, block: Block) -> Block:
    """Return a block with what its part made, if it is of that part."""
    if block.name.partition(".")[0] != part.name:
        return block
    made = content.get(block.name, _without_note(block.content))
    return Block(block.name, part.shown(), f"{made}\n\n{note}")


def _asked(part: Part, root: Path) -> set[str]:
    """Return the names of the blocks that the pages have of a part, but those of pictures."""
    names = {block.name for path in pages(root) for block in blocks(path.read_text())}
    return {name for name in names if name.startswith(f"{part.name}.")} - {f"{part.name}.picture"}


def _contents(part: Part, output: Path, printed: str, new: set[Path]) -> dict[str, str]:
    """Return what the blocks of a part hold; a picture's block keeps its link.

    Raises:
        PartError: A file was not made, or is not what the part says.
    """
    made: dict[str, str] = {}
    if part.page is not None:
        made[f"{part.name}.page"] = _newly(part.page, output, new).read_text().strip()
    is_printed = part.source == "stdout"
    text = printed if is_printed else _newly(part.source, output, new).read_text()
    try:
        found = read_tables(text, Path(part.source).suffix, part.reader)
    except ValueError as error:
        raise PartError(f"{part.source}: {error}; expected JSON for {part.reader}") from error
    made |= {f"{part.name}.{index}": table for index, table in enumerate(found, 1)}
    return made


def _without_note(content: str) -> str:
    return "\n".join(
        line for line in content.split("\n") if not line.startswith((NOTE, HIDDEN))
    ).rstrip()
