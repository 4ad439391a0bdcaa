# SPDX-License-Identifier: Apache-2.0
"""Files that are written beside the loop, one after the other, and what came of each."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.viewer.state.edits.history import Step
from asglight.viewer.state.session import Session


@dataclass(frozen=True)
class Save:
    """A file that is being written.

    Attributes:
        path: The file.
        written: Ends when it is there, or cannot be written.
        session: What it is of.
        steps: The edits that it holds; None of a picture.
        then: What follows once it is there, or None.
    """

    path: Path
    written: Future[None]
    session: Session
    steps: tuple[Step, ...] | None = None
    then: Callable[[], None] | None = None


class Saves:
    """What is being written, in the order in which it was asked for."""

    def __init__(self) -> None:
        """Begin with nothing to write."""
        self._open: list[Save] = []
        self._said: list[str] = []

    def __bool__(self) -> bool:
        """Whether anything is being written."""
        return bool(self._open)

    def add(self, save: Save) -> None:
        """Take a file that is being written."""
        self._open.append(save)

    def ended(self) -> tuple[str, list[Save]]:
        """Take in what has been written, and mark its edits as saved.

        Returns:
            What came of the files, with those before them that were written without a pause: one
            must not hide that another failed. Empty where none has ended. Then those that are
            there.
        """
        there: list[Save] = []
        said = ""
        while self._open and self._open[0].written.done():
            save = self._open.pop(0)
            try:
                save.written.result()
            except InputError as error:
                self._said.append(str(error))
            else:
                self._said.append(f"Saved {shown(save.path.name)}.")
                there.append(save)
                if save.steps is not None:
                    save.session.state.history.mark_saved(save.steps)
            said = " ".join(self._said)
        if not self._open:
            self._said.clear()
        return said, there
