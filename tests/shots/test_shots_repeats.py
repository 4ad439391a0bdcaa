# SPDX-License-Identifier: Apache-2.0
"""Frames that repeat the one before: fitted once, and nothing after them goes astray."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shot_files
import sky_files
import torch

import asglight
from asglight import read_usd
from asglight.fitting import sequence as fitting
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.lobes import LobeTracks
from asglight.shots import fit_sequence, fit_shot
from asglight.shots.events import Event, FrameDone, Refined
from asglight.sphere import latlong

OPTIONS = {
    Preset.LIVE: replace(shot_files.OPTIONS, preset=Preset.LIVE),
    Preset.FAST: shot_files.OPTIONS,
}


def write_shown(folder: Path, shown: list[int]) -> Path:
    """Write frames 1, 2, ... that show the sky of the frames given."""
    folder.mkdir()
    for frame, sky in enumerate(shown, 1):
        sky_files.write_frame(folder / f"sky.{frame:04d}.exr", sky_files.sky(sky))
    return folder


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[torch.Tensor]:
    """Count what is fitted."""
    fitted: list[torch.Tensor] = []

    def counting(reference: torch.Tensor, *args: object) -> object:
        fitted.append(reference)
        return fit_frame(reference, *args)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(fitting, "fit_frame", counting)
    return fitted


def assert_same(found: LobeTracks, places: list[int], expected: LobeTracks) -> None:
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(found.lobes, name)[places], getattr(expected.lobes, name))


@pytest.mark.parametrize("preset", list(OPTIONS))
def test_a_repeat_changes_no_other_frame(
    preset: Preset, tmp_path: Path, calls: list[torch.Tensor]
) -> None:
    plain = write_shown(tmp_path / "plain", [1, 2, 3, 5])
    held = write_shown(tmp_path / "held", [1, 2, 2, 2, 3, 5, 5])
    expected = fit_shot(plain, tmp_path / "plain.usda", OPTIONS[preset])
    assert len(calls) == 4
    found = fit_shot(held, tmp_path / "held.usda", OPTIONS[preset])
    assert len(calls) == 4 + 6  # each that follows another is tried once more
    assert_same(found.tracks, [0, 1, 4, 5], expected.tracks)
    assert_same(found.tracks, [0, 2, 4, 6], expected.tracks)
    assert [record.repeats for record in found.records] == [None, None, 2, 2, None, None, 6]
    assert found.tracks.metadata["left_out"]["repeated_frames"] == [3, 4, 7]
    losses = found.tracks.metadata["loss"]
    assert [losses[k] for k in (0, 1, 4, 5)] == expected.tracks.metadata["loss"]


def row_of_lamps(count: int) -> np.ndarray:
    """Return lamps in a row, 3 degrees wide (sigma), 40 degrees apart.  [32, 64, 3]."""
    away = latlong.directions(32, 64).numpy()
    azimuth, elevation = np.radians(40 * np.arange(count)), np.radians(20)
    across = np.cos(elevation)
    lamps = np.stack(
        [
            across * np.sin(azimuth),
            np.full(count, np.sin(elevation)),
            across * np.cos(azimuth),
        ],
        -1,
    )
    shown = 20 * np.exp(300 * (away @ lamps.T - 1)).sum(-1)
    return np.repeat(0.1 + shown[..., None], 3, -1).astype(np.float32)


def test_a_frame_that_is_held_is_followed_on_to_better_lobes() -> None:
    """Two lamps are switched on at once, and one frame of `live` does not come to both."""
    shown = [row_of_lamps(count) for count in (1, 3, 3, 3, 3, 3, 3)]
    metadata = asglight.fit(np.stack(shown), lobes=12, preset="live").metadata
    repeated, losses = metadata["left_out"]["repeated_frames"], metadata["loss"]
    own = [frame for frame in range(2, 8) if frame not in repeated]
    assert 2 <= len(own) <= 5
    assert own == list(range(2, 2 + len(own)))
    assert losses[-1] < losses[1] / 2
    for frame in repeated:
        assert losses[frame - 1] == losses[frame - 2]


def test_a_still_shot_is_one_fit_and_static(tmp_path: Path, calls: list[torch.Tensor]) -> None:
    from pxr import Usd

    source, stage = write_shown(tmp_path / "still", [4] * 5), tmp_path / "still.usda"
    result = fit_shot(source, stage, shot_files.OPTIONS)
    assert len(calls) == 1
    assert result.tracks.metadata["left_out"]["static"] == 2
    opened = Usd.Stage.Open(str(stage))
    attributes = [a for prim in opened.TraverseAll() for a in prim.GetAttributes()]
    assert len(attributes) > 10
    assert not [a.GetName() for a in attributes if a.GetNumTimeSamples()]
    images = sorted(path.name for path in (tmp_path / "still_dome").iterdir())
    assert images == ["still.fill.0001.exr"]
    assert read_usd(stage).lobes.axes.shape[:2] == (5, 2)


def test_the_refinement_counts_a_repeat_once(tmp_path: Path) -> None:
    source = write_shown(tmp_path / "held", [1, 1, 2, 2, 3, 3])
    events: list[Event] = []
    fit_shot(source, tmp_path / "a.usda", shot_files.OPTIONS, on_progress=events.append)
    assert [event for event in events if isinstance(event, Refined)] == [Refined(3, 3)]
    done = [event for event in events if isinstance(event, FrameDone)]
    assert [event.repeats for event in done] == [None, 1, None, 3, None, 5]
    assert [event.position for event in done] == [1, 2, 3, 4, 5, 6]


HELD = [1, 2, 2, 2, 13, 13]
"""The lamp jumps once, where the frame is fitted from the start."""


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the stage of a shot with repeats."""
    source = write_shown(tmp_path_factory.mktemp("images") / "held", HELD)
    stage = tmp_path_factory.mktemp("unbroken") / "shot.usda"
    fit_shot(source, stage, shot_files.OPTIONS)
    return stage.read_bytes()


