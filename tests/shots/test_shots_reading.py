# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
import sky_files

from asglight.errors import InputError
from asglight.images import open_sequence
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
