# SPDX-License-Identifier: Apache-2.0
"""A shot cut into parts, and the folder that keeps them."""

import errno
import itertools
import os
import threading
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import pytest
import shot_files
import sky_files

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.shots import fit_shot
from asglight.shots.events import Event, Notice, ignore
from asglight.shots.kept.checkpoint import BusyError, Checkpoint, alone, header_of
from asglight.shots.parts import chunks
from asglight.shots.parts.chunks import OVERLAP, Parts, Shot, cut, fit_part

LIVE = FitOptions(lobes=2, preset=Preset.LIVE)


@pytest.mark.parametrize("length", [8, 13, 48])
@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 17, 100, 241])
def test_parts_cover_the_shot_and_overlap(count: int, length: int) -> None:
    frames = tuple(range(1001, 1001 + 2 * count, 2))
    parts = cut(frames, length)
    assert len(parts) == -(-count // length)
    assert sorted({frame for part in parts for frame in part}) == list(frames)
    for before, after in itertools.pairwise(parts):
        assert len(set(before) & set(after)) == OVERLAP
        assert before[-OVERLAP:] == after[:OVERLAP]
    # each frame is in two parts at most, so that a blend is of two
    assert sum(map(len, parts)) == count + OVERLAP * (len(parts) - 1)
    assert max(map(len, parts)) <= length + OVERLAP


@pytest.fixture
def shot(tmp_path: Path) -> Shot:
    source = sky_files.write_sequence(tmp_path / "in", range(1001, 1017))
    (tmp_path / "out").mkdir()
    return Shot(str(source), str(tmp_path / "out" / "shot.usda"), LIVE)


def begin(shot: Shot, *, resume: bool = False, chunk: int = 8) -> list[str]:
    """Open a shot's parts, finish the first where none is, and return the notices."""
    events: list[Event] = []
    with Parts(shot, chunk, resume=resume, on_progress=events.append) as parts:
        first = parts.parts[0]
        if not first.done.exists():
            Path(first.shot.output).touch()
            first.done.touch()
    return [event.text for event in events if isinstance(event, Notice)]


def test_each_part_has_a_stage_of_its_own_and_the_shots_preroll(shot: Shot) -> None:
    with Parts(shot, 8, resume=False, on_progress=ignore) as parts:
        assert [part.span for part in parts.parts] == ["1001-1010", "1007-1016"]
        assert [Path(part.shot.output).name for part in parts.parts] == [
            "part.1001-1010.usdc",
            "part.1007-1016.usdc",
        ]
        assert {part.shot.options.preroll for part in parts.parts} == {1001}
        assert (parts.name, parts.frames) == ("sky", 20)
    assert not parts.folder.exists()  # nothing was kept in it


@pytest.mark.parametrize(
    "options", [replace(LIVE, preset=Preset.PAPER), FitOptions(tolerance=0.02)], ids=str
)
def test_a_shot_whose_parts_would_not_fit_together_is_not_cut(
    shot: Shot, options: FitOptions
) -> None:
    with Parts(replace(shot, options=options), 8, resume=False, on_progress=ignore) as parts:
        (part,) = parts.parts
        assert part.shot.output == shot.output
        assert part.shot.options == options


def test_a_shot_with_a_gap_is_one_part(shot: Shot) -> None:
    """A preroll goes by the step of a part, and would ask for frames that were left out."""
    gap = replace(shot, frames="1001-1006,1010-1016")
    with Parts(gap, 8, resume=False, on_progress=ignore) as parts:
        assert len(parts.parts) == 1
    with Parts(replace(shot, frames="1001-1016x2"), 8, resume=False, on_progress=ignore) as parts:
        assert len(parts.parts) == 1  # of eight frames
        assert parts.frames == 8


def test_finished_parts_are_kept_or_told(shot: Shot) -> None:
    begin(shot)
    assert begin(shot, resume=True) == []
    (notice,) = begin(shot)
    assert notice.endswith(
        "shot.usda.parts: 1 finished part of an earlier run not used; --resume would go on from "
        "there"
    )


def test_another_run_is_refused(shot: Shot) -> None:
    begin(shot)
    with pytest.raises(InputError, match=r"shot\.usda\.parts: was made with lobes 2, this run"):
        begin(replace(shot, options=replace(LIVE, lobes=3)), resume=True)
    with pytest.raises(InputError, match=r"was made with chunk 8, this run has 9"):
        begin(shot, resume=True, chunk=9)


def test_a_changed_image_is_refused_where_a_part_has_used_it(shot: Shot) -> None:
    begin(shot)
    os.utime(Path(shot.source) / "sky.1011.exr", (1, 1))  # the second part, not begun
    begin(shot, resume=True)
    os.utime(Path(shot.source) / "sky.1010.exr", (1, 1))
    with pytest.raises(InputError, match=r"sky\.1010\.exr: has changed since .*; expected the"):
        begin(shot, resume=True)


def test_a_damaged_settings_file_costs_no_finished_part(shot: Shot) -> None:
    begin(shot)
    folder = Path(shot.output + ".parts")
    settings = folder / "settings.json"
    settings.write_bytes(settings.read_bytes()[:20])
    with pytest.raises(InputError, match=r"settings\.json: is damaged; expected the settings of"):
        begin(shot, resume=True)
    assert (folder / "part.1001-1010.done").exists()
    assert len(begin(shot)) == 1  # afresh, as was asked


def test_a_full_disk_damages_no_settings(shot: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(stream: BinaryIO, data: bytes) -> None:
        stream.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    begin(shot)
    settings = Path(shot.output + ".parts") / "settings.json"
    before = settings.read_bytes()
    os.utime(Path(shot.source) / "sky.1016.exr", (1, 1))  # so that they are written anew
    with monkeypatch.context() as patched:
        patched.setattr(chunks, "write_all", full)
        with pytest.raises(InputError, match=r"settings\.json: cannot be written \(No space left"):
            begin(shot, resume=True)
    assert settings.read_bytes() == before
    assert begin(shot, resume=True) == []
    assert settings.read_bytes() != before


def test_settings_that_are_replaced_are_locked_all_along(shot: Shot) -> None:
    begin(shot)
    os.utime(Path(shot.source) / "sky.1016.exr", (1, 1))
    with (
        Parts(shot, 8, resume=True, on_progress=ignore),
        pytest.raises(BusyError, match="another run is writing it"),
    ):
        Parts(shot, 8, resume=True, on_progress=ignore)


def test_the_checkpoint_of_a_fit_that_runs_is_left_to_it(shot: Shot) -> None:
    whole = replace(shot, frames="1001-1003")
    path = Path(shot.output + ".checkpoint")
    with Checkpoint(path, header_of({}), resume=False) as held:
        held.append(shot_files.record(1001))
        with pytest.raises(BusyError, match=r"shot\.usda: another run is writing it"):
            Parts(whole, 8, resume=False, on_progress=ignore)
    assert path.exists()
    Parts(whole, 8, resume=False, on_progress=ignore).__exit__()
    assert not path.exists()


def test_a_folder_of_others_is_left_alone(shot: Shot) -> None:
    folder = Path(shot.output + ".parts")
    folder.mkdir()
    (folder / "part.time").write_text("tables")
    with pytest.raises(InputError, match=r"shot\.usda\.parts: holds no parts of asglight"):
        begin(shot)
    assert (folder / "part.time").read_text() == "tables"


def test_two_runs_on_one_stage_are_refused(shot: Shot) -> None:
    with (
        Parts(shot, 8, resume=False, on_progress=ignore),
        pytest.raises(BusyError, match="another run is writing it"),
    ):
        Parts(shot, 8, resume=True, on_progress=ignore)


def test_nothing_else_writes_the_stage_of_a_shot_in_parts(shot: Shot) -> None:
    done = Path(shot.output + ".parts") / "part.1001-1010.done"
    begin(shot)
    with alone(shot.output), pytest.raises(BusyError, match=r"shot\.usda: another run is writing"):
        begin(shot)
    assert done.exists()
    with Parts(shot, 8, resume=True, on_progress=ignore):
        with pytest.raises(BusyError, match="another run is writing it"), alone(shot.output):
            pass
        with pytest.raises(BusyError, match="another run is writing it"):
            fit_shot(shot.source, shot.output, LIVE)
    with alone(shot.output):
        pass


def test_a_part_waits_for_a_worker_that_was_given_up(
    shot: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Parts(replace(shot, frames="1001-1003"), 8, resume=False, on_progress=ignore) as parts:
        (part,) = parts.parts
        held = Checkpoint(Path(part.shot.output + ".checkpoint"), header_of({}), resume=False)
        release = threading.Timer(0.2, held.remove)
        release.start()
        fit_part(part, None, ignore)
        release.join()
        assert part.done.exists()
    alone = tmp_path / "shot.usda"
    fit_shot(shot.source, alone, LIVE, frames="1001-1003")
    assert alone.read_bytes() == Path(shot.output).read_bytes()
    monkeypatch.setattr(chunks, "BUSY_SECONDS", 0.0)
    part.done.unlink()
    with (
        Checkpoint(Path(part.shot.output + ".checkpoint"), header_of({}), resume=False),
        pytest.raises(BusyError, match="another run is writing it"),
    ):
        fit_part(part, None, ignore)
