# SPDX-License-Identifier: Apache-2.0
"""What a folder offers to open, as an artist looks for it: a sequence is one thing."""

import os
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from asglight.errors import InputError
from asglight.images.frame_files import sources_in
from asglight.images.message import shown
from asglight.usd.options import STAGE_SUFFIXES
from asglight.viewer.io.wanted import SUFFIXES
from asglight.viewer.state.views import RENDERS, Request


class Kind(StrEnum):
    """What an entry is."""

    FOLDER = "folder"
    STAGE = "stage"
    SEQUENCE = "sequence"
    IMAGE = "image"
    FILE = "file"


@dataclass(frozen=True)
class Entry:
    """One line of a folder.

    Attributes:
        title: What it is called: `sky.####.exr 1001-1048` for a sequence.
        path: What opens it: a pattern for a sequence.
        kind: What it is.
    """

    title: str
    path: str
    kind: Kind


@dataclass
class Browser:
    """Where the file browser stands.

    Attributes:
        request: What the file is for.
        folder: The folder that is shown.
        name: The name under which to save, or the entry to open.
        suffix: What a saved name ends with; empty while opening.
        finding: Why the folder cannot be listed; empty where it can.
        entries: What it holds.
    """

    request: Request
    folder: Path
    name: str = ""
    suffix: str = ""
    finding: str = ""
    entries: list[Entry] = field(default_factory=list)

    def __post_init__(self) -> None:
        """List the folder."""
        self.go_to(self.folder)

    @property
    def is_saving(self) -> bool:
        """Whether a file is to be written."""
        return self.request not in (Request.OPEN, Request.OPEN_AGAINST)

    @property
    def target(self) -> Path:
        """The file that would be saved."""
        name = self.name.strip()
        may_be = SUFFIXES if self.request in RENDERS else (self.suffix,)
        if self.suffix and not name.lower().endswith(may_be):
            name += self.suffix
        return self.folder / name

    def go_to(self, folder: Path) -> None:
        """Show another folder; one that cannot be listed leaves its reason."""
        self.finding = ""
        try:
            self.entries = listed(folder, self.suffix)
        except InputError as error:
            self.finding = str(error)
            return
        self.folder = folder
        if not self.is_saving:
            self.name = ""


def listed(folder: Path, suffix: str = "") -> list[Entry]:
    """Return what a folder holds: folders, then stages, then sequences and images.

    Args:
        folder: The folder; hidden names in it are left out.
        suffix: Where a file is to be saved, what it ends with: only such files are listed.

    Raises:
        InputError: It cannot be listed.
    """
    try:
        names = sorted(os.listdir(folder), key=str.casefold)
        sources = [] if suffix else sources_in(folder)
    except OSError as error:
        raise InputError(
            f"{shown(folder)}: cannot be listed ({error.strerror}); expected a readable folder. "
            "Check the path and the permissions."
        ) from error
    seen = [name for name in names if not name.startswith(".")]
    folders = [name for name in seen if os.path.isdir(folder / name)]
    files = [name for name in seen if name not in set(folders)]
    entries = [Entry(f"{name}/", str(folder / name), Kind.FOLDER) for name in folders]
    if suffix:
        chosen = [name for name in files if name.lower().endswith(suffix)]
        return entries + [Entry(name, str(folder / name), Kind.FILE) for name in chosen]
    stages = [name for name in files if name.lower().endswith(tuple(STAGE_SUFFIXES))]
    entries += [Entry(name, str(folder / name), Kind.STAGE) for name in stages]
    for title, path in sources:
        kind = Kind.IMAGE if os.path.exists(path) else Kind.SEQUENCE
        entries.append(Entry(title, path, kind))
    return entries
