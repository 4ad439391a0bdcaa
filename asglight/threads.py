# SPDX-License-Identifier: Apache-2.0
"""How many threads of the processor a part of the work computes on."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from typing import TypeVar

import torch

Found = TypeVar("Found")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread, which leaves the others to reading, and to other fits."""
    before = torch.get_num_threads()
    told = _SPARED.set(threads_there())
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        _SPARED.reset(told)


def threads_there() -> int:
    """Return how many threads there are for work side by side, also within `one_thread`."""
    return max(_SPARED.get(), torch.get_num_threads())


@contextlib.contextmanager
def frames_on(threads: int) -> Iterator[None]:
    """Let compiled steps of several frames run side by side on so many threads (thread_pool.c)."""
    before = _OF_FRAMES.set(threads)
    try:
        yield
    finally:
        _OF_FRAMES.reset(before)


def frame_threads() -> int:
    """Return on how many threads frames may take compiled steps; 1 outside `frames_on`."""
    return _OF_FRAMES.get()


_OF_FRAMES: ContextVar[int] = ContextVar("of_frames", default=1)
_SPARED: ContextVar[int] = ContextVar("spared", default=1)


def side_by_side(calls: Iterable[Callable[[], Found]], threads: int) -> Iterator[Found]:
    """Yield what calls return, in their order, as many running at once as there are threads.

    What a call returns does not depend on the others, so neither does it on the number of threads.

    Args:
        calls: Taken one by one, each begun as soon as a thread is free. Those that wait when the
            caller wants no more are never begun.
        threads: With one, each is called when it is asked for, on the thread of the caller.
    """
    if threads < 2:
        for call in calls:
            yield call()
        return
    with beside(calls, threads) as answers:
        yield from answers()


def once(call: Callable[[], Found]) -> Callable[[], Found]:
    """Return a call that is made when it is first asked for; all who ask get what it returned.

    Args:
        call: Made on the thread of the first; others wait for it.
    """
    lock, found = threading.Lock(), list[Found]()

    def answer() -> Found:
        with lock:
            if not found:
                found.append(call())
            return found[0]

    return answer


@contextlib.contextmanager
def beside(
    calls: Iterable[Callable[[], Found]], threads: int = 1
) -> Iterator[Callable[[], Iterator[Found]]]:
    """Run calls in threads of their own while the caller works on something else.

    Args:
        calls: As of `side_by_side`. Those that wait at the end are never begun.
        threads: How many.

    Yields:
        What waits for the calls, and yields what each returns, in their order.
    """
    records = not torch.is_inference_mode_enabled()

    def run(call: Callable[[], Found]) -> Found:
        with torch.inference_mode(not records):  # which torch keeps for each thread
            return call()

    pool = ThreadPoolExecutor(threads)
    try:
        running = [pool.submit(run, call) for call in calls]
        yield lambda: (one.result() for one in running)
    finally:
        pool.shutdown(cancel_futures=True)
