# SPDX-License-Identifier: Apache-2.0
import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
import shot_files
import sky_files
import torch
from lobe_cases import follow
from usd_tracks import of_every_kind

from asglight import read_usd
from asglight.errors import InputError
from asglight.fitting import sequence
from asglight.fitting.first_frame.fit import exposed
from asglight.fitting.following.whole_shot import Refinement, refine_shot
from asglight.fitting.options import FitOptions
from asglight.lobes import asg
from asglight.lobes.data import stack
from asglight.shots import ShotResult, fit_sequence, fit_shot, job
from asglight.shots.events import Event, FrameDone, Notice, Refined, Started, StepDone
from asglight.shots.kept.checkpoint import SUFFIX
from asglight.sphere.quadrature import fibonacci_directions
from asglight.usd import StageOptions, write_usd


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return sky_files.write_sequence(tmp_path / "in")


@pytest.fixture
def output(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "shot.usda"


class Whole(NamedTuple):
    """A shot that nothing broke, and what it told."""

    result: ShotResult
    stage: Path
    events: list[Event]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """Fit the frames of `source`; what is given is only read."""
    source = sky_files.write_sequence(tmp_path_factory.mktemp("images") / "in")
    stage = tmp_path_factory.mktemp("whole") / "shot.usda"
    events: list[Event] = []
    result = fit_shot(source, stage, shot_files.OPTIONS, fps=25.0, on_progress=events.append)
    return Whole(result, stage, events)


def interrupted(source: Path, output: Path, frames: int, fps: float = 24.0) -> None:
    """Run a shot and interrupt it after some frames."""
    seen: list[FrameDone] = []

    def stop(event: Event) -> None:
        if isinstance(event, FrameDone):
            seen.append(event)
        if len(seen) == frames:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_shot(source, output, shot_files.OPTIONS, fps=fps, on_progress=stop)


def test_a_frame_brighter_than_lights_can_be_is_refused(tmp_path: Path) -> None:
    values = sky_files.sky(1001)
    values[2, 3] = 3.4e38  # what many files hold where nothing was hit
    path = sky_files.write_frame(tmp_path / "sky.1001.exr", values)
    with pytest.raises(InputError, match=r"sky\.1001\.exr: has a radiance of 3\.4e\+38; exp"):
        fit_sequence(path)


def test_a_shot_is_the_fit_of_its_frames_in_order(source: Path, output: Path) -> None:
    live = replace(shot_files.OPTIONS, preset=job.Preset.LIVE)
    result = fit_shot(source, output, live)
    images = [torch.from_numpy(sky_files.sky(frame)) for frame in range(1001, 1005)]
    directions = fibonacci_directions(50)
    for index, fit in enumerate(follow(list(images), live)):
        expected = asg.evaluate(fit.lobes, directions)
        found = asg.evaluate(result.records[index].lobes, directions)
        # The frames may be turned between equals, which reorders float32 sums.
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_a_fast_shot_is_refined_between_its_neighbours(whole: Whole) -> None:
    result = whole.result
    assert [event for event in whole.events if isinstance(event, Refined)] == [Refined(4, 4)]
    images = [torch.from_numpy(sky_files.sky(frame)) for frame in range(1001, 1005)]
    shot = stack([fit.lobes for fit in follow(list(images), shot_files.OPTIONS)])
    lobes, losses = refine_shot(shot, lambda: [[exposed(image) for image in images]], Refinement())
    directions = fibonacci_directions(50)
    for index in range(4):
        expected = asg.evaluate(lobes[index], directions)
        found = asg.evaluate(result.tracks.lobes[index], directions)
        torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)  # float32 sums
    assert result.tracks.metadata["loss"] == pytest.approx(losses)


def test_a_frame_that_changed_between_the_readings_is_told(source: Path, output: Path) -> None:
    def touch(event: Event) -> None:
        if isinstance(event, FrameDone) and event.position == 4:
            path = sorted(source.iterdir())[1]
            os.utime(path, ns=(1, 1))

    with pytest.raises(InputError, match=r"1002.*: has changed since frame 1002 was fitted"):
        fit_shot(source, output, shot_files.OPTIONS, on_progress=touch)
    assert not output.exists()


def test_the_stage_holds_the_tracks(whole: Whole) -> None:
    result, tracks = whole.result, read_usd(whole.stage)
    assert tracks.frames == (1001, 1002, 1003, 1004)
    assert tracks.fps == 25.0
    assert dict(tracks.metadata) == dict(result.tracks.metadata)
    # a sample left out of the stage is reproduced to 1e-6 of the attribute's range
    torch.testing.assert_close(
        tracks.lobes.amplitude, result.tracks.lobes.amplitude, rtol=1e-5, atol=1e-5
    )


