# SPDX-License-Identifier: Apache-2.0
"""A shot that another process fits, watched line by line."""

import os
from pathlib import Path
from typing import Any

import pytest
import shot_files
import sky_files
import torch

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.shots import fit_shot
from asglight.shots.kept.checkpoint import SUFFIX, Checkpoint, header_of
from asglight.shots.kept.records import FrameRecord, line_from, to_json
from asglight.shots.watching import ShotWatch
from asglight.usd import read_usd, write_usd

FRAMES = (1001, 1002, 1004)

HEADER: dict[str, Any] = header_of(
    {"source": "/in/sky.####.exr", "frames": list(FRAMES), "fps": 25.0, "form": "asg"}
    | {"preset": "fast"}
)

LINES = [line_from(HEADER), *(line_from(to_json(shot_files.record(frame))) for frame in FRAMES)]


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    return tmp_path / "shot.usda"


def checkpoint(stage: Path) -> Path:
    return stage.with_name(stage.name + SUFFIX)


def found(watch: ShotWatch, lobes: int = 2) -> tuple[int, ...]:
    """Return the frames found so far after comparing their lobes."""
    if watch.tracks is None:
        return ()
    expected = stack([shot_files.lobes(frame, lobes) for frame in watch.tracks.frames])
    assert torch.equal(watch.tracks.lobes.axes, expected.axes)
    assert torch.equal(watch.tracks.lobes.sharpness, expected.sharpness)
    assert torch.equal(watch.tracks.lobes.amplitude, expected.amplitude)
    return watch.tracks.frames


def test_nothing_is_there_yet(stage: Path) -> None:
    watch = ShotWatch(stage)
    assert not watch.look()
    assert (watch.tracks, watch.frames, watch.is_written) == (None, (), False)


def test_each_whole_line_is_a_frame(stage: Path) -> None:
    watch = ShotWatch(stage)
    with open(checkpoint(stage), "ab", buffering=0) as stream:
        for count, line in enumerate(LINES):
            stream.write(line)
            assert watch.look() is (count > 0)
            assert watch.frames == FRAMES
            assert found(watch) == FRAMES[:count]
            assert not watch.look()
    assert watch.tracks is not None
    assert watch.tracks.fps == 25.0
    assert watch.tracks.metadata == {"source": "sky.####.exr", "preset": "fast"}


def test_a_line_that_is_being_written_waits_until_it_is_whole(stage: Path) -> None:
    watch = ShotWatch(stage)
    content = b"".join(LINES)
    ends = [len(b"".join(LINES[:count])) for count in range(1, len(LINES) + 1)]
    with open(checkpoint(stage), "ab", buffering=0) as stream:
        for begin in range(0, len(content), 37):  # no divisor of any line's length
            stream.write(content[begin : begin + 37])
            watch.look()
            whole = sum(end <= begin + 37 for end in ends)
            assert found(watch) == FRAMES[: max(whole - 1, 0)]
    assert found(watch) == FRAMES


def test_a_line_cut_off_by_a_kill_is_replaced_by_the_resumed_run(stage: Path) -> None:
    watch = ShotWatch(stage)
    checkpoint(stage).write_bytes(b"".join(LINES[:2]) + LINES[2][:100])
    watch.look()
    assert found(watch) == FRAMES[:1]
    with Checkpoint(checkpoint(stage), HEADER, resume=True) as resumed:
        for frame in FRAMES[1:]:
            resumed.append(shot_files.record(frame))
    watch.look()
    assert found(watch) == FRAMES


def test_a_run_that_starts_afresh_is_watched_afresh(stage: Path) -> None:
    watch = ShotWatch(stage)

    def record(frame: int, lobes: int) -> FrameRecord:
        return shot_files.record(frame, lobes=shot_files.lobes(frame, lobes))

    with Checkpoint(checkpoint(stage), HEADER, resume=False) as running:
        for frame in FRAMES[:2]:
            running.append(record(frame, 2))
        assert watch.look()
        assert found(watch) == FRAMES[:2]
        running.restart()  # a tolerance was missed: again, with more lobes
        for count, frame in enumerate(FRAMES, 1):
            running.append(record(frame, 3))
            assert watch.look()
            assert found(watch, lobes=3) == FRAMES[:count]


def test_a_removed_checkpoint_leaves_what_was_found(stage: Path) -> None:
    watch = ShotWatch(stage)
    checkpoint(stage).write_bytes(b"".join(LINES[:3]))
    watch.look()
    checkpoint(stage).unlink()
    assert not watch.look()
    assert found(watch) == FRAMES[:2]


def test_the_stage_takes_the_place_of_the_checkpoint(stage: Path) -> None:
    watch = ShotWatch(stage)
    checkpoint(stage).write_bytes(b"".join(LINES[:2]))
    watch.look()
    written = stack([shot_files.lobes(frame) for frame in (1001, 1002)])
    write_usd(LobeTracks((1001, 1002), 24.0, written), stage)
    assert watch.look()
    assert watch.is_written
    assert watch.tracks is not None
    assert watch.frames == watch.tracks.frames == (1001, 1002)
    assert torch.equal(watch.tracks.lobes.sharpness, read_usd(stage).lobes.sharpness)


def test_a_real_fit_is_seen_frame_by_frame(stage: Path) -> None:
    source = sky_files.write_sequence(stage.parent / "in")
    watch = ShotWatch(stage)
    seen: list[int] = []

    def look(event: object) -> None:
        watch.look()
        seen.append(0 if watch.tracks is None else len(watch.tracks.frames))

    fit_shot(source, stage, shot_files.OPTIONS, on_progress=look)
    assert sorted(set(seen)) == [0, 1, 2, 3, 4]
    assert seen == sorted(seen)
    assert not watch.is_written
    watch.look()
    assert watch.is_written


@pytest.mark.parametrize(
    "lines",
    [
        [line_from(HEADER | {"format_version": 1})],
        [line_from({"format": "asglight checkpoint"})],
        [line_from(HEADER | {"frames": [1001, [], 1003]}), *LINES[1:]],
        [line_from(HEADER | {"frames": [1003, 1002, 1001]}), *LINES[1:]],
        [line_from(HEADER | {"fps": "24"}), *LINES[1:]],
        [LINES[0], line_from({"frame": 1001})],
        [*LINES, LINES[1]],
        [
            LINES[0],
            LINES[1],
            line_from(to_json(shot_files.record(1, lobes=shot_files.lobes(1, 5)))),
        ],
    ],
    ids=[
        "another version",
        "no header",
        "no frame number",
        "backwards",
        "no rate",
        "no frame",
        "too many frames",
        "other lobes",
    ],
)
def test_what_is_no_checkpoint_of_this_version_is_refused(stage: Path, lines: list[bytes]) -> None:
    checkpoint(stage).write_bytes(b"".join(lines))
    with pytest.raises(InputError, match=r"shot\.usda\.checkpoint: a line is no frame of this"):
        ShotWatch(stage).look()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_an_unreadable_checkpoint_is_named(stage: Path) -> None:
    checkpoint(stage).write_bytes(LINES[0])
    checkpoint(stage).chmod(0)
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\); expected"):
        ShotWatch(stage).look()


def test_a_folder_in_its_place_is_named(stage: Path) -> None:
    checkpoint(stage).mkdir()
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\); expected"):
        ShotWatch(stage).look()
