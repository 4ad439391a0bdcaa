# SPDX-License-Identifier: Apache-2.0
"""Reduced frames are kept, so that none is decoded twice."""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import sky_files
from numpy.typing import NDArray

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.images import LatlongImage, Sequence, open_sequence
from asglight.shots import job
from asglight.shots.kept import kept_frames
from asglight.shots.kept.kept_frames import KeptFrames

FRAMES = [1001, 1002, 1003, 1004]
ROWS = 4
"""Of a reduced frame: a sixteenth of the image's texels."""

FRAME_BYTES = ROWS * 2 * ROWS * 12


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[int]:
    """Count how often each frame is decoded."""
    counted: Counter[int] = Counter()
    read = Sequence.read_or_fill

    def counting(self: Sequence, frame: int) -> LatlongImage:
        counted[frame] += 1
        return read(self, frame)

    monkeypatch.setattr(Sequence, "read_or_fill", counting)
    return counted


def shot(folder: Path, rows: int = ROWS) -> Sequence:
    for frame in FRAMES:
        sky_files.write_frame(folder / f"sky.{frame}.exr", sky(frame))
    return open_sequence(folder, height=rows)


def sky(frame: int) -> NDArray:
    return np.random.default_rng(frame).random((16, 32, 3)).astype(np.float16).astype(np.float32)


