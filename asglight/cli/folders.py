# SPDX-License-Identifier: Apache-2.0
"""Folders that a command writes into."""

from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown


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
