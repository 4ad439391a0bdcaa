# SPDX-License-Identifier: Apache-2.0
"""Unsaved edits of a stage on disk, so that the end of a program or a machine loses none.

Edits are kept as what was done, not as the lights that follow: a drag writes a kilobyte, and what
is restored can be undone step by step.
"""

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from asglight.errors import InputError
from asglight.images.output import written_beside
from asglight.lobes import LobeTracks
from asglight.viewer.state.edits.history import Edit


class Autosave:
    """The file that holds the unsaved edits of one stage.

    Attributes:
        path: The file; there is none while nothing is unsaved.
    """

    def __init__(self, folder: Path, stage: Path) -> None:
        """Name the file; nothing is read or written.

        Args:
            folder: Where such files are kept; made when it is needed.
            stage: The stage that is edited.
        """
        self._stage = str(stage.resolve())
        digest = hashlib.sha256(self._stage.encode()).hexdigest()[:16]
        self.path = folder / f"{stage.stem}_{digest}.json"

    def keep(self, tracks: LobeTracks, edits: tuple[Edit, ...]) -> None:
        """Write the edits of tracks, in place of those that were kept.

        Raises:
            InputError: The file cannot be written.
        """
        content = {
            "stage": self._stage,
            "lobes": tracks.names,
            "frames": tracks.frames,
            "edits": [asdict(edit) for edit in edits],
        }
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.path.parent}: cannot be made ({error.strerror}); expected a folder for "
                "unsaved edits. Save the edits as a layer instead."
            ) from error
        with written_beside(self.path) as place:
            place.write_text(json.dumps(content))

    def found(self, tracks: LobeTracks) -> tuple[Edit, ...]:
        """Return the kept edits that tracks can take; none where they are of other lobes.

        A file that cannot be read counts as none: it is not worth keeping a stage from opening.
        """
        with suppress(OSError, ValueError, TypeError, KeyError):
            content = json.loads(self.path.read_text())
            if (content["lobes"], content["frames"]) == (list(tracks.names), list(tracks.frames)):
                return tuple(_edit(values) for values in content["edits"])
        return ()

    def drop(self) -> None:
        """Forget what was kept."""
        with suppress(OSError):
            os.remove(self.path)


def _edit(values: dict[str, object]) -> Edit:
    """Return an edit that was written as JSON, which knows lists and no tuples."""
    return Edit(
        **{  # pyright: ignore[reportArgumentType]  Edit checks what it is given
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
        }
    )
