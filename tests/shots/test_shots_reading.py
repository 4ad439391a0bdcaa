# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
import sky_files

from asglight.errors import InputError
from asglight.images import LatlongImage, Sequence, open_sequence
from asglight.shots.reading import read_ahead, stamp_of


def test_frames_come_in_order_with_their_stamps(tmp_path: Path) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    read = list(read_ahead(open_sequence(folder), [1002, 1003]))
    for frame, found in zip((1002, 1003), read, strict=True):
        assert np.array_equal(found.image.radiance.numpy(), sky_files.sky(frame))
        state = (folder / f"sky.{frame}.exr").stat()
        assert found.stamp == (state.st_size, state.st_mtime_ns)


def test_no_frames_read_nothing(tmp_path: Path) -> None:
    assert list(read_ahead(open_sequence(sky_files.write_sequence(tmp_path / "in")), [])) == []


def test_a_bad_frame_is_told_when_its_turn_comes(tmp_path: Path) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    (folder / "sky.1002.exr").write_text("no image")
    images = read_ahead(open_sequence(folder), [1001, 1002])
    assert next(images).image.path.name == "sky.1001.exr"
    with pytest.raises(InputError, match=r"sky\.1002\.exr"):
        next(images)


def test_a_file_that_is_gone_is_named(tmp_path: Path) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    sequence = open_sequence(folder)
    (folder / "sky.1003.exr").unlink()
    with pytest.raises(InputError, match=r"sky\.1003\.exr: cannot be read \(No such file.*1003"):
        stamp_of(sequence, 1003)


def writing_during(monkeypatch: pytest.MonkeyPatch, path: Path, contents: list[bytes]) -> None:
    """Let each reading of an image end with the next content in its file."""
    read = Sequence.read_or_fill

    def meanwhile(self: Sequence, frame: int) -> LatlongImage:
        try:
            return read(self, frame)
        finally:
            if frame == 1002 and contents:
                path.write_bytes(contents.pop(0))

    monkeypatch.setattr(Sequence, "read_or_fill", meanwhile)


def test_a_frame_replaced_while_it_is_read_is_read_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    path = folder / "sky.1002.exr"
    other = sky_files.write_frame(tmp_path / "other.exr", sky_files.sky(7)).read_bytes()
    writing_during(monkeypatch, path, [other + b" "])
    (found,) = read_ahead(open_sequence(folder), [1002])
    assert np.array_equal(found.image.radiance.numpy(), sky_files.sky(7))
    assert found.stamp == (len(other) + 1, path.stat().st_mtime_ns)


def test_a_frame_replaced_by_a_half_written_one_is_read_anew_when_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    path = folder / "sky.1002.exr"
    whole = path.read_bytes()
    path.write_bytes(whole[:200])
    writing_during(monkeypatch, path, [whole])
    (found,) = read_ahead(open_sequence(folder), [1002])
    assert np.array_equal(found.image.radiance.numpy(), sky_files.sky(1002))


def test_a_frame_that_keeps_changing_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    path = folder / "sky.1002.exr"
    whole = path.read_bytes()
    writing_during(monkeypatch, path, [whole + bytes(count) for count in range(1, 9)])
    message = r"sky\.1002\.exr: changes while it is read; expected the finished image of frame 1002"
    with pytest.raises(InputError, match=message):
        list(read_ahead(open_sequence(folder), [1002]))
