# SPDX-License-Identifier: Apache-2.0
"""The follower: a frame in, its lobes out, and nothing waits for a later one."""

import itertools

import numpy as np
import pytest
import sky_files
import torch

import asglight
from asglight.errors import InputError
from asglight.lobes import asg
from asglight.shots.live import live_fits

FRAMES = range(1001, 1007)


def sky(frame: int) -> np.ndarray:
    return sky_files.sky(1003 if frame == 1004 else frame, 16)


def test_each_frame_is_the_live_fit_of_the_frames_so_far() -> None:
    """A fit of a shot that ends here is the same: what comes later changes nothing."""
    follower = asglight.Follower(3)
    for count, frame in enumerate(FRAMES, 1):
        found = follower.follow(sky(frame))
        fits = live_fits(lambda one: torch.from_numpy(sky(one)), [*FRAMES][: count + 1], 3)
        wanted = [lobes for _, lobes in fits][count - 1]
        assert torch.equal(found.amplitude, wanted.amplitude)
        towards = torch.nn.functional.normalize(torch.randn(20, 3), dim=-1)
        torch.testing.assert_close(asg.evaluate(found, towards), asg.evaluate(wanted, towards))
        assert follower.frames == count


def test_tracks_keep_their_number_and_names_and_axes_turn_on() -> None:
    follower = asglight.Follower(3)
    found = [follower.follow(sky(frame)) for frame in FRAMES]
    assert follower.names == tuple(f"lobe_{place:02d}" for place in range(6))
    for before, after in itertools.pairwise(found):
        lit = (before.amplitude > 0).any(-1) & (after.amplitude > 0).any(-1)
        assert 0 < int((after.amplitude > 0).any(-1).sum()) <= 3
        # the nearest of the equal frames: never a quarter turn about its own axis
        along = (before.axes[lit] * after.axes[lit]).sum(-1)
        still = along[:, 2] > 0.99
        assert bool((along[still, :2] > 0.7).all())


def test_a_bad_frame_is_refused_and_the_next_one_taken() -> None:
    follower = asglight.Follower(2)
    first = follower.follow(sky(1001))
    with pytest.raises(InputError, match="frame 1: holds nothing but NaN"):
        follower.follow(np.full((16, 32, 3), np.nan, np.float32))
    assert follower.lobes is first
    assert follower.frames == 1
    follower.follow(sky(1002))
    assert follower.frames == 2
    other = asglight.Follower(2)
    other.follow(sky(1001))
    assert torch.equal(other.follow(sky(1002)).amplitude, follower.lobes.amplitude)


def test_it_says_how_far_it_is() -> None:
    follower = asglight.Follower(2)
    assert repr(follower) == "<Follower: 0 frames, 0 of 0 tracks lit>"
    follower.follow(torch.from_numpy(sky(1001)))
    assert repr(follower) == "<Follower: 1 frames, 2 of 4 tracks lit>"


def test_frames_come_one_at_a_time() -> None:
    follower = asglight.Follower(2)
    with pytest.raises(InputError, match=r"frame 0: 2 frames; expected one at a time, \[H, 2 H, 3"):
        follower.follow(np.stack([sky(1001), sky(1002)]))
    follower.follow(sky(1001)[None])
    assert follower.frames == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lobes": 0}, "lobes: 0"),
        ({"device": "tpu"}, "device: tpu"),
        ({"repair": -1}, "repair: -1"),
    ],
)
def test_a_setting_that_is_none_is_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        asglight.Follower(**options)