@pytest.mark.parametrize("stop", [2, 3, 4])
def test_a_shot_resumed_at_a_repeat_is_the_unbroken_one(
    tmp_path: Path, unbroken: bytes, stop: int
) -> None:
    """The next frame is a repeat, a repeat of a repeat, and one after repeats."""
    source = write_shown(tmp_path / "held", HELD)
    seen: list[FrameDone] = []

    def interrupt(event: Event) -> None:
        seen.extend([event] if isinstance(event, FrameDone) else [])
        if len(seen) == stop:
            raise KeyboardInterrupt

    output = tmp_path / "shot.usda"
    with pytest.raises(KeyboardInterrupt):
        fit_shot(source, output, shot_files.OPTIONS, on_progress=interrupt)
    result = fit_shot(source, output, shot_files.OPTIONS, resume=True)
    assert result.resumed == stop
    assert [record.repeats for record in result.records] == [None, None, 2, 2, None, 5]
    assert output.read_bytes() == unbroken


def test_a_frame_held_for_a_missing_one_is_a_repeat(
    tmp_path: Path, calls: list[torch.Tensor]
) -> None:
    source = write_shown(tmp_path / "in", [1, 2, 3, 4])
    (source / "sky.0003.exr").unlink()
    tracks = fit_sequence(source, lobes=2, missing="hold")
    assert len(calls) == 4  # the held one was followed on, to nothing better
    assert tracks.metadata["left_out"]["repeated_frames"] == [3]
    assert tracks.metadata["repairs"]["frames_filled"] == [3]


def test_a_scene_that_comes_back_later_is_fitted_again(
    tmp_path: Path, calls: list[torch.Tensor]
) -> None:
    fit_sequence(write_shown(tmp_path / "in", [1, 2, 1]), lobes=2)
    assert len(calls) == 3


def test_the_paper_preset_fits_every_frame_and_leaves_out_nothing(
    tmp_path: Path, calls: list[torch.Tensor]
) -> None:
    options = FitOptions(lobes=2, preset=Preset.PAPER, paper_steps=(3, 2))
    result = fit_shot(write_shown(tmp_path / "in", [1, 1]), tmp_path / "a.usda", options)
    assert len(calls) == 2
    assert result.tracks.metadata["left_out"] == {
        "budget": None,
        "black": 0,
        "unneeded": 0,
        "one_sharpness": 0,
        "static": 0,
        "repeated_frames": [],
        "lights": 2,
        "lit_at_once": 2,
    }
