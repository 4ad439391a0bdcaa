# SPDX-License-Identifier: Apache-2.0
"""A shot cut into parts that are fitted apart: the cut, a folder that keeps them, one part's fit.

Nothing here knows who runs the parts. They lie beside the stage in `<stage>.parts` until every shot
of the run is written: a file of settings, the parts as stages, and one empty file for each that is
finished. A run that goes on there fits the others; one with other settings or images is refused.
"""

import contextlib
import itertools
import json
import math
import os
import shutil
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset
from asglight.images import Sequence, open_sequence
from asglight.images.message import shown
from asglight.images.options import ReadOptions
from asglight.images.sequence import Missing
from asglight.shots.events import Notice, OnProgress
from asglight.shots.job import fit_shot
from asglight.shots.kept.checkpoint import SUFFIX as CHECKPOINT_SUFFIX
from asglight.shots.kept.checkpoint import (
    BusyError,
    alone,
    check_same,
    delete,
    not_writable,
    open_locked,
    write_all,
)
from asglight.shots.parts.preroll import Followed, follow
from asglight.shots.reading import stamp_of
from asglight.shots.settings import (
    check_fps,
    check_options,
    check_output,
    settings_of,
)
from asglight.usd.options import StageOptions, check_stage_options

CHUNK = 48
"""Frames of a part: two seconds of film. `fast` then takes 15 s for a part, far more than a task
costs, and a seam comes only now and then."""

OVERLAP = 4
"""Frames that two neighbouring parts have in common, over which one goes over into the next."""

SUFFIX = ".parts"
_SETTINGS = "settings.json"

BUSY_SECONDS = 60.0
"""How long a part waits for another process to leave it alone. A worker that is given up because it
does not answer may still run; it ends when it notices that."""


@dataclass(frozen=True)
class Shot:
    """One shot, as `fit_shot` takes it.

    Attributes:
        source: File, folder or pattern; absolute, for machines have their own folders.
        output: The stage; absolute.
        options: Settings of the fit, without a preroll.
        frames: Frames to use; None for all.
        fps: Frames per second.
        missing: What stands in for a missing or damaged frame.
        reading: How the images are read.
        stage: How the stage is written.
        names_from: Stage whose lights keep their names; None for none.
    """

    source: str
    output: str
    options: FitOptions
    frames: str | None = None
    fps: float = 24.0
    missing: Missing = "error"
    reading: ReadOptions = field(default_factory=ReadOptions)
    stage: StageOptions = field(default_factory=StageOptions)
    names_from: str | None = None


@dataclass(frozen=True)
class Part:
    """One part of a shot; its output and options are its own.

    Attributes:
        shot: The shot, with the part's output, frames and preroll.
        frames: Its frames.
        done: The empty file that says that it is finished.
    """

    shot: Shot
    frames: tuple[int, ...]
    done: Path

    @property
    def span(self) -> str:
        """Return the first and the last frame, `1015-1034`."""
        return f"{self.frames[0]}-{self.frames[-1]}"