def shown(frames: KeptFrames) -> list[NDArray]:
    return [kept.radiance.numpy().copy() for kept in frames.again(FRAMES)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


@pytest.mark.parametrize("in_memory", [0, 2, 4])
def test_frames_in_memory_and_on_disk_are_those_that_were_read(
    tmp_path: Path, folder: Path, decoded: Counter[int], in_memory: int
) -> None:
    path = tmp_path / "shot.usda.frames"
    sequence = shot(folder)
    with KeptFrames(sequence, path, memory_bytes=in_memory * FRAME_BYTES) as frames:
        first = [read.image.radiance.numpy().copy() for read in frames.first(FRAMES)]
        assert path.exists() == (in_memory < 4)
        for _ in range(2):
            for one, other in zip(first, shown(frames), strict=True):
                np.testing.assert_array_equal(one, other)
        again = list(frames.first(FRAMES))
        assert [read.image.path.name for read in again] == [f"sky.{n}.exr" for n in FRAMES]
        np.testing.assert_array_equal(again[3].image.radiance.numpy(), first[3])
        frames.remove()
    assert set(decoded.values()) == {1}
    assert not path.exists()


def test_a_changed_image_is_read_anew(tmp_path: Path, folder: Path) -> None:
    sequence = shot(folder)
    with KeptFrames(sequence, tmp_path / "f", memory_bytes=2 * FRAME_BYTES) as frames:
        list(frames.first(FRAMES))
        for frame in (1001, 1004):  # one of each kind
            path = sky_files.write_frame(folder / f"sky.{frame}.exr", sky(frame) + 1)
            os.utime(path, ns=(1, 1))
        found = shown(frames)
        assert float(found[0].mean()) == pytest.approx(float(sky(1001).mean()) + 1, rel=1e-2)
        assert float(found[3].mean()) == pytest.approx(float(sky(1004).mean()) + 1, rel=1e-2)
        assert next(frames.again([1004])).stamp[1] == 1


def test_images_that_are_hardly_larger_than_the_frame_are_not_written(
    tmp_path: Path, folder: Path, decoded: Counter[int]
) -> None:
    with KeptFrames(shot(folder, 16), tmp_path / "f", memory_bytes=0) as frames:
        list(frames.first(FRAMES))
        shown(frames)
    assert not (tmp_path / "f").exists()
    assert set(decoded.values()) == {2}


def test_nothing_is_kept_that_is_not_needed(
    tmp_path: Path, folder: Path, decoded: Counter[int]
) -> None:
    with KeptFrames(shot(folder), tmp_path / "f", is_needed=False) as frames:
        list(frames.first(FRAMES))
        shown(frames)
    assert not (tmp_path / "f").exists()
    assert set(decoded.values()) == {2}


def test_a_run_that_resumes_takes_the_frames_up(
    tmp_path: Path, folder: Path, decoded: Counter[int]
) -> None:
    sequence, path = shot(folder), tmp_path / "f"
    with KeptFrames(sequence, path, header={"height": 4}, memory_bytes=0) as frames:
        list(frames.first(FRAMES[:3]))
    # killed while it wrote the last one
    path.write_bytes(path.read_bytes()[:-10])
    decoded.clear()
    again = KeptFrames(sequence, path, header={"height": 4}, resume=True, memory_bytes=0)
    with again as frames:
        for frame, found in zip(FRAMES, shown(frames), strict=True):
            expected = sequence.read(frame).radiance.numpy()
            np.testing.assert_array_equal(found, expected)
        # whichever of the first three was written last: they are read side by side
        assert sorted(decoded.values()) == [1, 1]
        assert 1004 in decoded
        decoded.clear()
        shown(frames)  # what was cut off is there again
        assert decoded == {}


@pytest.mark.parametrize(
    ("header", "resume"), [({"height": 5}, True), ({"height": 4}, False)], ids=["other", "afresh"]
)
def test_frames_of_another_run_are_not_used(
    tmp_path: Path, folder: Path, decoded: Counter[int], header: dict[str, int], resume: bool
) -> None:
    sequence, path = shot(folder), tmp_path / "f"
    with KeptFrames(sequence, path, header={"height": 4}, memory_bytes=0) as frames:
        list(frames.first(FRAMES))
    decoded.clear()
    with KeptFrames(sequence, path, header=header, resume=resume, memory_bytes=0) as frames:
        shown(frames)
        assert decoded == dict.fromkeys(FRAMES, 1)
        frames.remove()
    assert not path.exists()


def test_damage_in_the_file_is_found(tmp_path: Path, folder: Path, decoded: Counter[int]) -> None:
    sequence, path = shot(folder), tmp_path / "f"
    with KeptFrames(sequence, path, memory_bytes=0) as frames:
        list(frames.first(FRAMES))
        content = bytearray(path.read_bytes())
        content[-20] ^= 1
        path.write_bytes(content)
        found = shown(frames)
    # frames are decoded side by side: the last in the file is the one that came last
    assert sorted(decoded.values()) == [1, 1, 1, 2]
    for frame, radiance in zip(sequence.frames, found, strict=True):
        np.testing.assert_array_equal(radiance, sequence.read(frame).radiance.numpy())


def test_a_file_of_that_name_that_is_none_of_ours_stays(tmp_path: Path, folder: Path) -> None:
    path = tmp_path / "f"
    path.write_text("mine")
    with KeptFrames(shot(folder), path, memory_bytes=0, resume=True) as frames:
        list(frames.first(FRAMES))
        shown(frames)
        frames.remove()
    assert path.read_text() == "mine"


def test_a_disk_that_is_full_costs_nothing_but_time(
    tmp_path: Path, folder: Path, decoded: Counter[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(values: object) -> bytes:
        raise OSError(28, "No space left on device")

    sequence, path = shot(folder), tmp_path / "f"
    with KeptFrames(sequence, path, memory_bytes=0) as frames:
        list(frames.first(FRAMES[:1]))
        monkeypatch.setattr(kept_frames, "_line", full)
        list(frames.first(FRAMES[1:]))
        assert not path.exists()  # the stage needs the room
        assert len(shown(frames)) == 4
    assert set(decoded.values()) == {2}


def test_a_folder_that_takes_no_file_costs_nothing_but_time(folder: Path) -> None:
    with KeptFrames(shot(folder), folder / "none" / "f", memory_bytes=0) as frames:
        list(frames.first(FRAMES))
        assert len(shown(frames)) == 4


def test_an_image_that_is_gone_is_told(tmp_path: Path, folder: Path) -> None:
    with KeptFrames(shot(folder), tmp_path / "f") as frames:
        list(frames.first(FRAMES))
        (folder / "sky.1002.exr").unlink()
        with pytest.raises(InputError, match=r"sky\.1002\.exr: cannot be read"):
            shown(frames)


@pytest.mark.parametrize(
    ("options", "memory"),
    [
        (FitOptions(lobes=2, preset=Preset.FAST), 0),
        (FitOptions(lobes=2, preset=Preset.BEST), 2**20),
        (FitOptions(tolerance=0.5, max_lobes=2), 0),
    ],
    ids=["fast", "best", "tolerance"],
)
def test_a_fit_decodes_no_frame_twice(
    tmp_path: Path,
    folder: Path,
    decoded: Counter[int],
    monkeypatch: pytest.MonkeyPatch,
    options: FitOptions,
    memory: int,
) -> None:
    shot(folder)
    monkeypatch.setattr(job, "FIT_HEIGHT", 8)
    monkeypatch.setattr(kept_frames.KeptFrames.__init__, "__kwdefaults__", defaults(memory))
    job.fit_shot(folder, tmp_path / "shot.usda", options)
    assert decoded == dict.fromkeys(FRAMES, 1)
    assert not (tmp_path / "shot.usda.frames").exists()


def defaults(memory: int) -> dict[str, object]:
    return {**(kept_frames.KeptFrames.__init__.__kwdefaults__ or {}), "memory_bytes": memory}
