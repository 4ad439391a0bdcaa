# SPDX-License-Identifier: Apache-2.0
"""What `asglight view` opens: a stage, a fit that is running, images, or the built-in environment.

Rooms are loaded by whoever needs them: `asglight view --help` needs none.
"""

import contextlib
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asglight.cli.options.reading import given
from asglight.cli.printing import summed_up
from asglight.cli.sources import built_in
from asglight.cli.sources.live_source import LiveJob, LiveSource
from asglight.errors import InputError
from asglight.images.options import ReadOptions

if TYPE_CHECKING:
    import numpy as np

    from asglight.lobes import LobeTracks
    from asglight.usd import Reading
    from asglight.viewer.state.compared.against import Against
    from asglight.viewer.state.session import Session
    from asglight.viewer.state.source import TrackSource

FPS = 24.0
"""Frames per second of images, which name no rate."""


@dataclass(frozen=True)
class Request:
    """What to open.

    Attributes:
        input: A stage, a folder that holds one, or images; None for the built-in environment.
        reference: Images to compare a stage with.
        against: Another stage of the shot, or a folder that holds one, to compare with.
        frames: Frames of the images to use, such as `1001-1048`; None for all.
        reading: How the images are read.
        live: Fit the images while they are shown.
        lobes: Number of lobes of that fit; None for the usual one.
        rig: Prim that holds the lobes, of a stage with several.
    """

    input: str | None = None
    reference: str | None = None
    against: str | None = None
    frames: str | None = None
    reading: ReadOptions = field(default_factory=ReadOptions)
    live: bool = False
    lobes: int | None = None
    rig: str | None = None


def opened(request: Request) -> "Session":
    """Open what is asked for; what runs in the background runs until the session is closed.

    Raises:
        InputError: It cannot be opened, or the request contradicts itself.
    """
    stage = None if request.input is None else stage_of(Path(request.input))
    _check(request, stage)
    against = None if request.against is None else _against(request.against)
    if stage is not None:
        from asglight.threads import one_thread

        with one_thread():  # a shot's lobes are too few to be worth waking others
            session = _stage(stage, request)
    elif request.input is None:
        session = _built_in(request)
    else:
        session = _images(request.input, request)
    session.state.compare_against(against)
    return session


def _against(path: str) -> "Against":
    """Read the fit that is B.

    Raises:
        InputError: There is no stage, it cannot be read, or it has more lobes than there is room.
    """
    from asglight.images.message import shown
    from asglight.viewer.state.compared.against import Against
    from asglight.viewer.state.viewer_state import check_count

    stage = stage_of(Path(path))
    if stage is None:
        raise InputError(
            f"--against {shown(path)}: images; expected a stage. To compare with images: "
            f"--reference {shown(path)}."
        )
    from asglight.usd import read_usd

    tracks = read_usd(stage)
    check_count(tracks)
    return Against(shown(stage.name), tracks, stage)


def stage_of(path: Path) -> Path | None:
    """Return the stage that a path means; None for images.

    A folder means the stage in it, where it holds one.

    Raises:
        InputError: A folder holds several.
    """
    from asglight.usd.options import STAGE_SUFFIXES

    if path.suffix.lower() in STAGE_SUFFIXES and not os.path.isdir(path):
        return path
    if not os.path.isdir(path):
        return None
    # Hidden names are the leftovers of interrupted writers; an unreadable folder is told of later.
    names: list[str] = []
    with contextlib.suppress(OSError):
        names = sorted(name for name in os.listdir(path) if not name.startswith("."))
    stages = [name for name in names if Path(name).suffix.lower() in STAGE_SUFFIXES]
    if len(stages) > 1:
        from asglight.images.message import listing, shown

        raise InputError(
            f"{shown(path)}: holds {len(stages)} stages ({listing(stages)}); expected one. "
            "Name the one to open."
        )
    return path / stages[0] if stages else None


def _check(request: Request, stage: Path | None) -> None:
    """Refuse options that contradict each other or would have no effect."""
    fitted = request.live or request.input is None
    if request.live and stage is not None:
        raise InputError(
            f"--live: given with the stage {stage.name}, whose lobes are known; expected images "
            "to fit. Leave out one of the two."
        )
    if request.reference is not None and stage is None:
        raise InputError(
            f"--reference: given without a stage to compare with {request.reference}; expected "
            f"one before it. To see only the images: asglight view {request.reference}."
        )
    if request.lobes is not None and not fitted:
        raise InputError(
            "--lobes: given without --live; expected both or neither. Add --live to fit images."
        )
    images = request.reference if stage is not None else request.input
    choosing = {
        "--frames": request.frames,
        **given(request.reading),
    }
    if images is None and any(choosing.values()):
        name = next(name for name, value in choosing.items() if value)
        raise InputError(
            f"{name}: given without images to choose from; expected them as INPUT or with "
            "--reference."
        )
    if request.lobes is not None:
        from asglight.viewer.state.viewer_state import MAX_LOBES

        if not 1 <= request.lobes <= MAX_LOBES:
            raise InputError(f"--lobes: {request.lobes}; expected 1 to {MAX_LOBES}.")