class Parts:
    """The parts of one shot, in a folder that only this run may use, as it alone writes the stage.

    Attributes:
        shot: The shot.
        name: A short name of its images, for messages.
        parts: Its parts, in order; one where it is not cut.
        frames: Frames of all parts together.
    """

    def __init__(self, shot: Shot, length: int, *, resume: bool, on_progress: OnProgress) -> None:
        """Cut a shot and open its folder.

        Args:
            shot: The shot.
            length: Frames of a part.
            resume: Keep the parts that are finished; without it, start afresh.
            on_progress: Called with a `Notice` where something is left aside.

        Raises:
            InputError: The shot cannot be fitted, the stage or the folder is in use, or the folder
                is of another run.
        """
        output = Path(shot.output)
        check_options(replace(shot.options, device="cpu"))  # the device is that of the workers
        check_fps(shot.fps)
        check_output(output)
        check_stage_options(shot.stage)
        if length < 2 * OVERLAP:
            raise InputError(f"chunk: {length}; expected at least {2 * OVERLAP} frames.")
        sequence = opened(shot)
        self.shot, self.name = shot, sequence.name
        self.folder = output.with_name(output.name + SUFFIX)
        whole = not is_cut(shot.options) or not is_even(sequence.frames)
        pieces = [sequence.frames] if whole else cut(sequence.frames, length)
        first = None if len(pieces) == 1 else sequence.frames[0]
        self.parts = [self._part(piece, first) for piece in pieces]
        self.frames = sum(map(len, pieces))
        options = shot.options.settled(len(sequence.frames))
        header = {**settings_of(sequence, options, shot.fps), "chunk": length}
        images = [list(stamp_of(sequence, frame)) for frame in sequence.frames]
        with contextlib.ExitStack() as held:
            if first is not None:  # one that is not cut is held by its own fit
                held.enter_context(alone(output))
            self._open(header, sequence, images, resume, on_progress)
            self._held = held.pop_all()

    def __enter__(self) -> Self:
        """Return the parts."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let other runs use the folder; delete it where nothing was kept in it."""
        if not any(self.folder.glob("part.*")):
            self.remove()
        self._stream.close()
        self._held.close()

    def remove(self) -> None:
        """Delete the folder: the shot is written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _part(self, frames: tuple[int, ...], first: int | None) -> Part:
        """Return a part; the whole shot, where `first`, that of the shot, is None."""
        span = f"{frames[0]}-{frames[-1]}"
        shot = replace(self.shot, frames=",".join(map(str, frames)))
        if first is not None:
            options = replace(shot.options, preroll=first)
            shot = replace(shot, output=str(self.folder / f"part.{span}.usdc"), options=options)
        return Part(shot, frames, self.folder / f"part.{span}.done")

    def _open(
        self,
        header: dict[str, Any],
        sequence: Sequence,
        images: list[list[int]],
        resume: bool,
        on_progress: OnProgress,
    ) -> None:
        """Make the folder ours, and what is in it what this run goes on with."""
        settings = self.folder / _SETTINGS
        if self.folder.is_dir() and not settings.exists() and any(self.folder.iterdir()):
            raise InputError(
                f"{shown(self.folder)}: holds no parts of asglight; expected them, or no such "
                "folder. Move it away or write to another name."
            )
        with contextlib.suppress(OSError):  # it is there; or opening the file says what is wrong
            self.folder.mkdir()
        self._stream, _ = open_locked(settings)
        try:
            content = self._stream.read()
            found = _parsed(content)
            if resume and found is not None:
                check_same(self.folder, found["settings"], header)
                self._check_images(sequence, found["images"], images)
            else:
                if resume and any(self.folder.glob("part.*")):
                    raise InputError(
                        f"{shown(settings)}: is damaged; expected the settings of the parts beside "
                        "it. Leave out --resume to start afresh."
                    )
                self._start_afresh(on_progress)
            wanted = json.dumps({"settings": header, "images": images}).encode()
            if content != wanted:
                self._replace(settings, wanted)
        except BaseException:
            self._stream.close()
            raise

    def _replace(self, settings: Path, content: bytes) -> None:
        """Write the settings beside, locked, and rename: those that were there stay until then."""
        beside = settings.with_name(f"{settings.name}.new")
        stream, _ = open_locked(beside)
        try:
            stream.truncate(0)
            write_all(stream, content)
            os.fsync(stream.fileno())
            beside.replace(settings)
        except OSError as error:
            stream.close()
            raise not_writable(settings, error) from error
        self._stream.close()
        self._stream = stream

    def _start_afresh(self, on_progress: OnProgress) -> None:
        """Delete what an earlier run has left."""
        finished = sum(part.done.exists() for part in self.parts)
        if finished:
            parts = f"{finished} finished {'part' if finished == 1 else 'parts'}"
            on_progress(
                Notice(
                    f"{shown(self.folder)}: {parts} of an earlier run not used; --resume would go "
                    "on from there"
                )
            )
        for path in self.folder.glob("part.*"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if len(self.parts) == 1:
            delete(Path(self.shot.output + CHECKPOINT_SUFFIX))

    def _check_images(
        self, sequence: Sequence, before: list[list[int]], now: list[list[int]]
    ) -> None:
        """Refuse to mix parts fitted to other images; what no part has used yet may change."""
        used = 0
        for part in self.parts:
            if part.done.exists():
                used = sequence.frames.index(part.frames[-1]) + 1
            elif Path(part.shot.output + CHECKPOINT_SUFFIX).exists():
                used = sequence.frames.index(part.frames[0])  # the others its checkpoint knows
        for frame, old, new in zip(sequence.frames[:used], before, now, strict=False):
            if old != new:
                raise InputError(
                    f"{shown(sequence.path(frame))}: has changed since {shown(self.folder)} was "
                    "begun; expected the same image. Leave out --resume to start afresh."
                )


def is_cut(options: FitOptions) -> bool:
    """Tell whether parts of a shot come to the same lobes.

    With a tolerance each would take a number of its own, and `paper` is as published: its frames
    follow each other.
    """
    return options.tolerance is None and options.preset is not Preset.PAPER


def is_even(frames: tuple[int, ...]) -> bool:
    """Tell whether a preroll finds the frames before a part by the part's own step."""
    return len({after - before for before, after in itertools.pairwise(frames)}) <= 1


