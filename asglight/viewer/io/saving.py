# SPDX-License-Identifier: Apache-2.0
"""What the window saves: the edits as a layer over the stage, the picture as a PNG."""

from pathlib import Path
from typing import NamedTuple

import moderngl
import numpy as np
from PIL import Image

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.images.output import written_beside
from asglight.lobes import LobeTracks
from asglight.usd import write_edit_layer, write_key_edits
from asglight.viewer.io.inputs import check_apart
from asglight.viewer.state.edits.history import Step
from asglight.viewer.state.session import Session


class Edited(NamedTuple):
    """Edits to write: nothing in it changes while it is written.

    Attributes:
        stage: The stage that the lobes were read from.
        tracks: The tracks with their edits, muted and deleted lobes as they would light.
        lobes: Indices of the lobes that were edited.
        muted: Indices of the lobes that are muted.
        deleted: Indices of the lobes that are deleted.
        steps: The steps that the tracks hold.
        are_keys: Whether the lobes are keys of the stage.
    """

    stage: Path | None
    tracks: LobeTracks
    lobes: tuple[int, ...]
    muted: frozenset[int]
    deleted: frozenset[int]
    steps: tuple[Step, ...]
    are_keys: bool = False


def edited(session: Session) -> Edited:
    """Return what a session has edited."""
    history = session.state.history
    return Edited(
        session.stage,
        history.saved_tracks,
        history.edited_lobes,
        history.muted,
        history.deleted,
        history.done,
        history.are_keys,
    )


def check_can_save(session: Session) -> None:
    """Raise if the edits of a session cannot be saved, before a file is named for them.

    Raises:
        InputError: Nothing is edited, or there is no stage under the edits, perhaps not yet.
    """
    if not session.state.history.is_changed:
        raise InputError("edits: none made; expected one or more. Change a lobe first.")
    if session.stage is None:
        raise InputError(
            "edits: no stage under them; expected lobes that were read from one. "
            "Fit with: asglight fit INPUT -o shot.usda, and open that."
        )
    if not session.stage.exists():
        raise InputError(
            f"edits: {shown(session.stage.name)} is not written yet; expected a fit that has "
            "ended. The edits are kept: save them then."
        )


def check_picture(session: Session, path: Path) -> None:
    """Raise if the picture of a session cannot be saved under a name.

    Raises:
        InputError: It is no name of a PNG file, or the picture would replace what is shown.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{shown(path)}: not a PNG file; expected a name ending in .png.")
    check_apart(session, [path])


def edits_name(session: Session) -> str:
    """Return a name for the edits of a session's stage: `demo_edits.usda` for `demo.usda`."""
    stem = session.stage.stem if session.stage is not None else Path(session.title).stem
    return f"{stem}_edits.usda"


def save_edits(edits: Edited, path: Path) -> None:
    """Write edits as a layer that leaves the stage untouched.

    Raises:
        InputError: The layer cannot be written.
    """
    assert edits.stage is not None  # as check_can_save has seen
    write = write_key_edits if edits.are_keys else write_edit_layer
    write(path, edits.stage, edits.tracks, edits.lobes, edits.muted, edits.deleted)


def display_pixels(target: moderngl.Framebuffer) -> np.ndarray:
    """Read a display target: sRGB, 8 bits, row 0 at the top.  [H, W, 3]."""
    width, height = target.size
    pixels = np.frombuffer(target.read(components=3, alignment=1), np.uint8)
    return pixels.reshape(height, width, 3)


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Write a PNG file beside its target and rename it, so a failure leaves the target as it was.

    Args:
        path: The target; its folder must exist.
        pixels: sRGB, 8 bits.  [H, W, 3]

    Raises:
        InputError: The file cannot be written there.
    """
    with written_beside(path) as place:
        Image.fromarray(pixels).save(place, format="PNG")
