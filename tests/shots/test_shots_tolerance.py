# SPDX-License-Identifier: Apache-2.0
"""The fewest lobes that a tolerance allows."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from lobe_cases import lamps

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.images import open_sequence, write_exr
from asglight.judging.metrics import frame_errors
from asglight.lobes import Lobes, texels
from asglight.lobes.data import stack
from asglight.shots import fit_sequence, fit_shot, leaving_out, rounds
from asglight.shots.events import Event, FrameDone, Notice, Searched, Started
from asglight.shots.tolerance import Accuracy, fewest, more_lobes, spread_frames

THREE = (
    [(0.0, 1.0, 0.1), (1.0, 0.2, 0.0), (-0.3, 0.2, -1.0)],
    [1.5, 40.0, 200.0],
    [1.0, 8.0, 30.0],
)
LIVE = FitOptions(tolerance=0.02, preset=Preset.LIVE)


def write_lamps(folder: Path, scenes: list[Lobes], height: int = 16) -> Path:
    """Write frames 1, 2, ... that are rendered lobes."""
    folder.mkdir()
    for frame, scene in enumerate(scenes, 1):
        write_exr(folder / f"lamps.{frame}.exr", texels.texel_means(scene, height, 2 * height))
    return folder


def many_lamps(count: int, seed: int = 0, light: float = 10.0) -> Lobes:
    """Return narrow lamps in a dim sky, of all colours."""
    generator = torch.Generator().manual_seed(seed)
    places = [tuple(p) for p in torch.randn(count, 3, generator=generator).tolist()]
    scene = lamps([(0.0, 1.0, 0.0), *places], [1.0] + [400.0] * count, [0.3] + [light] * count)
    scene.amplitude[1:] *= 0.3 + torch.rand(count, 3, generator=generator)
    return scene


def moving(frames: int) -> list[Lobes]:
    """Return two frames and more of a lamp that another joins in the middle."""
    scenes = []
    for frame in range(frames):
        directions = [(0.0, 1.0, 0.1), (1.0, 0.2, 0.05 * frame), (-0.3, 0.2, -1.0)]
        light = [1.0, 8.0, 30.0 if frame >= frames // 2 else 0.0]
        scenes.append(lamps(directions, THREE[1], light))
    return scenes


@pytest.mark.parametrize("low", [1, 5])
@pytest.mark.parametrize("needed", [1, 2, 5, 6, 7, 11, 29, 30])
def test_the_search_finds_the_least_number(needed: int, low: int) -> None:
    tried: list[int] = []

    def error(count: int) -> float:
        tried.append(count)
        return 1 / count

    found = fewest(error, 5, low, 30, 1 / needed + 1e-9)
    assert found == max(needed, low)
    assert len(tried) == len(set(tried))
    assert len(tried) <= 8
    assert tried[0] == 5


def test_the_search_ends_at_the_most_lobes() -> None:
    assert fewest(lambda count: 1.0, 4, 1, 30, 0.5) == 30
    assert fewest(lambda count: 1.0, 4, 1, 4, 0.5) == 4


@pytest.mark.parametrize(
    ("count", "excess", "expected"),
    [(9, 1.01, 10), (9, 7.0, 10), (20, 1.04, 21), (20, 7.0, 22), (3, 7.0, 4), (28, 1.4, 30)],
)
def test_a_missed_tolerance_asks_for_more(count: int, excess: float, expected: int) -> None:
    assert more_lobes(count, excess, 30) == expected


def test_a_search_looks_at_the_ends_and_between() -> None:
    assert spread_frames((7,)) == [7]
    assert spread_frames((1, 2, 3)) == [1, 2, 3]
    assert spread_frames(tuple(range(1, 102))) == [1, 26, 51, 76, 101]


def test_a_map_of_three_lobes_comes_out_with_few(tmp_path: Path) -> None:
    source = write_lamps(tmp_path / "in", [lamps(*THREE)], height=64)
    tracks = fit_sequence(source, tolerance=0.02)
    assert tracks.lobes.count <= 3
    assert tracks.metadata["tolerance_met"] is True
    reference = open_sequence(source).read(1).radiance
    judged = frame_errors(tracks.lobes[0], reference).values
    for name in ("irr", "r0.5"):
        told = tracks.metadata["worst_errors"][name]
        assert told["frame"] == 1
        assert told["error"] == pytest.approx(judged[name], rel=0.05, abs=2e-4)
        assert judged[name] <= 0.02


def test_a_sky_takes_fewer_lobes_than_a_stage_full_of_lamps(tmp_path: Path) -> None:
    sky = write_lamps(tmp_path / "sky", [lamps([(0.2, 1.0, 0.0)], [0.8], [1.0])])
    stage = write_lamps(tmp_path / "stage", [many_lamps(9)])
    few, many = (
        fit_sequence(source, tolerance=0.02, preset="live").lobes.count for source in (sky, stage)
    )
    assert few <= 2
    assert many >= 5


def test_the_whole_shot_keeps_the_tolerance_of_the_judge(tmp_path: Path) -> None:
    source = write_lamps(tmp_path / "in", moving(3))
    events: list[Event] = []
    tracks = fit_sequence(source, tolerance=0.02, preset="live", on_progress=events.append)
    sequence = open_sequence(source)
    for frame in sequence.frames:
        judged = frame_errors(tracks.at(frame), sequence.read(frame).radiance).values
        assert max(judged["irr"], judged["r0.5"]) <= 0.02
    searched = [event for event in events if isinstance(event, Searched)]
    assert {event.frame for event in searched} == {1, 2, 3}
    assert isinstance(events[0], Started)


def test_a_frame_that_misses_is_told_and_the_shot_fitted_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rounds, "fewest_lobes", lambda *arguments: 1)
    source = write_lamps(tmp_path / "in", moving(3))
    events: list[Event] = []
    result = fit_shot(source, tmp_path / "a.usda", LIVE, on_progress=events.append)
    notices = [event.text for event in events if isinstance(event, Notice)]
    assert notices[0].startswith("tolerance 0.02: r0.5 is ")
    assert " in frame " in notices[0]
    assert notices[0].endswith(" with 1 lobe; fitting the shot again with 2")
    assert sum(isinstance(event, Started) for event in events) == 1 + len(notices)
    assert sum(isinstance(event, FrameDone) for event in events) == 3 * (1 + len(notices))
    assert result.tracks.metadata["tolerance_met"] is True
    # a shot has two tracks for each lobe
    assert 2 * result.tracks.metadata["lobes"] == result.records[0].lobes.count > 2


def test_a_tolerance_beyond_reach_ends_with_the_most_lobes(tmp_path: Path) -> None:
    source = write_lamps(tmp_path / "in", [many_lamps(9)])
    tracks = fit_sequence(source, tolerance=1e-4, max_lobes=3, preset="live")
    assert tracks.metadata["tolerance_met"] is False
    assert (tracks.metadata["lobes"], tracks.metadata["max_lobes"]) == (3, 3)
    assert tracks.metadata["worst_errors"]["r0.5"]["error"] > 1e-4


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the stage of a shot of which a round misses the tolerance."""
    source = write_lamps(tmp_path_factory.mktemp("images") / "in", moving(3))
    stage = tmp_path_factory.mktemp("unbroken") / "shot.usda"
    events: list[Event] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rounds, "fewest_lobes", lambda *arguments: 2)
        fit_shot(source, stage, LIVE, on_progress=events.append)
    assert sum(isinstance(event, FrameDone) for event in events) == 6  # two rounds
    return stage.read_bytes()


