# SPDX-License-Identifier: Apache-2.0
"""Shots and their parts as tasks of a Dask cluster (`pip install 'asglight[farm]'`).

Each part is a task; so is each stretch of following between the starts of two parts (preroll.py),
which hands its lobes to the next stretch and to the part that begins there. A worker that dies
takes nothing with it: its task goes to another, which goes on from the checkpoint on disk. A task
is the pickled call of a function of this file and is unpickled by a worker only, so the scheduler
need not have asglight, and one that has another version is told.
"""

import contextlib
import logging
import os
import pickle
import queue
import socket
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from asglight import __version__
from asglight.errors import InputError
from asglight.images.message import compressed, shown
from asglight.shots.events import Event, Farmed, FrameDone, Notice, OnProgress, ignore
from asglight.shots.parts.chunks import CHUNK, Part, Parts, Shot, fit_part, follow_to
from asglight.shots.parts.joining import join
from asglight.shots.parts.preroll import Followed

LOCAL = "local"
"""Address of a cluster that is made for the run, on this machine; `local:4` has 4 workers."""

CONNECT_SECONDS = 10.0
"""How long the scheduler may take to answer; on one network it takes milliseconds."""

RETRIES = 2
"""Times that a task which failed runs again: a file server that fails once seldom fails thrice. A
worker that dies is not counted; Dask gives a part up after four of them."""

POLL_SECONDS = 0.2
"""Between two looks at the tasks: a failure is told at once to a person, and costs nothing."""


def fit_on_farm(
    shots: Sequence[Shot],
    address: str,
    *,
    chunk: int = CHUNK,
    resume: bool = False,
    on_progress: OnProgress = ignore,
) -> list[str]:
    """Fit shots on a Dask cluster and write their stages, each put together as by `join`.

    All machines must see the images and the folders of the stages under the same paths.

    Args:
        shots: The shots.
        address: Of the scheduler, such as `tcp://farm:8786`; or `local`, `local:4`.
        chunk: Frames of a part.
        resume: Go on with an interrupted run: finished parts are not fitted again.
        on_progress: Called with each event, in the calling thread.

    Returns:
        The stages.

    Raises:
        InputError: A shot cannot be fitted, the cluster cannot be used, or a part failed.
    """
    distributed = _distributed()
    with contextlib.ExitStack() as stack:
        plans = [
            stack.enter_context(Parts(shot, chunk, resume=resume, on_progress=on_progress))
            for shot in shots
        ]
        client = stack.enter_context(_client(distributed, address, on_progress))
        _Run(distributed, client, address, plans, on_progress).wait()
        stages = [_join(plan) for plan in plans]
        for plan in plans:
            plan.remove()
    return stages


class _Run:
    """The tasks of one run."""

    def __init__(
        self,
        distributed: Any,
        client: Any,
        address: str,
        plans: Sequence[Parts],
        on_progress: OnProgress,
    ) -> None:
        """Submit what is not finished."""
        self._distributed, self._client, self._address = distributed, client, address
        self._on_progress = on_progress
        self._run_id = uuid.uuid4().hex[:12]
        self._news: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._frames = sum(plan.frames for plan in plans)
        self._done: dict[str, int] = {}
        self._workers: dict[str, str] = {}
        self._parts: dict[Any, str] = {}
        self._begin, self._done_before = time.monotonic(), 0
        client.subscribe_topic(self._run_id, lambda event: self._news.put(event[1]))
        for number, plan in enumerate(plans):
            self._submit(plan, number)

    def wait(self) -> None:
        """Wait for every part.

        Raises:
            InputError: One failed, or the cluster is gone.
        """
        self._done_before = sum(self._done.values())
        self._tell(None)
        waiting = dict(self._parts)
        try:
            while waiting:
                self._take_news()
                for future in [future for future in waiting if future.done()]:
                    name = waiting.pop(future)
                    if future.status != "finished":
                        raise self._failure(future, name)
                    self._tell(name)
        except BaseException:
            # those that run go on until their frame ends; their checkpoints stay
            with contextlib.suppress(Exception):
                self._client.cancel(list(waiting), force=True)
            raise

    def _submit(self, plan: Parts, number: int) -> None:
        known = None
        unfinished = [part for part in plan.parts if not part.done.exists()]
        for part in plan.parts:
            name = f"{plan.name} {part.span}"
            if part not in unfinished:
                self._done[name] = len(part.frames)
                continue
            if part is not plan.parts[0]:
                known = self._task(f"follow-{number}", name, (_follow, (part,)), known, 10)
            call = _fit, (part, name, self._run_id)
            future = self._task(f"fit-{number}", name, call, known, 0)
            self._parts[future] = name

    def _task(
        self,
        kind: str,
        name: str,
        call: tuple[Callable[..., Any], tuple],
        known: Any,
        priority: int,
    ) -> Any:
        return self._client.submit(
            _carrier(),
            __version__,
            pickle.dumps(call),
            known,
            key=f"asglight-{kind}-{name.replace(' ', '-')}-{self._run_id}",
            retries=RETRIES,
            priority=priority,
        )

    def _take_news(self) -> None:
        """Wait a moment for what the workers say, and pass it on."""
        with contextlib.suppress(queue.Empty):
            news = self._news.get(timeout=POLL_SECONDS)
            while True:
                self._take(news)
                news = self._news.get_nowait()

    def _take(self, news: dict[str, Any]) -> None:
        name = news["part"]
        if "done" in news:
            self._done[name] = max(self._done.get(name, 0), news["done"])
            self._tell(None)
            return
        if name in self._workers:
            self._on_progress(
                Notice(f"{name}: begun again on {news['worker']} after {self._workers[name]}")
            )
        self._workers[name] = news["worker"]

    def _tell(self, finished: str | None) -> None:
        done = sum(self._done.values())
        new = done - self._done_before
        spent = time.monotonic() - self._begin
        left = spent / new * (self._frames - done) if new > 0 else None
        self._on_progress(Farmed(done, self._frames, left, finished))

    def _failure(self, future: Any, name: str) -> Exception:
        """Return what ended a part as the user should read it; a bug as it is."""
        if future.status != "error":
            return InputError(
                f"scheduler {shown(self._address)}: lost; expected it to run until the shots are "
                "written. Start it again; --resume goes on with the parts that are left."
            )
        error = future.exception()
        if isinstance(error, self._distributed.KilledWorker):
            return InputError(
                f"{name}: every worker that took it died; expected one with memory enough. See "
                "the log of the workers; --resume goes on from the last frame."
            )
        if isinstance(error, ImportError):  # from the carrier: not the same asglight there
            return InputError(str(error))
        return error


