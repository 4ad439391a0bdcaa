# SPDX-License-Identifier: Apache-2.0
"""The cache of reference images, with a reader that answers when the test lets it."""

import queue
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from asglight.errors import InputError
from asglight.viewer.reference.prefetch import FrameCache, reading_order, turn

FRAMES = tuple(range(1001, 1021))

IMAGE_BYTES = 2 * 4 * 3 * 4

PATIENCE = 20.0
"""Seconds before a test gives up; a machine under load may take some of them."""


class Reader:
    """Reads the frames that the test lets through, one by one, and tells which were asked for."""

    def __init__(self) -> None:
        self.asked: queue.Queue[int] = queue.Queue()
        self.passes = threading.Semaphore(0)
        self.faults: dict[int, Exception] = {}

    def __call__(self, frame: int) -> np.ndarray:
        self.asked.put(frame)
        assert self.passes.acquire(timeout=PATIENCE)
        if frame in self.faults:
            raise self.faults[frame]
        return np.full((2, 4, 3), frame, np.float32)

    def next_asked(self) -> int:
        return self.asked.get(timeout=PATIENCE)

    def let(self, count: int) -> None:
        self.passes.release(count)


Start = Callable[..., FrameCache]


@pytest.fixture
def reader() -> Reader:
    return Reader()


@pytest.fixture
def start(reader: Reader) -> Iterator[Start]:
    """Return a function that starts a cache of one thread; it is closed after the test."""
    caches: list[FrameCache] = []

    def started(images: int = 1000, frames: tuple[int, ...] = FRAMES) -> FrameCache:
        cache = FrameCache(reader, frames, byte_budget=images * IMAGE_BYTES, threads=1)
        caches.append(cache)
        return cache

    yield started
    reader.let(1000)
    for cache in caches:
        cache.close()


def settle(reader: Reader, cache: FrameCache, frames: list[int]) -> None:
    """Let exactly these frames be read, in this order, and wait for the last."""
    for frame in frames:
        assert reader.next_asked() == frame
        reader.let(1)
    assert cache.wait(frames[-1], PATIENCE) is not None


@pytest.mark.parametrize(
    ("direction", "expected"),
    [
        # nearest first, of two equally near ones the later
        (0, [5, 6, 4, 7, 3, 8, 2, 9, 1, 0]),
        # four ahead for each one behind, round the end
        (1, [5, 6, 7, 8, 9, 4, 0, 1, 2, 3]),
        (-1, [5, 4, 3, 2, 1, 6, 0, 9, 8, 7]),
    ],
)
def test_the_order_is_nearest_first_and_ahead_before_behind(
    direction: int, expected: list[int]
) -> None:
    assert list(reading_order(10, 5, direction)) == expected


@pytest.mark.parametrize("direction", [-1, 0, 1])
@pytest.mark.parametrize("count", [1, 2, 5, 6, 7, 23])
def test_the_order_holds_every_place_once_and_the_turn_is_its_position(
    count: int, direction: int
) -> None:
    for playhead in range(count):
        order = list(reading_order(count, playhead, direction))
        assert sorted(order) == list(range(count))
        turns = [turn(count, playhead, direction, place) for place in order]
        assert turns == list(range(count))


def test_frames_are_read_once_and_given_without_waiting(reader: Reader, start: Start) -> None:
    cache = start(frames=(7, 9, 12))
    assert reader.next_asked() == 7
    assert cache.get(7) is None
    assert cache.cached_ranges() == []
    reader.let(3)
    for frame in (7, 9, 12):
        image = cache.wait(frame, PATIENCE)
        assert image is not None
        assert image.shape == (2, 4, 3)
        assert float(image[0, 0, 0]) == frame
        assert cache.get(frame) is image
    assert {reader.next_asked(), reader.next_asked()} == {9, 12}
    assert reader.asked.empty()


def test_a_jump_cancels_what_was_not_begun(reader: Reader, start: Start) -> None:
    cache = start()
    assert reader.next_asked() == 1001
    cache.look_at(1011, 1)
    reader.let(1)
    assert [reader.next_asked()] == [1011]
    cache.look_at(1006, -1)
    reader.let(4)
    assert [reader.next_asked() for _ in range(4)] == [1006, 1005, 1004, 1003]
    assert cache.get(1001) is not None  # begun before the jump, and there is room


