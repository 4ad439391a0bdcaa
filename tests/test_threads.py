# SPDX-License-Identifier: Apache-2.0
"""One thread for a while, and what was allowed before from then on; calls side by side."""

import threading
import time
from collections.abc import Iterator
from functools import partial

import pytest
import torch

from asglight.threads import (
    beside,
    frame_threads,
    frames_on,
    once,
    one_thread,
    side_by_side,
    threads_there,
)


@pytest.fixture(autouse=True)
def allowed() -> Iterator[None]:
    """Allow four threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    assert torch.get_num_threads() == 4
    torch.set_num_threads(before)


def test_one_thread_is_one_and_gives_back_what_was() -> None:
    with one_thread():
        assert torch.get_num_threads() == 1
    with pytest.raises(KeyError), one_thread():
        raise KeyError


def test_threads_that_are_spared_are_there_for_work_side_by_side() -> None:
    assert threads_there() == 4
    with one_thread(), one_thread():
        assert threads_there() == 4
    torch.set_num_threads(2)
    assert threads_there() == 2
    torch.set_num_threads(4)


def test_frames_are_on_one_thread_but_where_more_are_allowed() -> None:
    with frames_on(3):
        assert frame_threads() == 3
        with one_thread(), beside([frame_threads]) as answers:
            assert list(answers()) == [1]  # not on the threads of others
    assert frame_threads() == 1


def test_calls_side_by_side_are_answered_in_their_order() -> None:
    both = threading.Barrier(2, timeout=60)

    def call(number: int) -> tuple[int, int, bool]:
        if number < 2:
            both.wait()  # for which two must run at once
        return number, torch.get_num_threads(), torch.is_inference_mode_enabled()

    with one_thread(), torch.inference_mode():
        found = list(side_by_side((partial(call, number) for number in range(5)), threads=2))
    assert found == [(number, 1, True) for number in range(5)]


@pytest.mark.parametrize("threads", [1, 2])
def test_calls_that_are_not_wanted_any_more_are_not_begun(threads: int) -> None:
    begun: list[int] = []
    last = 3 * threads

    def call(number: int) -> int:
        begun.append(number)
        if 0 < number < last:
            wanted.wait(60)
        return number

    wanted = threading.Event()
    found = side_by_side((partial(call, number) for number in range(last + 1)), threads)
    assert next(found) == 0
    threading.Timer(0.2, wanted.set).start()
    found.close()
    assert last not in begun


def test_what_a_call_raises_reaches_the_caller() -> None:
    def call() -> None:
        raise KeyError

    for threads in (1, 2):
        with pytest.raises(KeyError):
            list(side_by_side([call], threads))


def test_calls_beside_run_while_the_caller_works_and_are_answered_when_it_asks() -> None:
    working = threading.Event()

    def call(number: int) -> int:
        assert working.wait(60)  # which the caller sets once they are begun
        return number

    with beside([partial(call, number) for number in range(3)]) as answers:
        working.set()
        assert list(answers()) == [0, 1, 2]


def test_calls_beside_that_wait_at_the_end_are_not_begun() -> None:
    begun: list[int] = []
    wanted = threading.Event()

    def call(number: int) -> None:
        begun.append(number)
        wanted.wait(60)

    threading.Timer(0.2, wanted.set).start()
    with pytest.raises(KeyError), beside([partial(call, number) for number in range(3)]):
        raise KeyError
    assert 2 not in begun


def test_a_call_that_several_threads_ask_for_at_once_is_made_once() -> None:
    asking, made = threading.Barrier(3, timeout=60), list[int]()

    @once
    def call() -> int:
        time.sleep(0.05)  # in which the others come
        made.append(len(made))
        return made[-1]

    def ask() -> int:
        asking.wait()
        return call()

    assert list(side_by_side([ask] * 3, threads=3)) == [0, 0, 0]
    assert call() == 0
    assert made == [0]


def test_a_call_that_failed_is_made_again_by_who_asks_next() -> None:
    answers = iter([1])

    @once
    def call() -> int:
        if not failed:
            failed.append(True)
            raise KeyError
        return next(answers)

    failed = list[bool]()
    with pytest.raises(KeyError):
        call()
    assert call() == call() == 1