def _stage(stage: Path, request: Request) -> "Session":
    """Open a stage, or watch the fit that will write it."""
    from asglight.images.message import shown
    from asglight.viewer.reference.images import open_reference, whole_sequence
    from asglight.viewer.reference.rest import Keyed, open_rest
    from asglight.viewer.state.session import Session, no_lobes
    from asglight.viewer.state.source import FixedSource
    from asglight.viewer.state.viewer_state import ViewerState

    keyed: Keyed | None = None
    with contextlib.ExitStack() as on_failure:
        if not os.path.exists(stage) and os.path.exists(checkpoint_of(stage)):
            source, tracks = _watched(stage)
            muted: frozenset[int] = frozenset()
        else:
            from asglight.usd import read_stage
            from asglight.usd.read.keys import read_shown_keys

            reading = read_stage(stage, request.rig)
            tracks, said = reading.unmuted, findings_line(reading)
            muted = reading.muted
            keys = read_shown_keys(stage, request.rig)
            if keys is not None:
                keyed = Keyed(open_rest(keys.rest), tracks)
                on_failure.callback(keyed.close)
                tracks, muted = keys.unmuted or no_lobes(keys.times, keys.fps), keys.muted
                said = findings_line(replace(reading, changes=keys.changes))
            source = FixedSource(tracks, said)
        on_failure.callback(source.close)
        state = ViewerState(tracks, muted=muted, keyed=keyed)
        reference = None
        if request.reference is not None:
            whole = whole_sequence(request.reference, tracks.frames)
            reference = open_reference(
                whole or request.reference,
                frames=request.frames,
                reading=request.reading,
            )
        on_failure.pop_all()
    if reference is not None:
        state.compare_with(reference)
    return Session(state, source, shown(stage.name), stage)


def findings_line(reading: "Reading") -> str:
    """Return what was changed in a stage's lights, and what was not read, as one line."""
    said = {"lights edited since the fit": reading.changes, "not read": reading.unread}
    return "; ".join(summed_up(subject, lines) for subject, lines in said.items() if lines)


def checkpoint_of(stage: Path) -> Path:
    """Return the file that a fit grows until the stage is written."""
    from asglight.shots.kept.checkpoint import SUFFIX

    return stage.with_name(stage.name + SUFFIX)


def _watched(stage: Path) -> "tuple[TrackSource, LobeTracks]":
    """Watch the fit of a stage; return its source and a timeline without lobes."""
    from asglight.cli.sources.watch_source import WatchSource
    from asglight.images.message import shown
    from asglight.viewer.state.session import no_lobes

    source = WatchSource(stage)
    if not source.frames:
        source.close()
        raise InputError(
            f"{shown(stage)}: is not written yet, and its checkpoint holds no frame; expected a "
            "stage or a running fit. Wait for the first frame."
        )
    return source, no_lobes(source.frames, FPS)


def _images(source: str, request: Request) -> "Session":
    """Open images, and start to fit them where that is asked for."""
    from asglight.viewer.reference.images import open_reference
    from asglight.viewer.state.session import Session, no_lobes
    from asglight.viewer.state.source import FixedSource
    from asglight.viewer.state.viewer_state import ViewerState

    reference = open_reference(source, frames=request.frames, reading=request.reading)
    tracks = no_lobes(reference.timeline, FPS)
    if request.live:
        job = LiveJob(reference.timeline, source, request.reading, request.lobes, FPS)
        lobes: TrackSource = LiveSource(job)
    else:
        hint = "shown without lobes: --live fits them now, asglight fit -o STAGE keeps them"
        lobes = FixedSource(tracks, f"{reference.name}: {hint}")
    return Session(ViewerState(tracks, reference), lobes, reference.name)


def _built_in(request: Request) -> "Session":
    """Show the built-in environment and fit it."""
    # Before torch is loaded here: loading it is half of the time until the first lobes.
    source = LiveSource(LiveJob(built_in.FRAMES, lobes=request.lobes, fps=FPS))
    from asglight.viewer.reference.images import Reference
    from asglight.viewer.state.session import Session, no_lobes
    from asglight.viewer.state.viewer_state import ViewerState

    def read(frame: int) -> "np.ndarray":
        return built_in.environment(frame).numpy()

    reference = Reference(built_in.NAME, built_in.FRAMES, read)
    state = ViewerState(no_lobes(built_in.FRAMES, FPS), reference)
    return Session(state, source, built_in.NAME)


def opened_in_window(path: str) -> "Session | None":
    """Open what a user dropped on the window: a session for a stage, None for images.

    Raises:
        InputError: It cannot be opened.
    """
    stage = stage_of(Path(path))
    return None if stage is None else _stage(stage, Request(input=path))
