# SPDX-License-Identifier: Apache-2.0
"""The fit of another stage, B, taken from the session that it would be opened as."""

from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.usd import read_usd
from asglight.viewer.state.compared.against import Against
from asglight.viewer.state.session import Session


def against_of(session: Session | None, path: str) -> Against:
    """Return the fitted lobes of a stage, as `--against` reads them: of one with keys not the keys.

    Args:
        session: The stage; None of images.
        path: What was opened.

    Raises:
        InputError: They are images, or a stage that has no lobes yet, or they cannot be read.
    """
    if session is None:
        raise InputError(
            f"{shown(Path(path).name)}: images; expected a stage to be B. To compare with "
            "images, open them."
        )
    if session.stage is not None and not session.stage.exists():
        raise InputError(
            f"{session.title}: is not written yet; expected a stage with lobes to be B. Wait for "
            "the fit to end."
        )
    tracks = session.state.history.lit_tracks
    # Only a stage with keys is read again: of others the session holds the same lobes.
    if session.stage is not None and session.state.keyed is not None:
        tracks = read_usd(session.stage)
    return Against(session.title, tracks, session.stage)
