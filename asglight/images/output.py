# SPDX-License-Identifier: Apache-2.0
"""One file written beside its target and renamed, so that a failure leaves the target as it was."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown


def check_names_file(path: str | Path) -> None:
    """Refuse the name of a folder, such as `shot.usda/`: as a path it would be that of a file.

    Raises:
        InputError: It ends with a slash.
    """
    if str(path).endswith(("/", os.sep)):
        raise InputError(
            f"{shown(path)}: names a folder; expected a file to write. Leave out the last slash."
        )


@contextlib.contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Give a place for a file in its target's folder; rename it to the target at the end.

    Args:
        path: The target; its folder must exist.

    Yields:
        Where to write the file first.

    Raises:
        InputError: An OSError within: the file cannot be written there.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(
            f"{shown(path)}: is a pipe or a device; expected a file to write. Without -o many "
            "commands print what they have."
        )
    # A name of its own, so that two writers of one target do not meet; hidden from folder scans.
    temporary = path.parent / f".asglight-{secrets.token_hex(4)}{path.suffix}"
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({_reason(path, error)}); expected a folder with "
            "room and the permission to write. Check the output path."
        ) from error
    finally:
        # Nothing to remove after success or in a folder that is none; the error above says more.
        with contextlib.suppress(OSError):
            temporary.unlink()


def _reason(path: Path, error: OSError) -> str:
    if not path.parent.is_dir():
        return f"no folder {shown(path.parent)}"
    return error.strerror or str(error) or type(error).__name__