def _carrier() -> Callable[..., Any]:
    """Return what runs a task on a worker.

    It is defined here, in a function, so that it is pickled by its code and not by its name: it
    must come to life where there is no asglight.
    """

    def run(version: str, call: bytes, known: Any) -> Any:
        """Open a call where asglight is of the same version, and make it."""
        import pickle
        import socket

        try:
            from asglight import __version__ as found
        except ImportError:
            found = None
        if found != version:
            has = "no asglight" if found is None else f"asglight {found}"
            raise ImportError(
                f"worker on {socket.gethostname()}: has {has}; expected asglight {version}, as "
                "here. Install the same one on every machine."
            )
        function, arguments = pickle.loads(call)
        return function(*arguments, known)

    return run


def _follow(part: Part, known: Followed | None) -> Followed | None:
    """Follow the lobes to a part, on a worker."""
    with _named_after_worker():
        return follow_to(part, known)


def _fit(part: Part, name: str, topic: str, known: Followed | None) -> None:
    """Fit a part, on a worker; tell the client, and stop where nobody waits any more."""
    from distributed import get_worker

    worker = get_worker()
    task = worker.state.tasks[worker.get_current_task()]

    def pass_on(event: Event) -> None:
        if task.state == "cancelled":
            raise RuntimeError(f"{name}: cancelled")
        if isinstance(event, FrameDone):
            worker.log_event(topic, {"part": name, "done": event.position})

    worker.log_event(topic, {"part": name, "worker": worker.address})
    with _named_after_worker():
        fit_part(part, known, pass_on)


@contextlib.contextmanager
def _named_after_worker() -> Iterator[None]:
    """Say on which machine an input cannot be used: on others it may be there."""
    try:
        yield
    except InputError as error:
        raise InputError(f"worker on {socket.gethostname()}: {error}") from error


def _join(plan: Parts) -> str:
    """Put a shot together, but for one that is a single part; return its stage."""
    files = [part.shot.output for part in plan.parts]
    for file in files:
        if Path(file).name not in os.listdir(Path(file).parent):  # asks the file server anew
            raise InputError(
                f"{shown(file)}: was written by a worker and is not here; expected a folder that "
                "all machines share. Write the stage to one."
            )
    if len(files) > 1:
        join(files, plan.shot.output, names_from=plan.shot.names_from)
    return plan.shot.output


def _distributed() -> Any:
    """Import Dask.

    Raises:
        InputError: It is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "scheduler: Dask is not installed here; expected it for a farm. "
            "Run: pip install 'asglight[farm]'."
        ) from error
    return distributed


@contextlib.contextmanager
def _client(distributed: Any, address: str, on_progress: OnProgress) -> Iterator[Any]:
    """Connect to a scheduler, or start one and workers here.

    Raises:
        InputError: There is none.
    """
    kind, _, count = address.partition(":")
    with contextlib.ExitStack() as stack:
        if kind == LOCAL:
            if count and not (count.isdecimal() and int(count) > 0):
                raise InputError(
                    f"scheduler: {shown(address)}; expected local or, with a number of workers, "
                    "local:4."
                )
            cluster = distributed.LocalCluster(
                n_workers=int(count or os.cpu_count() or 1),
                threads_per_worker=1,
                dashboard_address=":0",
                silence_logs=logging.ERROR,
            )
            target = stack.enter_context(cluster)
        else:
            target = address
        try:
            with warnings.catch_warnings(record=True) as found:
                warnings.simplefilter("always")
                client = distributed.Client(target, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"scheduler {shown(address)}: no answer ({compressed(str(error))}); expected a "
                "Dask scheduler, such as tcp://farm:8786. Is it running?"
            ) from error
        stack.enter_context(client)
        for one in found:
            if issubclass(one.category, distributed.versions.VersionMismatchWarning):
                on_progress(Notice(f"scheduler {address}: other versions of libraries than here"))
        if not client.scheduler_info()["workers"]:
            on_progress(Notice(f"scheduler {address}: has no workers yet; waiting for one"))
        yield client
