# SPDX-License-Identifier: Apache-2.0
"""A fit in a process of its own, watched by the viewer: it never takes the window's time.

The process sends each frame through a pipe as plain arrays. It writes no file, so that ending it is
all there is to clean up.
"""

import contextlib
import multiprocessing
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from asglight.cli.sources import built_in
from asglight.errors import InputError
from asglight.images.options import ReadOptions

if TYPE_CHECKING:  # this module starts the process before the viewer loads torch
    import numpy as np
    from torch import Tensor

    from asglight.lobes import LobeTracks
    from asglight.lobes.growing import GrowingTracks
    from asglight.viewer.state.source import SourceStatus

CLOSE_SECONDS = 2.0
"""Until a process that was asked to end is killed: it has nothing to finish, so it ends at once
unless the machine is overloaded."""

EXIT_SECONDS = 1.0
"""Until the exit status of a process that has closed its pipe is given up: the system closes pipes
just before it hands over the status."""


@dataclass(frozen=True)
class LiveJob:
    """What to fit.

    Attributes:
        frames: Frame numbers, ascending.
        source: Image file, folder or pattern; None for the built-in environment.
        reading: How the images are read.
        lobes: Number of lobes; None for the usual one.
        fps: Frames per second of the tracks.
    """

    frames: tuple[int, ...]
    source: str | None = None
    reading: ReadOptions = field(default_factory=ReadOptions)
    lobes: int | None = None
    fps: float = 24.0


@dataclass(frozen=True)
class _Fitted:
    """One frame: axes [N, 3, 3], sharpness [N, 2], amplitude [N, 3]."""

    axes: "np.ndarray"
    sharpness: "np.ndarray"
    amplitude: "np.ndarray"


@dataclass(frozen=True)
class _Ended:
    """The last message: why the fit ended early, or None."""

    failure: str | None


class LiveSource:
    """A running fit with the `live` preset (an `asglight.viewer.state.source.TrackSource`)."""

    def __init__(self, job: LiveJob) -> None:
        """Start the process."""
        self._job = job
        self._growing: GrowingTracks | None = None
        self._ended: _Ended | None = None
        self._is_closed = False
        # Not forked: a window and its threads cannot be continued in a copy of this process.
        spawn = multiprocessing.get_context("spawn")
        self._connection, theirs = spawn.Pipe(duplex=False)
        self.process = spawn.Process(
            target=_serve, args=(job, theirs), name="asglight-live-fit", daemon=True
        )
        with _interrupts_ignored():
            self.process.start()
        theirs.close()  # then the end of the process ends the pipe, whatever ends the process

    def poll(self) -> "LobeTracks | None":
        """Return the tracks of the frames fitted so far; None where nothing is new."""
        is_new = False
        while self._ended is None and not self._is_closed:
            try:
                if not self._connection.poll():
                    break
                message = self._connection.recv()
            except (EOFError, OSError):
                self._ended = _Ended(self._unexpected_end())
                break
            if isinstance(message, _Ended):
                self._ended = message
            else:
                self._append(message)
                is_new = True
        return self._growing.tracks() if is_new and self._growing is not None else None

    def status(self) -> "SourceStatus":
        """Return how many frames are fitted, and whether the fit has ended."""
        from asglight.viewer.state.source import SourceStatus

        done, total = 0 if self._growing is None else self._growing.count, len(self._job.frames)
        if self._ended is not None:
            failure = self._ended.failure
            text = "" if failure else "all frames are fitted"
            return SourceStatus(done, total, text, is_finished=True, failure=failure)
        if self._is_closed:
            return SourceStatus(done, total, "the fit was ended", is_finished=True)
        text = f"fitting frame {self._job.frames[done]}" if done < total else "fitting"
        return SourceStatus(done, total, text if done else "starting the fit")

    def close(self) -> None:
        """End the process and wait until it is gone."""
        if self._is_closed:
            return
        self._is_closed = True
        self._connection.close()
        self.process.terminate()
        self.process.join(CLOSE_SECONDS)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()

    def _append(self, fitted: _Fitted) -> None:
        import torch

        from asglight.lobes import Lobes
        from asglight.lobes.growing import GrowingTracks

        if self._growing is None:
            metadata = {"source": self._job.source or built_in.NAME, "preset": "live"}
            self._growing = GrowingTracks(self._job.frames, self._job.fps, metadata)
        axes, sharpness, amplitude = map(
            torch.from_numpy, (fitted.axes, fitted.sharpness, fitted.amplitude)
        )
        self._growing.append(Lobes(axes, sharpness, amplitude))

    def _unexpected_end(self) -> str:
        """Return what ended a process that has not said why."""
        self.process.join(EXIT_SECONDS)
        code = self.process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit status {code}"
        return (
            f"live fit: its process ended early ({how}); expected it to reach the last frame. "
            "Is memory short? Start the viewer again."
        )


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C for the processes that are started meanwhile.

    A terminal sends it to all of them at once. This process answers it and ends the others, which
    would print a traceback each.
    """
    if threading.current_thread() is not threading.main_thread():  # which alone may change signals
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(job: LiveJob, connection: Connection) -> None:
    """Fit and send; this is what the process runs."""
    # A pipe without a reader: the window is gone.
    with contextlib.suppress(BrokenPipeError):
        connection.send(_Ended(_fitted_all(job, connection)))


def _fitted_all(job: LiveJob, connection: Connection) -> str | None:
    """Fit all frames and return why it could not be done, or None."""
    try:
        from asglight.shots.live import live_fits

        for _, lobes in live_fits(_reader(job), job.frames, job.lobes):
            arrays = (lobes.axes, lobes.sharpness, lobes.amplitude)
            connection.send(_Fitted(*(values.numpy() for values in arrays)))
    except InputError as error:
        return str(error)
    except BrokenPipeError:
        raise
    except Exception as error:
        traceback.print_exc()
        return f"live fit: {type(error).__name__}: {error}. This is a bug; please report it."
    return None


def _reader(job: LiveJob) -> "Callable[[int], Tensor]":
    """Return what reads the images of a job."""
    if job.source is None:
        return built_in.environment
    from asglight.fitting.options import FIT_HEIGHT
    from asglight.images import open_sequence

    wanted = ",".join(map(str, job.frames))
    sequence = open_sequence(
        job.source,
        frames=wanted,
        missing="hold",
        height=FIT_HEIGHT,
        reading=job.reading,
    )
    return lambda frame: sequence.read(frame).radiance
