# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
import sky_files

from asglight.errors import InputError
from asglight.viewer.reference.images import Reference, open_reference

PATIENCE = 20.0
"""Seconds before a test gives up; a machine under load may take some of them."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return sky_files.write_sequence(tmp_path / "in")


def closed(reference: Reference) -> Reference:
    reference.close()
    return reference


@pytest.mark.parametrize("source", ["in", "in/sky.####.exr", "in/sky.%04d.exr"])
def test_a_folder_and_a_pattern_are_their_frames(folder: Path, source: str) -> None:
    reference = open_reference(str(folder.parent / source))
    assert reference.name == "sky"
    assert reference.frames == reference.timeline == (1001, 1002, 1003, 1004)
    for frame in reference.frames:
        image = reference.wait(frame, PATIENCE)
        assert image is not None
        assert np.array_equal(image, sky_files.sky(frame))
        assert image.dtype == np.float32
        assert image.flags.c_contiguous  # as OpenGL takes it
    assert reference.cached_ranges() == [(1001, 1004)]
    closed(reference)


def test_a_single_image_serves_every_frame(folder: Path) -> None:
    reference = open_reference(str(folder / "sky.1003.exr"))
    assert reference.is_still
    for frame in (1, 1003, 5000):
        image = reference.wait(frame, PATIENCE)
        assert image is not None
        assert np.array_equal(image, sky_files.sky(1003))
        assert reference.get(frame) is image
        assert reference.message(frame) is None
    assert closed(reference).cached_ranges() == []


def test_a_missing_frame_has_a_message_and_stops_nothing(folder: Path) -> None:
    (folder / "sky.1002.exr").unlink()
    reference = open_reference(str(folder))
    assert reference.frames == (1001, 1003, 1004)
    assert reference.timeline == (1001, 1002, 1003, 1004)
    for frame in (1002, 999):
        assert reference.wait(frame, PATIENCE) is None
        message = f"sky: has no frame {frame}; it has 1001, 1003, 1004."
        assert reference.message(frame) == message
    assert reference.wait(1003, PATIENCE) is not None
    closed(reference)


def test_a_bad_frame_has_the_message_of_its_file(folder: Path) -> None:
    (folder / "sky.1002.exr").write_text("no image")
    reference = open_reference(str(folder))
    assert reference.wait(1002, PATIENCE) is None
    assert "sky.1002.exr: " in str(reference.message(1002))
    assert reference.wait(1001, PATIENCE) is not None
    closed(reference)


def test_frames_can_be_chosen(folder: Path) -> None:
    assert closed(open_reference(str(folder), frames="1002-1003")).frames == (1002, 1003)


def test_large_images_are_averaged_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asglight.viewer.reference.images.HEIGHT_MAX", 4)
    values = np.zeros((8, 16, 3), np.float32)
    values[:, :8] = 1.0
    path = sky_files.write_frame(tmp_path / "large.exr", values)
    reference = open_reference(str(path))
    image = reference.wait(1, PATIENCE)
    assert image is not None
    assert image.shape == (4, 8, 3)
    # Means of equal values; the weights of a texel's parts sum to 1 within float32.
    assert np.allclose(image, values[::2, ::2], atol=1e-6)
    closed(reference)


def test_nothing_to_open_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.####\.exr"):
        open_reference(str(tmp_path / "none.####.exr"))