def test_the_farthest_are_dropped_to_stay_within_the_budget(reader: Reader, start: Start) -> None:
    cache = start(images=3)
    settle(reader, cache, [1001, 1002, 1020])  # round the end at rest
    assert reader.asked.empty()
    assert cache.cached_ranges() == [(1001, 1002), (1020, 1020)]
    cache.look_at(1002, 1)
    settle(reader, cache, [1003, 1004])
    assert cache.get(1001) is None
    assert cache.get(1020) is None
    assert cache.cached_ranges() == [(1002, 1004)]


def test_an_image_that_a_jump_has_left_far_behind_is_dropped(reader: Reader, start: Start) -> None:
    cache = start(images=2)
    settle(reader, cache, [1001, 1002])
    cache.look_at(1005)
    assert reader.next_asked() == 1005
    cache.look_at(1012)  # while 1005 is being read
    reader.let(1)
    settle(reader, cache, [1012, 1013])
    assert cache.cached_ranges() == [(1012, 1013)]


def test_the_frame_at_the_playhead_is_kept_even_over_the_budget(
    reader: Reader, start: Start
) -> None:
    cache = start(images=0)
    settle(reader, cache, [1001])
    cache.look_at(1003)
    settle(reader, cache, [1003])
    assert cache.cached_ranges() == [(1003, 1003)]
    assert reader.asked.empty()


def test_ranges_end_where_an_image_is_missing(reader: Reader, start: Start) -> None:
    reader.faults[5] = InputError("sky.0005.exr: is damaged.")
    cache = start(frames=(1, 3, 5, 7))
    reader.let(4)
    for frame in (1, 3, 7):
        assert cache.wait(frame, PATIENCE) is not None
    assert cache.wait(5, PATIENCE) is None
    assert cache.cached_ranges() == [(1, 3), (7, 7)]


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (InputError("sky.1001.exr: is damaged."), "sky.1001.exr: is damaged."),
        (ValueError("bad"), "frame 1001: cannot be decoded (ValueError: bad)."),
        (MemoryError(), "frame 1001: cannot be decoded (MemoryError: )."),
    ],
)
def test_a_bad_frame_has_a_message_and_the_others_go_on(
    reader: Reader, start: Start, error: Exception, message: str
) -> None:
    reader.faults[1001] = error
    cache = start(frames=(1001, 1002))
    assert cache.message(1001) is None
    reader.let(2)
    assert cache.wait(1002, PATIENCE) is not None
    assert cache.wait(1001, PATIENCE) is None
    assert cache.message(1001) == message
    assert cache.message(1002) is None
    assert [reader.next_asked(), reader.next_asked()] == [1001, 1002]
    assert reader.asked.empty()  # a bad frame is not tried again


def test_waiting_ends_with_its_time(reader: Reader, start: Start) -> None:
    assert start().wait(1001, 0.0) is None


def test_a_frame_that_is_not_there_has_nothing(reader: Reader, start: Start) -> None:
    cache = start()
    cache.look_at(5)
    assert cache.get(5) is None
    assert cache.message(5) is None
    assert cache.wait(5, PATIENCE) is None


def test_closing_ends_the_threads_and_whoever_waits(reader: Reader) -> None:
    others = set(threading.enumerate())  # windows of other tests have decoders too
    cache = FrameCache(reader, FRAMES, byte_budget=1000 * IMAGE_BYTES, threads=2)
    assert {reader.next_asked(), reader.next_asked()} == {1001, 1002}
    found: queue.Queue[np.ndarray | None] = queue.Queue()
    waiting = threading.Thread(target=lambda: found.put(cache.wait(1010, PATIENCE)))
    waiting.start()
    closing = threading.Thread(target=cache.close)
    closing.start()
    assert found.get(timeout=PATIENCE) is None
    reader.let(2)
    closing.join(PATIENCE)
    waiting.join(PATIENCE)
    assert not set(threading.enumerate()) - others
    assert cache.get(1001) is None
    assert reader.asked.empty()


def test_two_threads_read_two_frames_at_a_time(reader: Reader) -> None:
    with FrameCache(reader, FRAMES[:4], byte_budget=1000 * IMAGE_BYTES, threads=2) as cache:
        assert {reader.next_asked(), reader.next_asked()} == {1001, 1002}  # neither is answered
        reader.let(4)
        for frame in FRAMES[:4]:
            assert cache.wait(frame, PATIENCE) is not None
        assert sorted([reader.next_asked(), reader.next_asked()]) == [1003, 1004]
