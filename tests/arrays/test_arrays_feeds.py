# SPDX-License-Identifier: Apache-2.0
"""Feeds: which frame is taken when several came, and files that are still being written."""

import errno
import io
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sky_files

from asglight.arrays.feeds import SETTLED_SECONDS, Folder, Newest, RawFormat, raw_frames
from asglight.errors import InputError
from asglight.images.options import ReadOptions

RAW = RawFormat(8, 4, "float16")


def raw(count: int) -> bytes:
    """Return frames whose every number is that of the frame, from 1."""
    return b"".join(np.full((4, 8, 3), 1 + one, "<f2").tobytes() for one in range(count))


def test_the_newest_frame_takes_the_place_of_one_that_waits() -> None:
    newest = Newest()
    for number in (1, 2, 3):
        newest.put(number, b"")
    number, _, _, dropped = newest.take() or pytest.fail("nothing is held")
    assert (number, dropped) == (3, 2)
    newest.put(4, b"")
    newest.end()
    number, _, _, dropped = newest.take() or pytest.fail("nothing is held")
    assert (number, dropped) == (4, 0)
    assert newest.take() is None


class Gate(io.RawIOBase):
    """A stream that gives its rest only when it is opened."""

    def __init__(self, first: bytes, rest: bytes) -> None:
        self.opened = threading.Event()
        self.parts = [first, rest]

    def read(self, size: int = -1) -> bytes:
        if len(self.parts[0]) == 0 and len(self.parts) > 1:
            assert self.opened.wait(10)
            self.parts.pop(0)
        given, self.parts[0] = self.parts[0][:size], self.parts[0][size:]
        return given


def test_what_comes_while_a_frame_is_fitted_is_dropped_but_for_the_last() -> None:
    stream = Gate(raw(1), raw(6)[RAW.size :])
    frames = raw_frames(stream, RAW, every=False)
    first = next(frames)
    assert (first.number, first.dropped) == (1, 0)
    stream.opened.set()
    for thread in threading.enumerate():  # the feed is read whole while this frame is held
        if thread.name == "asglight-feed":
            thread.join(10)
    (last,) = frames
    assert (last.number, last.dropped) == (6, 4)
    np.testing.assert_array_equal(last.radiance, np.full((4, 8, 3), 6.0))


def test_every_frame_comes_in_turn_where_that_is_asked_for() -> None:
    found = list(raw_frames(io.BytesIO(raw(5)), RAW, every=True))
    assert [(one.number, one.dropped) for one in found] == [(n, 0) for n in range(1, 6)]
    assert [float(one.radiance[2, 3, 1]) for one in found] == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize("every", [True, False])
def test_a_stream_that_ends_within_a_frame_is_told_of_after_the_whole_ones(every: bool) -> None:
    frames = raw_frames(io.BytesIO(raw(2)[:-5]), RAW, every=every)
    assert next(frames).number == 1
    message = r"standard input: ends 187 bytes into frame 2; expected whole frames of 192 bytes \(8"
    with pytest.raises(InputError, match=message):
        next(frames)


