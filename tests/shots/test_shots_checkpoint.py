# SPDX-License-Identifier: Apache-2.0
import errno
import fcntl
import os
from pathlib import Path

import pytest
import shot_files

from asglight.errors import InputError
from asglight.shots.kept import checkpoint
from asglight.shots.kept.checkpoint import Checkpoint, header_of
from asglight.shots.kept.records import line_from

HEADER = header_of(
    {"asglight": "0.1.0", "source": "/a/sky.####.exr", "frames": [1, 2, 3], "lobes": 2}
    | {"form": "asg", "layer": None}
)


def written(path: Path, frames: int = 2) -> bytes:
    """Write a checkpoint of some frames and return its bytes."""
    with Checkpoint(path, HEADER, resume=False) as file:
        for frame in range(1, frames + 1):
            file.append(shot_files.record(frame))
    return path.read_bytes()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "shot.usda.checkpoint"


def resumed_frames(path: Path) -> list[int]:
    with Checkpoint(path, HEADER, resume=True) as file:
        return [record.frame for record in file.records]


def test_the_file_has_a_header_and_a_line_a_frame(path: Path) -> None:
    lines = written(path, 3).splitlines(keepends=True)
    assert lines[0] == line_from(HEADER)
    assert len(lines) == 4


def test_resume_gives_back_the_frames_and_goes_on_after_them(path: Path) -> None:
    whole = written(path, 3)
    path.unlink()
    written(path, 2)
    with Checkpoint(path, HEADER, resume=True) as file:
        assert [record.frame for record in file.records] == [1, 2]
        file.append(shot_files.record(3))
    assert path.read_bytes() == whole


def test_resume_without_a_file_starts_at_the_first_frame(path: Path) -> None:
    assert resumed_frames(path) == []


def test_a_run_without_a_frame_leaves_no_file(path: Path) -> None:
    with Checkpoint(path, HEADER, resume=False):
        assert path.exists()
    assert not path.exists()


def test_a_run_without_a_frame_leaves_an_older_checkpoint_as_it_was(path: Path) -> None:
    before = written(path)
    with Checkpoint(path, HEADER, resume=False) as file:
        assert file.left_aside == 2
        assert file.records == []
    assert path.read_bytes() == before


def test_starting_afresh_replaces_the_older_frames_at_the_first_new_one(path: Path) -> None:
    written(path, 3)
    with Checkpoint(path, HEADER, resume=False) as file:
        file.append(shot_files.record(1))
    assert resumed_frames(path) == [1]


def test_a_file_cut_off_at_any_byte_gives_back_every_whole_frame(path: Path) -> None:
    whole = written(path, 2)
    ends = [index + 1 for index, byte in enumerate(whole) if byte == ord("\n")]
    for cut in range(0, len(whole) + 1, 7):
        path.write_bytes(whole[:cut])
        expected = max(sum(end <= cut for end in ends) - 1, 0)
        assert resumed_frames(path) == list(range(1, expected + 1))


def test_the_cut_off_line_is_overwritten(path: Path) -> None:
    whole = written(path, 2)
    path.write_bytes(whole[:-30])
    with Checkpoint(path, HEADER, resume=True) as file:
        file.append(shot_files.record(2))
    assert path.read_bytes() == whole


def test_a_last_line_with_a_bad_crc_is_dropped(path: Path) -> None:
    content = bytearray(written(path, 2))
    content[-40] ^= 1
    path.write_bytes(content)
    assert resumed_frames(path) == [1]


@pytest.mark.parametrize("line", [1, 2])
def test_damage_before_the_last_line_is_refused_with_its_line(path: Path, line: int) -> None:
    lines = written(path, 3).splitlines(keepends=True)
    lines[line - 1] = lines[line - 1][:50] + b"#" + lines[line - 1][51:]
    path.write_bytes(b"".join(lines))
    with pytest.raises(InputError, match=rf"line {line} is damaged; expected .* Delete the file"):
        Checkpoint(path, HEADER, resume=True)


def test_frames_out_of_order_are_damage(path: Path) -> None:
    with Checkpoint(path, HEADER, resume=False) as file:
        file.append(shot_files.record(2))
    with pytest.raises(InputError, match="line 2 is damaged"):
        Checkpoint(path, HEADER, resume=True)


