# SPDX-License-Identifier: Apache-2.0
"""Unsaved edits of a stage on disk, so that the end of a program or a machine loses none.

Edits are kept as what was done, not as the lights that follow: a drag writes a kilobyte, and what
is restored can be undone step by step. Each window has a file of its own, which it holds locked:
the system lets go of the lock when the program ends, however it ends.
"""

import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from asglight.errors import InputError
from asglight.images.output import written_beside
from asglight.lobes import LobeTracks
from asglight.viewer.state.edits.edit import (
    Add,
    AnyEdit,
    Delete,
    Edit,
    Mute,
    Rename,
    Restore,
    Span,
)
from asglight.viewer.state.edits.history import Step

_KINDS: dict[str, type[AnyEdit]] = {
    kind.__name__.lower(): kind for kind in (Edit, Mute, Delete, Restore, Rename, Add)
}


OTHER_LIGHTS = "\n\nIts lights have changed since: an edit may fall on another lamp of that name."
"""What is said before such edits are made again."""


class Autosave:
    """The file that holds the unsaved edits of one window on one stage.

    Attributes:
        path: The file; there is none while nothing is unsaved.
        is_of_other_lights: Whether the lights of what was found have changed since it was kept: a
            lobe of the same name may be another lamp.
    """

    def __init__(self, folder: Path, stage: Path) -> None:
        """Take the file of a window that has ended without saving, or else a new one.

        Args:
            folder: Where such files are kept; made when it is needed.
            stage: The stage that is edited.
        """
        self._stage = str(stage.resolve())
        digest = hashlib.sha256(self._stage.encode()).hexdigest()[:16]
        self._stem = f"{stage.stem}_{digest}"
        self._folder = folder
        self._lock: FileLock | None = None
        self._is_own = False
        self.is_of_other_lights = False
        self.path = self._numbered(0)
        with suppress(OSError):  # `keep` will say so
            folder.mkdir(parents=True, exist_ok=True)
            self._take(itertools.chain(self._left(), self._numbers()))

    def keep(self, tracks: LobeTracks, steps: tuple[Step, ...]) -> None:
        """Write the steps of edits of tracks, in place of those that were kept.

        What another window has left, and was not offered in this one, stays in its file.

        Raises:
            InputError: The file cannot be written.
        """
        content = {
            "stage": self._stage,
            "lobes": tracks.names,
            "frames": tracks.frames,
            "lights": _fingerprint(tracks),
            "steps": [[_as_json(edit) for edit in step] for step in steps],
        }
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{self._folder}: cannot be made ({error.strerror}); expected a folder for "
                "unsaved edits. Save the edits as a layer instead."
            ) from error
        if not self._is_own and _steps_in(self.path):
            self._take(path for path in self._numbers() if not path.exists())
        with written_beside(self.path) as place:
            place.write_text(json.dumps(content))
        self._is_own = True

    def found(self, tracks: LobeTracks) -> tuple[Step, ...]:
        """Return the kept steps that tracks can take; none where they are of other lobes.

        All files are looked at that no window has. One that cannot be read counts as none: it is
        not worth keeping a stage from opening.
        """
        for path in dict.fromkeys((self.path, *self._left())):
            steps = _steps_in(path, tracks)
            if steps and (path == self.path or self._take([path])):
                self._is_own = True
                self.is_of_other_lights = _lights_in(path) != _fingerprint(tracks)
                return steps
        return ()

    def drop(self) -> None:
        """Forget what was kept, or found; what was not even offered stays."""
        if not self._is_own:
            return
        with suppress(OSError):
            os.remove(self.path)

    def close(self) -> None:
        """Let another window have the file."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def _numbered(self, number: int) -> Path:
        return self._folder / f"{self._stem}_{number}.json"

    def _numbers(self) -> Iterator[Path]:
        return map(self._numbered, itertools.count())

    def _left(self) -> list[Path]:
        """Return the files that hold edits, those of other windows among them."""
        return sorted(self._folder.glob(f"{self._stem}_*.json"))

    def _take(self, paths: Iterable[Path]) -> bool:
        """Lock the first of some files that nobody has, and let go of the one before."""
        for path in paths:
            # Not of one thread: edits are kept in another.
            lock = FileLock(path.with_suffix(".lock"), thread_local=False)
            with suppress(Timeout):
                lock.acquire(timeout=0)
                self.close()
                self.path, self._lock = path, lock
                return True
        return False


def _steps_in(path: Path, tracks: LobeTracks | None = None) -> tuple[Step, ...]:
    """Return the steps that a file holds, if they are of the lobes of tracks, or any at all."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
        content = json.loads(path.read_text())
        names, frames = content["lobes"], content["frames"]
        if tracks is None or (names, frames) == (list(tracks.names), list(tracks.frames)):
            return tuple(tuple(map(_from_json, step)) for step in content["steps"])
    return ()


def _lights_in(path: Path) -> str | None:
    """Return the fingerprint that a file holds; None where it cannot be read."""
    with suppress(OSError, ValueError, AttributeError):
        return json.loads(path.read_text()).get("lights")
    return None


def _fingerprint(tracks: LobeTracks) -> str:
    """Return what tells the light of tracks from any other."""
    lobes = tracks.lobes
    digest = hashlib.sha256(str(lobes.form).encode())
    for values in (lobes.axes, lobes.sharpness, lobes.amplitude):
        digest.update(values.contiguous().numpy().tobytes())
    return digest.hexdigest()


def _as_json(edit: AnyEdit) -> dict[str, Any]:
    return {"kind": type(edit).__name__.lower(), **asdict(edit)}


def _from_json(values: dict[str, Any]) -> AnyEdit:
    """Return an edit that was written as JSON, which knows lists and no tuples."""
    kind = _KINDS[values.pop("kind")]
    span = values.get("span")
    if span is not None:
        values["span"] = Span(**span)
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in values.items()
    }
    return kind(**given)