def test_nothing_is_left_beside_the_stage(whole: Whole) -> None:
    stage = whole.stage
    assert not [path for path in stage.parent.iterdir() if path.name.startswith(".")]
    assert not stage.with_name(stage.name + SUFFIX).exists()


def test_events_tell_start_frames_and_time_left(whole: Whole) -> None:
    events = whole.events
    assert events[0] == Started(4, 0)
    done = [event for event in events if isinstance(event, FrameDone)]
    assert [(event.frame, event.position, event.frames) for event in done] == [
        (1001, 1, 4),
        (1002, 2, 4),
        (1003, 3, 4),
        (1004, 4, 4),
    ]
    assert done[-1].seconds_left == 0
    # after the second frame the slow first one no longer counts
    assert done[1].seconds_left == pytest.approx(2 * done[1].seconds)


def test_the_paper_preset_tells_its_steps(source: Path, output: Path) -> None:
    events: list[Event] = []
    options = FitOptions(lobes=2, preset=job.Preset.PAPER, paper_steps=(3, 2))
    fit_shot(source, output, options, frames="1001-1002", on_progress=events.append)
    steps = [(e.frame, e.step, e.steps) for e in events if isinstance(e, StepDone)]
    assert steps == [(1001, 1, 3), (1001, 2, 3), (1001, 3, 3), (1002, 1, 2), (1002, 2, 2)]


@pytest.mark.parametrize("frames", [1, 3, 4])
def test_a_resumed_shot_is_the_unbroken_one_byte_for_byte(
    source: Path, output: Path, whole: Whole, frames: int
) -> None:
    interrupted(source, output, frames, fps=25.0)
    assert not output.exists()
    result = fit_shot(source, output, shot_files.OPTIONS, fps=25.0, resume=True)
    assert result.resumed == frames
    assert output.read_bytes() == whole.stage.read_bytes()


def test_starting_afresh_over_a_checkpoint_is_told(source: Path, output: Path) -> None:
    interrupted(source, output, 2)
    events: list[Event] = []
    result = fit_shot(source, output, shot_files.OPTIONS, on_progress=events.append)
    assert result.resumed == 0
    notices = [event.text for event in events if isinstance(event, Notice)]
    assert len(notices) == 1
    assert notices[0].endswith(
        "shot.usda.checkpoint: 2 frames of an earlier run not used; --resume would go on from there"
    )