def test_more_frames_than_the_shot_has_are_damage(path: Path) -> None:
    written(path, 4)
    with pytest.raises(InputError, match="line 5 is damaged"):
        Checkpoint(path, HEADER, resume=True)


def test_a_record_without_its_fields_is_damage(path: Path) -> None:
    path.write_bytes(line_from(HEADER) + line_from({"frame": 1}) + line_from({"frame": 2}))
    with pytest.raises(InputError, match="line 2 is damaged"):
        Checkpoint(path, HEADER, resume=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"asglight": "9.9"}, r"made with asglight 0\.1\.0, this run has 9\.9; expected the same"),
        ({"lobes": 7}, r"made with lobes 2, this run has 7"),
        ({"frames": [1, 2]}, r"made with frames 1, 2, 3, this run has 1, 2;"),
        ({"source": "/b.exr"}, r"made with source /a/sky\.####\.exr, this run has /b\.exr"),
        ({"source": "\ud800"}, r"this run has \?; expected the same"),  # as damaged JSON may hold
        ({"layer": "diffuse"}, r"made with layer none, this run has diffuse"),
        ({"format_version": 5}, r"made with format version 4, this run has 5"),
        ({"new_option": 3}, r"made with new option none, this run has 3; .* leave out --resume"),
    ],
)
def test_another_run_is_refused_with_what_differs(
    path: Path, change: dict[str, object], message: str
) -> None:
    before = written(path)
    with pytest.raises(InputError, match=message):
        Checkpoint(path, HEADER | change, resume=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize("resume", [True, False])
def test_a_foreign_file_is_never_touched(path: Path, resume: bool) -> None:
    path.write_text("my notes")
    with pytest.raises(InputError, match=r"is no checkpoint of asglight; .* Move it away"):
        Checkpoint(path, HEADER, resume=resume)
    assert path.read_text() == "my notes"


def test_a_second_run_is_refused_while_the_first_lives(path: Path) -> None:
    with Checkpoint(path, HEADER, resume=False) as first:
        first.append(shot_files.record(1))
        with pytest.raises(InputError, match=r"shot\.usda: another run is writing it"):
            Checkpoint(path, HEADER, resume=True)
    assert resumed_frames(path) == [1]


def test_a_file_that_was_deleted_before_it_was_locked_is_opened_anew(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, calls = fcntl.flock, []

    def delete_first(descriptor: int, operation: int) -> None:
        if not calls:
            path.unlink()
        calls.append(descriptor)
        lock(descriptor, operation)

    monkeypatch.setattr(checkpoint.fcntl, "flock", delete_first)
    written(path, 1)
    assert len(calls) == 2
    assert resumed_frames(path) == [1]


def test_a_file_system_without_locks_is_told_of(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(checkpoint.fcntl, "flock", no_locks)
    with Checkpoint(path, HEADER, resume=False) as file:
        assert not file.is_locked


def test_a_folder_in_the_way_is_refused(path: Path) -> None:
    path.mkdir()
    with pytest.raises(InputError, match=r"cannot be written \(Is a directory\); expected"):
        Checkpoint(path, HEADER, resume=False)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders")
def test_a_read_only_folder_is_refused(path: Path) -> None:
    path.parent.chmod(0o555)
    with pytest.raises(InputError, match=r"cannot be written \(Permission denied\)"):
        Checkpoint(path, HEADER, resume=False)


def test_a_full_disk_is_told_and_the_frames_before_it_are_kept(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(stream: object, data: bytes) -> None:
        stream.write(data[: len(data) // 2])  # pyright: ignore[reportAttributeAccessIssue]
        raise OSError(errno.ENOSPC, "No space left on device")

    with Checkpoint(path, HEADER, resume=False) as file:
        file.append(shot_files.record(1))
        monkeypatch.setattr(checkpoint, "write_all", full)
        with pytest.raises(InputError, match=r"\(No space left on device\).* --resume goes on"):
            file.append(shot_files.record(2))
    assert resumed_frames(path) == [1]


def test_each_frame_is_forced_to_disk(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(
        checkpoint.os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor).st_size)
    )
    content = written(path, 2)
    lines = content.splitlines(keepends=True)
    assert synced == [len(content) - len(lines[2]), len(content)]


def test_remove_deletes_the_file(path: Path) -> None:
    with Checkpoint(path, HEADER, resume=False) as file:
        file.append(shot_files.record(1))
        file.remove()
    assert not path.exists()
