# SPDX-License-Identifier: Apache-2.0
"""Whether a file is written beside its target and renamed, or in place."""

import os
from pathlib import Path


def old_files(folder: Path, *names: str) -> list[Path]:
    """Write a file of each name, and return second links to them.

    A file that is renamed to the target leaves the old one whole, one written in place does not.
    """
    folder.mkdir(parents=True, exist_ok=True)
    links = []
    for name in names:
        (folder / name).write_text("old")
        links.append(folder / f"{name}.kept")
        os.link(folder / name, links[-1])
    return links
