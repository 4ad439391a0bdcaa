# SPDX-License-Identifier: Apache-2.0
import pytest
import shot_files
import torch

from asglight.lobes.growing import GrowingTracks


def test_tracks_hold_the_frames_so_far_and_stay_as_they_were() -> None:
    growing = GrowingTracks((5, 6, 8), 25.0, {"preset": "live"})
    assert growing.tracks() is None
    given = []
    for seed in (1, 2, 3):
        growing.append(shot_files.lobes(seed))
        given.append(growing.tracks())
    for count, tracks in enumerate(given, 1):
        assert tracks is not None
        assert tracks.frames == (5, 6, 8)[:count]
        assert (tracks.fps, tracks.metadata) == (25.0, {"preset": "live"})
        for k in range(count):
            expected = shot_files.lobes(k + 1)
            assert torch.equal(tracks.lobes.axes[k], expected.axes)
            assert torch.equal(tracks.lobes.sharpness[k], expected.sharpness)
            assert torch.equal(tracks.lobes.amplitude[k], expected.amplitude)


def test_more_frames_than_there_are_do_not_fit() -> None:
    growing = GrowingTracks((5,), 25.0, {})
    growing.append(shot_files.lobes())
    with pytest.raises(IndexError):
        growing.append(shot_files.lobes())


def test_another_number_of_lobes_does_not_fit() -> None:
    growing = GrowingTracks((5, 6), 25.0, {})
    growing.append(shot_files.lobes(count=2))
    with pytest.raises(RuntimeError):
        growing.append(shot_files.lobes(count=3))
