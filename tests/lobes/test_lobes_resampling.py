# SPDX-License-Identifier: Apache-2.0
"""Tracks at another rate: which old time each new frame shows, in exact fractions."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from lobe_samples import random_lobes
from usd_tracks import moving

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg, motion
from asglight.lobes.data import stack
from asglight.lobes.resampling import resampled

SHOT = moving(range(1001, 1025))


def assert_equal(found: Lobes, wanted: Lobes) -> None:
    for name in ("axes", "sharpness", "amplitude"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-12, err_msg=name
        )


@pytest.mark.parametrize(
    ("fps", "speed", "count"),
    [(60.0, 1.0, 60), (24.0, 0.5, 48), (25.0, 1.0, 25), (24.0, 3.0, 8), (60.0, 0.75, 80)],
)
def test_a_new_frame_is_the_light_of_its_old_time(fps: float, speed: float, count: int) -> None:
    found = resampled(SHOT, fps, speed)
    assert (found.fps, found.names, found.metadata) == (fps, SHOT.names, SHOT.metadata)
    assert found.frames == tuple(range(1001, 1001 + count))
    step = 24 / Fraction(fps) * Fraction(speed)
    times = [float(1001 + place * step) for place in range(count)]
    assert_equal(found.lobes, motion.at(SHOT, times))
    length = Fraction(count) / Fraction(fps)
    assert abs(length - Fraction(len(SHOT.frames), 24) / Fraction(speed)) <= 1 / Fraction(fps)


def test_old_frames_that_new_ones_meet_are_met_exactly() -> None:
    found = resampled(SHOT, 24 * 7.0)  # a seventh is no binary fraction
    for place, frame in enumerate(SHOT.frames):
        assert np.array_equal(found.lobes.amplitude[7 * place], SHOT.at(frame).amplitude)


def test_half_the_speed_has_the_old_frames_at_every_second_one() -> None:
    found = resampled(SHOT, speed=0.5)
    assert found.fps == SHOT.fps
    assert_equal(found.lobes[::2], motion.exact(SHOT.lobes))
    middle = asg.flux(found.lobes[1:-1:2])
    ends = asg.flux(motion.exact(SHOT.lobes))
    np.testing.assert_allclose(middle, (ends[1:] + ends[:-1]) / 2, rtol=1e-9)  # flux is linear


@pytest.mark.parametrize("fps", [48.0, 60.0, 24000 / 1001 * 5])
def test_there_and_back_is_the_same_shot(fps: float) -> None:
    shot = replace(SHOT, fps=24000 / 1001) if fps > 100 else SHOT
    there = resampled(shot, fps)
    back = resampled(there, shot.fps)
    assert (back.frames, back.names, back.fps) == (shot.frames, shot.names, shot.fps)
    # 60 frames a second meet every second old one, and give the others by what lies beside them
    every = slice(None, None, 2) if fps == 60 else slice(None)
    assert_equal(back.lobes[every], motion.exact(shot.lobes[every]))


def test_some_frames_keep_the_number_of_the_first_and_end_before_the_next() -> None:
    found = resampled(SHOT, speed=0.25, frames=(1010, 1011))
    assert found.frames == tuple(range(1010, 1018))
    times = [1010, 1010.25, 1010.5, 1010.75, 1011, 1011.25, 1011.5, 1011.75]
    assert_equal(found.lobes, motion.at(SHOT, times))


def test_frames_further_apart_are_resampled_by_their_numbers() -> None:
    lobes = [random_lobes(2, Form.ASG, seed=7) for _ in range(3)]
    for index, scale in enumerate([1.0, 3.0, 4.0]):
        lobes[index].amplitude.mul_(scale)
    shot = LobeTracks((1, 5, 6), 24.0, stack(lobes))
    found = resampled(shot, 24.0, 1.0)
    assert found.frames == (1, 2, 3, 4, 5, 6)
    scales = found.lobes.amplitude / lobes[0].amplitude
    wanted = np.array([1, 1.5, 2, 2.5, 3, 4])[:, None, None]
    np.testing.assert_allclose(scales, np.broadcast_to(wanted, scales.shape), rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fps": 0.0}, "fps: 0; expected a finite number above 0"),
        ({"fps": float("inf")}, "fps: inf; expected a finite"),
        ({"speed": -1.0}, "speed: -1; expected a finite number above 0"),
        ({"speed": float("nan")}, "speed: nan; expected a finite"),
        ({"frames": (1000, 1010)}, "frames: 1000 to 1010; expected .* within 1001 to 1024"),
        ({"frames": (1010, 1009)}, "frames: 1010 to 1009; expected a first and a last"),
        ({"fps": 1.0}, "frames: 1001 to 1024 become one at 24 a new frame; expected two"),
        ({"fps": 1e9}, "frames: 1001 to 1024 become 1e\\+09 at .* expected at most 1,000,000"),
    ],
)
def test_what_is_no_rate_or_range_is_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        resampled(SHOT, **options)