def cut(frames: tuple[int, ...], length: int) -> list[tuple[int, ...]]:
    """Cut frames into parts of about the same length.

    Args:
        frames: Frames of the shot.
        length: Of a part, at most, its overlaps left aside.
    """
    count = math.ceil(len(frames) / length)
    bounds = [round(k * len(frames) / count) for k in range(count + 1)]
    half = OVERLAP // 2
    return [
        frames[max(start - half, 0) : stop + half] for start, stop in itertools.pairwise(bounds)
    ]


def opened(shot: Shot) -> Sequence:
    """Find the frames of a shot or a part.

    Raises:
        InputError: They cannot be found.
    """
    return open_sequence(
        shot.source,
        frames=shot.frames,
        missing=shot.missing,
        height=FIT_HEIGHT,
        reading=shot.reading,
    )


def follow_to(part: Part, known: Followed | None) -> Followed | None:
    """Follow the lobes of a shot as far as a part needs it.

    Args:
        part: The part.
        known: How far an earlier part needed it.

    Raises:
        InputError: A frame cannot be read.
    """
    sequence = opened(part.shot)
    return follow(sequence, part.shot.options.settled(len(sequence.frames)), known)


def fit_part(part: Part, known: Followed | None, on_progress: OnProgress) -> None:
    """Fit one part, from its checkpoint on, unless it is finished.

    Args:
        part: The part.
        known: What `follow_to` returned for it.
        on_progress: Called with each event.

    Raises:
        InputError: As `fit_shot`.
    """
    shot, end = part.shot, time.monotonic() + BUSY_SECONDS
    fit = partial(
        fit_shot,
        shot.source,
        shot.output,
        shot.options,
        frames=shot.frames,
        fps=shot.fps,
        missing=shot.missing,
        reading=shot.reading,
        stage=shot.stage,
        names_from=shot.names_from,
        resume=True,
        on_progress=on_progress,
        followed=known,
    )
    while not part.done.exists():
        try:
            fit()
        except BusyError:
            if time.monotonic() > end:
                raise
            time.sleep(1.0)
        else:
            part.done.touch()


def _parsed(content: bytes) -> dict[str, Any] | None:
    """Return what a settings file holds; None where a run was killed while it was written."""
    try:
        found = json.loads(content)
    except ValueError:
        return None
    return found if {"settings", "images"} <= found.keys() else None