def test_a_shot_without_locks_is_told(
    source: Path, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = job.Checkpoint.__init__

    def unlocked(self: job.Checkpoint, *args: object, **kwargs: object) -> None:
        opened(self, *args, **kwargs)  # pyright: ignore[reportArgumentType]
        self.is_locked = False

    monkeypatch.setattr(job.Checkpoint, "__init__", unlocked)
    events: list[Event] = []
    fit_shot(source, output, shot_files.OPTIONS, on_progress=events.append)
    assert [e.text for e in events if isinstance(e, Notice) and "cannot be locked" in e.text]


def test_an_image_that_changed_since_is_refused_on_resume(source: Path, output: Path) -> None:
    interrupted(source, output, 2)
    os.utime(source / "sky.1002.exr", (1, 1))
    with pytest.raises(InputError, match=r"sky\.1002\.exr: has changed since frame 1002"):
        fit_shot(source, output, shot_files.OPTIONS, resume=True)


def test_a_bad_frame_stops_the_shot_and_keeps_what_was_done(source: Path, output: Path) -> None:
    output.write_text("the old stage")
    good = (source / "sky.1003.exr").read_bytes()
    (source / "sky.1003.exr").write_bytes(good[: len(good) // 2])
    with pytest.raises(InputError, match=r"sky\.1003\.exr"):
        fit_shot(source, output, shot_files.OPTIONS)
    assert output.read_text() == "the old stage"
    (source / "sky.1003.exr").write_bytes(good)
    assert fit_shot(source, output, shot_files.OPTIONS, resume=True).resumed == 2


def test_a_bad_first_frame_leaves_nothing_behind(source: Path, output: Path) -> None:
    (source / "sky.1001.exr").write_text("no image")
    with pytest.raises(InputError, match=r"sky\.1001\.exr"):
        fit_shot(source, output, shot_files.OPTIONS)
    assert list(output.parent.iterdir()) == []


def test_an_output_that_cannot_be_written_is_found_before_the_first_frame(
    source: Path, output: Path
) -> None:
    output.with_name(output.name + SUFFIX).mkdir()
    events: list[Event] = []
    with pytest.raises(InputError, match="cannot be written"):
        fit_shot(source, output, shot_files.OPTIONS, on_progress=events.append)
    assert events == []


def test_missing_frames_are_filled_and_accounted_for(source: Path, output: Path) -> None:
    (source / "sky.1003.exr").unlink()
    result = fit_shot(source, output, shot_files.OPTIONS, missing="interpolate")
    assert result.records[2].repair.filled_from == (1002, 1004)
    assert result.tracks.metadata["repairs"]["frames_filled"] == [1003]


def test_a_black_sequence_becomes_a_stage(tmp_path: Path, output: Path) -> None:
    folder = tmp_path / "black"
    folder.mkdir()
    for frame in (1, 2):
        sky_files.write_frame(folder / f"a.{frame}.exr", 0 * sky_files.sky(frame))
    result = fit_shot(folder, output, shot_files.OPTIONS)
    assert result.tracks.metadata["left_out"]["black"] == 1
    assert float(read_usd(output).lobes.amplitude.max()) == 0


def test_a_fit_that_is_not_finite_is_a_bug_and_is_never_kept(
    source: Path, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = sequence.fit_frame

    def broken(*args: object, **kwargs: object) -> object:
        fit = original(*args, **kwargs)  # pyright: ignore[reportArgumentType]
        fit.lobes.sharpness[0, 0] = float("nan")
        return fit

    monkeypatch.setattr(sequence, "fit_frame", broken)
    with pytest.raises(RuntimeError, match="frame 1001: the fit has values that are not finite"):
        fit_shot(source, output, shot_files.OPTIONS)
    assert list(output.parent.iterdir()) == []


def test_fit_sequence_gives_the_tracks_of_fit_shot(source: Path, whole: Whole) -> None:
    tracks, written = fit_sequence(source, lobes=2, fps=25.0), whole.result.tracks
    assert torch.equal(tracks.lobes.axes, written.lobes.axes)
    assert torch.equal(tracks.lobes.amplitude, written.lobes.amplitude)
    assert dict(tracks.metadata) == dict(written.metadata)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"preset": "magic"}, "preset: magic; expected one of live, fast, best, paper"),
        ({"form": "cube"}, "form: cube; expected one of auto, asg, bingham, sg, flat"),
        ({"lobes": 0}, "lobes: 0"),
        ({"fps": -1.0}, "fps: -1"),
        ({"frames": "x"}, "frames: x; expected whole frames"),
    ],
)
def test_fit_sequence_refuses_what_it_cannot_use(
    source: Path, options: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        fit_sequence(source, **options)  # pyright: ignore[reportArgumentType]


def test_a_damaged_frame_is_filled_or_named_and_mended(tmp_path: Path) -> None:
    source = sky_files.write_sequence(tmp_path / "in")
    path = source / "sky.1003.exr"
    whole, stamp = path.read_bytes(), path.stat().st_mtime_ns
    path.write_bytes(whole[:300])
    held = fit_shot(source, tmp_path / "held.usda", shot_files.OPTIONS, missing="hold")
    assert held.records[2].repair.filled_from == (1002,)
    assert held.records[2].repair.fault.startswith("cannot be decoded (")
    assert held.tracks.metadata["repairs"]["frames_filled"] == [1003]
    output = tmp_path / "shot.usda"
    with pytest.raises(InputError, match=r"sky\.1003\.exr: cannot be decoded"):
        fit_shot(source, output, shot_files.OPTIONS)
    path.write_bytes(whole)
    os.utime(path, ns=(stamp, stamp))
    assert fit_shot(source, output, shot_files.OPTIONS, resume=True).resumed == 2


def test_a_stage_beside_whose_images_would_go_is_told_before_anything_is_read(
    tmp_path: Path,
) -> None:
    write_usd(of_every_kind([1]), tmp_path / "shot.usdc")
    with pytest.raises(InputError, match=r"shot\.usda: its images would replace those of"):
        fit_shot(tmp_path / "no such file", tmp_path / "shot.usda")
    distant = StageOptions(representations=("distant",))
    with pytest.raises(InputError, match="no such file"):
        fit_shot(tmp_path / "no such file", tmp_path / "shot.usda", stage=distant)


def test_frames_that_a_stage_cannot_have_are_told_before_the_first_is_fitted(
    tmp_path: Path, output: Path
) -> None:
    sky_files.write_sequence(tmp_path / "times", [1700000000000, 1700000000040])
    events: list[Event] = []
    with pytest.raises(InputError, match="Are they times"):
        fit_shot(tmp_path / "times", output, on_progress=events.append)
    assert not any(isinstance(event, FrameDone) for event in events)


def test_names_are_those_that_the_stage_had_when_the_first_frame_was_there(
    source: Path, output: Path
) -> None:
    """It is read beside the fit, so that nothing of it is left for the end."""
    fit_shot(source, output, shot_files.OPTIONS)
    output.write_text(output.read_text().replace("lobe_00", "key"))

    def told(event: Event) -> None:
        if isinstance(event, FrameDone) and event.position == 2:
            output.unlink()

    found = fit_shot(source, output, shot_files.OPTIONS, on_progress=told)
    assert "key" in found.tracks.names