@pytest.mark.parametrize("stop", [1, 3, 5])
def test_a_resumed_shot_with_a_tolerance_is_the_unbroken_one(
    tmp_path: Path, unbroken: bytes, stop: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rounds, "fewest_lobes", lambda *arguments: 2)
    source = write_lamps(tmp_path / "in", moving(3))
    seen: list[FrameDone] = []

    def interrupt(event: Event) -> None:
        seen.extend([event] if isinstance(event, FrameDone) else [])
        if len(seen) == stop:
            raise KeyboardInterrupt

    output = tmp_path / "shot.usda"
    with pytest.raises(KeyboardInterrupt):
        fit_shot(source, output, LIVE, on_progress=interrupt)
    result = fit_shot(source, output, LIVE, resume=True)
    assert result.resumed == (stop - 3 if stop > 3 else 0)
    assert output.read_bytes() == unbroken


def test_on_resume_another_tolerance_is_refused_and_no_search_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, output = write_lamps(tmp_path / "in", moving(3)), tmp_path / "shot.usda"

    def interrupt(event: Event) -> None:
        if isinstance(event, FrameDone):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_shot(source, output, LIVE, on_progress=interrupt)
    other = FitOptions(tolerance=0.03, preset=Preset.LIVE)
    with pytest.raises(InputError, match=r"made with tolerance 0.02, this run has 0.03"):
        fit_shot(source, output, other, resume=True)
    monkeypatch.delattr(rounds, "fewest_lobes")
    assert fit_shot(source, output, LIVE, resume=True).resumed == 1


def test_simplifying_takes_no_frame_beyond_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    def dimmed(found: Lobes, budget: torch.Tensor, *_: object) -> Lobes:
        """Change each frame by its budget, for the worse."""
        return replace(found, amplitude=found.amplitude * (1 - budget.float())[:, None, None])

    monkeypatch.setattr(leaving_out, "leave_out", dimmed)
    scene, accuracy = lamps(*THREE), Accuracy(0.02)
    reference = texels.texel_means(scene, 64, 128)
    levels = (1.0, 1.019, 1.01980, 1.5)  # exact, near the tolerance, at it, beyond it
    for frame, level in enumerate(levels):
        accuracy.see(frame, level * reference)
    shot = stack([scene] * len(levels))
    frames = list(range(len(levels)))
    before = [max(one.values()) for one in accuracy.errors(frames, shot)]
    found, budget = leaving_out.simplified(shot, frames, accuracy)
    after = [max(one.values()) for one in accuracy.errors(frames, found)]
    assert budget == pytest.approx(0.002)
    assert after[0] > 0.0018
    assert before[1] < after[1] <= accuracy.limit
    assert before[2] <= after[2] <= accuracy.limit
    assert after[3] > before[3] > 0.02