@pytest.mark.parametrize("every", [True, False])
def test_a_stream_that_cannot_be_read_is_told_of_and_nobody_waits(every: bool) -> None:
    class Broken(io.BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            raise OSError(errno.EIO, "Input/output error")

    with pytest.raises(InputError, match=r"standard input: cannot be read \(Input/output error\)"):
        next(raw_frames(Broken(), RAW, every=every))


class Disk:
    """A folder into which each pause writes what is next, and a clock that the pauses move."""

    def __init__(self, folder: Path, *steps: Callable[[], object]) -> None:
        self.steps, self.time, self.folder = list(steps), 0.0, folder

    def pause(self, seconds: float) -> None:
        self.time += 0.4 * SETTLED_SECONDS
        if self.steps:
            self.steps.pop(0)()

    def feed(self, source: str, skipped: list[str], *, every: bool) -> list[tuple[int, int]]:
        folder = Folder(
            source,
            ReadOptions(),
            every=every,
            idle=5 * SETTLED_SECONDS,
            on_skip=skipped.append,
            pause=self.pause,
            clock=lambda: self.time,
        )
        return [(one.number, one.dropped) for one in folder.frames()]


def write(folder: Path, *numbers: int) -> Callable[[], None]:
    def step() -> None:
        for number in numbers:
            sky_files.write_frame(folder / f"sky.{number}.exr", sky_files.sky(number))

    return step


def write_part(folder: Path, number: int) -> Callable[[], None]:
    def step() -> None:
        path = folder / f"sky.{number}.exr"
        write(folder, number)()
        path.write_bytes(path.read_bytes()[:200])

    return step


@pytest.mark.parametrize("pattern", ["", "sky.####.exr"])
def test_a_folder_gives_its_newest_frame(tmp_path: Path, pattern: str) -> None:
    steps = (write(tmp_path, 1001), write(tmp_path, 1002, 1003, 1004), write(tmp_path, 1005))
    found = Disk(tmp_path, *steps).feed(str(tmp_path / pattern), [], every=False)
    assert found == [(1001, 0), (1004, 2), (1005, 0)]


def test_or_every_frame_by_number(tmp_path: Path) -> None:
    steps = (write(tmp_path, 1001), write(tmp_path, 1003, 1002, 1004))
    found = Disk(tmp_path, *steps).feed(str(tmp_path), [], every=True)
    assert found == [(1001, 0), (1002, 0), (1003, 0), (1004, 0)]


@pytest.mark.parametrize("every", [False, True])
def test_a_file_is_read_when_it_is_whole(tmp_path: Path, every: bool) -> None:
    steps = (write(tmp_path, 1001), write_part(tmp_path, 1002), write(tmp_path, 1002))
    skipped: list[str] = []
    assert Disk(tmp_path, *steps).feed(str(tmp_path), skipped, every=every) == [
        (1001, 0),
        (1002, 0),
    ]
    assert skipped == []


def test_a_file_that_stays_damaged_is_passed_over_and_said(tmp_path: Path) -> None:
    steps = (write(tmp_path, 1001), write_part(tmp_path, 1002), write(tmp_path, 1003))
    skipped: list[str] = []
    found = Disk(tmp_path, *steps).feed(str(tmp_path), skipped, every=True)
    assert found == [(1001, 0), (1003, 0)]
    (line,) = skipped
    assert line.startswith(f"{tmp_path}/sky.1002.exr: ")


def test_a_frame_that_is_written_does_not_hold_up_the_newest_whole_one(tmp_path: Path) -> None:
    def both() -> None:
        write(tmp_path, 1002)()
        write_part(tmp_path, 1003)()

    steps = (write(tmp_path, 1001), both, write(tmp_path, 1003))
    found = Disk(tmp_path, *steps).feed(str(tmp_path), [], every=False)
    assert found == [(1001, 0), (1002, 0), (1003, 0)]


def test_two_sequences_in_one_folder_are_refused(tmp_path: Path) -> None:
    write(tmp_path, 1001)()
    sky_files.write_frame(tmp_path / "other.1001.exr", sky_files.sky(1))
    with pytest.raises(InputError, match="holds 2 images or sequences"):
        Disk(tmp_path).feed(str(tmp_path), [], every=False)


@pytest.mark.parametrize("base", ["sky_", "sky.", ""])
@pytest.mark.parametrize("first", [0, 1001])
def test_a_file_has_the_number_of_its_name_also_while_it_is_alone(
    tmp_path: Path, base: str, first: int
) -> None:
    def written(number: int) -> Callable[[], None]:
        path = tmp_path / f"{base}{number:04d}.exr"
        return lambda: sky_files.write_frame(path, sky_files.sky(number))

    numbers = [first, first + 1, first + 2]
    found = Disk(tmp_path, *map(written, numbers)).feed(str(tmp_path), [], every=True)
    assert found == [(number, 0) for number in numbers]


def test_what_else_comes_into_the_folder_is_no_frame(tmp_path: Path) -> None:
    def renamed() -> None:
        (tmp_path / "sky.1002.tmp.exr").rename(tmp_path / "sky.1002.exr")

    def begun() -> None:
        sky_files.write_frame(tmp_path / "sky.1002.tmp.exr", sky_files.sky(1002))

    steps = (write(tmp_path, 1001), begun, lambda: None, renamed)
    assert Disk(tmp_path, *steps).feed(str(tmp_path), [], every=True) == [(1001, 0), (1002, 0)]
