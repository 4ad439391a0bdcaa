# SPDX-License-Identifier: Apache-2.0
"""The stage and the images of a window as documents: opened, saved, asked about before they go.

No window and no OpenGL: whatever has to be asked stands in `question` and `browser`, which panels
draw and answer.
"""

import contextlib
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.viewer.io.against import against_of
from asglight.viewer.io.autosave import OTHER_LIGHTS, Autosave
from asglight.viewer.io.browsing import Browser
from asglight.viewer.io.question import Question
from asglight.viewer.io.saves import Save, Saves
from asglight.viewer.io.saving import (
    check_can_save,
    check_picture,
    edited,
    edits_name,
    save_edits,
    write_png,
)
from asglight.viewer.reference.images import Reference, open_reference, whole_sequence
from asglight.viewer.state.edits.history import Step
from asglight.viewer.state.session import Session
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import RENDERS, Request

RECENT_MAX = 8
"""Files in the list of recent ones."""

Opener = Callable[[str], Session | None]
"""Opens what a user dropped or chose: a session; None for images, which are compared with."""


@dataclass
class _Pending:
    """Images that are tried before they replace others."""

    path: str
    reference: Reference
    frame: int


class Documents:
    """What a window has open, and what it is asked to do with files.

    Attributes:
        session: The stage or fit that is shown.
        recent: What was opened, the last first.
        question: What waits for an answer, or None.
        browser: Where a file is chosen, or None.
        has_quit: Whether the window is to close.
    """

    def __init__(self, session: Session, opener: Opener, autosaves: Path | None = None) -> None:
        """Take what is shown.

        Args:
            session: The stage or fit.
            opener: Opens others.
            autosaves: Folder for unsaved edits; None keeps none.
        """
        self.session = session
        self.recent: list[str] = []
        self.question: Question | None = None
        self.browser: Browser | None = None
        self.has_quit = False
        self._opener = opener
        self._autosaves = autosaves
        self._writer = ThreadPoolExecutor(1)
        self._saves = Saves()
        self._after_save: Callable[[], None] | None = None
        self._pending: _Pending | None = None
        self._kept: tuple[Step, ...] = ()
        self._kept_of: LobeTracks | None = None
        self._keeping: Future[None] | None = None
        self._autosave = self._own_autosave()
        self._asked_for: LobeTracks | None = None
        self._offer()

    @property
    def state(self) -> ViewerState:
        """What is shown."""
        return self.session.state

    @property
    def title(self) -> str:
        """What the window is called: with a star while edits are unsaved."""
        mark = "*" if self.state.history.is_unsaved else ""
        return f"{self.session.title}{mark} - asglight"

    @property
    def is_busy(self) -> bool:
        """Whether something is read or written at this moment."""
        return bool(self._saves) or self._pending is not None

    def update(self) -> None:
        """Take in what has been read and written since the last picture."""
        self._finish_saving()
        self._finish_pending()
        self._offer()
        self._keep()

    def ask(self, request: Request) -> bool:
        """Begin what a request wants, unless it cannot be done, which becomes the message.

        Returns:
            Whether a file has to be named.
        """
        if request is not Request.SAVE_EDITS:
            return True
        try:
            check_can_save(self.session)
        except InputError as error:
            self.state.message = str(error)
            return False
        return True

    def browse(self, request: Request) -> None:
        """Let a file be chosen inside the window."""
        folder = Path.cwd()
        if self.session.stage is not None:
            folder = self.session.stage.resolve().parent
        elif self.recent and Path(self.recent[0]).parent.is_dir():
            folder = Path(self.recent[0]).resolve().parent
        name, suffix = self.proposed(request)
        self.browser = Browser(request, folder, name, suffix)

    def proposed(self, request: Request) -> tuple[str, str]:
        """Return the name that is proposed for a file, and what it ends with."""
        if request is Request.SAVE_EDITS:
            return edits_name(self.session), ".usda"
        if request is Request.SAVE_PICTURE:
            stem = Path(self.session.title).stem
            return f"{stem}.{self.state.playback.frame:04d}.png", ".png"
        if request in RENDERS:
            return f"{Path(self.session.title).stem}.####.png", ".png"
        return "", ""

    def open(self, path: str) -> None:
        """Open a stage or folder, or compare with images; what goes wrong becomes the message.

        Edits that are unsaved are asked about before a stage replaces them.
        """
        try:
            session = self._opener(path)
            if session is None:
                self._try(path)
                return
        except InputError as error:
            self.state.message = str(error)
            return
        if not self.state.history.is_unsaved:
            self._take_over(path, session)
            return
        self._ask_about_edits(
            f"Open {shown(Path(path).name)}",
            lambda: self._take_over(path, session),
            cancel=session.close,
        )

    def open_against(self, path: str) -> None:
        """Hold the fit of another stage against this one; what goes wrong becomes the message."""
        try:
            session = self._opener(path)
            with contextlib.nullcontext() if session is None else contextlib.closing(session):
                against = against_of(session, path)
            self.state.compare_against(against)
        except InputError as error:
            self.state.message = str(error)
            return
        self.state.message = f"B is {against.name}."

    def save(self, request: Request, path: Path, pixels: np.ndarray | None = None) -> None:
        """Save what is asked for; what came of it becomes the message.

        It is written beside the loop, because the images of a long shot's dome take seconds.

        Args:
            request: What to save.
            path: Where.
            pixels: The picture, if that is saved.  [H, W, 3]
        """
        if pixels is not None:
            try:
                check_picture(self.session, path)
            except InputError as error:
                self.state.message = str(error)
                return
            written = self._writer.submit(write_png, path, pixels)
            self._saves.add(Save(path, written, self.session))
        elif self.ask(request):
            edits, then = edited(self.session), self._after_save
            self._after_save = None
            written = self._writer.submit(save_edits, edits, path)
            self._saves.add(Save(path, written, self.session, edits.steps, then))
        else:
            return
        self.state.message = f"Saving {shown(path.name)} ..."

    def leave_saving(self) -> None:
        """Forget what was to follow a save whose file was not named after all."""
        self._after_save = None

    def quit(self) -> None:
        """Close the window, after a question where edits are unsaved."""
        if self.state.history.is_unsaved:
            self._ask_about_edits("Quit", self._quit)
        else:
            self._quit()

    def close(self, *, is_wanted: bool) -> None:
        """End what runs.

        Args:
            is_wanted: Whether the user closed the window: unsaved edits are then let go, as the
                user said; otherwise they are kept for the next time.
        """
        if self._pending is not None:
            self._pending.reference.close()
        self._writer.shutdown()  # what is being written is finished
        if self._autosave is not None:
            if is_wanted and self.question is None:
                self._autosave.drop()
            self._autosave.close()
        self.session.close()

    def _ask_about_edits(
        self,
        what: str,
        then: Callable[[], None],
        cancel: Callable[[], None] = lambda: None,
    ) -> None:
        """Ask whether to save unsaved edits before something is done that ends them."""

        def _save() -> None:
            self._after_save = then
            self.state.requests.append(Request.SAVE_EDITS)

        answers: list[tuple[str, Callable[[], None]]] = []
        why_not = ""
        try:
            check_can_save(self.session)
            answers.append(("Save...", _save))
        except InputError as error:
            why_not = f"\n\nThey cannot be saved: {error}"
        text = f"The edits of {self.session.title} are not saved.{why_not}"
        answers += [("Discard them", then), ("Cancel", cancel)]
        self.question = Question(what, text, tuple(answers))

    def _quit(self) -> None:
        self.has_quit = True

    def _take_over(self, path: str, session: Session) -> None:
        """Show another session as this one was looked at."""
        before = self.state
        session.state.display, session.state.camera = before.display, before.camera
        session.state.environment, session.state.material = before.environment, before.material
        if self._autosave is not None:
            if self._keeping is not None:
                self._keeping.exception()  # it would write the file anew
            self._autosave.drop()
            self._autosave.close()
        self.session.close()
        self.session = session
        self._autosave = self._own_autosave()
        self._kept, self._asked_for = (), None
        self._opened(path)
        self._offer()

    def _opened(self, path: str) -> None:
        self.state.message = f"Opened {shown(Path(path).name)}."
        self.recent = [path, *(other for other in self.recent if other != path)][:RECENT_MAX]

    def _try(self, path: str) -> None:
        """Begin to read images; those that are shown stay until one has been read."""
        reference = self._images(path)
        if self._pending is not None:
            self._pending.reference.close()
        frame = self.state.playback.frame
        known = frame in reference.frames or reference.is_still
        frame = frame if known else reference.frames[0]
        reference.look_at(frame)
        self._pending = _Pending(path, reference, frame)

    def _images(self, path: str) -> Reference:
        """Open images; one of a sequence means the sequence, where the shot has its frames.

        Raises:
            InputError: There are none.
        """
        frames = self.state.playback.frames
        whole = whole_sequence(path, frames)
        return open_reference(path if whole is None else whole)

    def _finish_pending(self) -> None:
        """Compare with new images once one is there, or say why there is none."""
        pending = self._pending
        if pending is None:
            return
        message = pending.reference.message(pending.frame)
        if message is None and pending.reference.get(pending.frame) is None:
            return
        self._pending = None
        if message is not None:
            pending.reference.close()
            self.state.message = message
            return
        self.state.compare_with(pending.reference)
        self._opened(pending.path)
        if pending.reference.is_still and len(self.state.playback.frames) > 1:
            self.state.message += f" {pending.reference.held_line()}"

    def _finish_saving(self) -> None:
        """Say what came of saves that have ended."""
        said, there = self._saves.ended()
        self.state.message = said or self.state.message
        for save in there:
            if save.then is not None and save.session is self.session:
                save.then()

    def _own_autosave(self) -> Autosave | None:
        stage = self.session.stage
        if self._autosaves is None or stage is None:
            return None
        return Autosave(self._autosaves, stage)

    def _keep(self) -> None:
        """Keep unsaved edits on disk, once a drag has ended."""
        if self._keeping is not None and self._keeping.done():
            try:
                self._keeping.result()
            except InputError as error:
                self.state.message = str(error)
            self._keeping = None
        history, autosave = self.state.history, self._autosave
        steps = history.done if history.is_unsaved else ()
        waits = self.state.is_dragging or self.question is not None or self._keeping is not None
        is_kept = steps == self._kept and (not steps or history.original is self._kept_of)
        if autosave is None or waits or is_kept:
            return
        self._kept, self._kept_of = steps, history.original
        if steps:
            self._keeping = self._writer.submit(autosave.keep, history.original, steps)
        else:
            autosave.drop()

    def _offer(self) -> None:
        """Offer the edits that a program or a machine ended with, once there are their lobes."""
        autosave, original = self._autosave, self.state.history.original
        had = self._asked_for
        is_known = had is not None and (had.names, had.frames) == (original.names, original.frames)
        if autosave is None or self._kept or is_known or self.question is not None:
            return
        self._asked_for = original
        steps = autosave.found(original)
        if not steps:
            return
        self._kept = steps

        def _restore() -> None:
            # The question may have stood while a fit went on to its stage.
            count = self.state.history.restore(steps, original)
            self.state.message = f"Restored {_counted(count)}. They are not saved yet."

        text = (
            f"asglight ended before {_counted(len(steps))} of {self.session.title} "
            "could be saved. They were kept."
        )
        if autosave.is_of_other_lights:
            text += OTHER_LIGHTS
        self.question = Question(
            "Unsaved edits", text, (("Restore them", _restore), ("Discard them", autosave.drop))
        )


def _counted(edits: int) -> str:
    return f"{edits} edit" if edits == 1 else f"{edits} edits"
