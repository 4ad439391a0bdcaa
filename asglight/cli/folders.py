# SPDX-License-Identifier: Apache-2.0
"""Folders that a command writes into, and the text files that it writes there."""

import json
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.images.output import written_beside


def made_folder(folder: Path) -> Path:
    """Return the folder, made where it is not there.

    Raises:
        InputError: It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{shown(folder)}: cannot be made ({error.strerror}); expected a folder to write into. "
            "Choose another with -o."
        ) from error
    return folder


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all.

    Raises:
        InputError: It cannot be written there.
    """
    with written_beside(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document, whole or not at all.

    Raises:
        InputError: It cannot be written there.
        ValueError: It holds a number that JSON has not.
    """
    write_text(path, f"{json.dumps(document, indent=1, allow_nan=False)}\n")
