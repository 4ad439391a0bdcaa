# SPDX-License-Identifier: Apache-2.0
"""The files that a session is read from, which no picture may replace."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.usd.read.files import files_of
from asglight.viewer.state.session import Session

_Identity = tuple[int, int]
"""Of a file, by whatever name: its device and its number there."""


def check_apart(session: Session, targets: Iterable[Path]) -> None:
    """Check that no picture would replace what the session is read from, now or later.

    Args:
        session: What is shown.
        targets: Files that are to be written.

    Raises:
        InputError: One of them is a reference image, an image of the rest, a layer of the stage or
            of B or a file that a layer names; or a stage cannot be read any more.
    """
    there = {identity: target for target in targets if (identity := _identity(target)) is not None}
    if not there:
        return
    for file, kind in _inputs(session):
        target = there.get(_identity(file) or (-1, -1))
        if target is not None:
            raise InputError(
                f"{shown(target)}: would replace {kind}; expected another name or folder. "
                "Choose another output."
            )


def _inputs(session: Session) -> Iterator[tuple[Path, str]]:
    """Yield files with what they are."""
    state, stage = session.state, session.stage
    if state.references is not None:
        for file in state.references.files:
            yield file, "an image that is shown"
    kind = "a file of the stage that is shown"
    if state.keyed is not None:
        for file in state.keyed.rest.files:
            yield file, kind
    if stage is not None and stage.is_file():  # it is not while it is fitted
        for file in files_of(stage):
            yield file, kind
    against = None if state.against is None else state.against.stage
    if against is not None and against.is_file():
        for file in files_of(against):
            yield file, "a file of the stage that is B"


def _identity(path: Path) -> _Identity | None:
    """Return what tells a file from others; None where there is none."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino
