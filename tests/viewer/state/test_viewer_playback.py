# SPDX-License-Identifier: Apache-2.0
"""The playhead, with times that the tests make up."""

import pytest

from asglight.viewer.state.time.playback import Pace, Playback

FPS = 24.0


def playback(frames: range | list[int] = range(1001, 1011)) -> Playback:
    return Playback(list(frames), FPS)


def shown(head: Playback, times: list[float]) -> list[int]:
    """Return the frame at each time, in frame times after the start."""
    frames = []
    for time in times:
        head.tick(100.0 + time / FPS)
        frames.append(head.frame)
    return frames


@pytest.mark.parametrize(
    ("wanted", "found"),
    [(1001, 1001), (1002, 1002), (1003, 1002), (1004, 1004), (0, 1001), (5000, 1004)],
)
def test_going_to_a_frame_shows_the_nearest_there_is(wanted: int, found: int) -> None:
    head = playback([1001, 1002, 1004])
    head.go_to(wanted)
    assert head.frame == found


def test_steps_skip_the_gap_and_stop_at_the_ends() -> None:
    head = playback([1001, 1002, 1004])
    seen = []
    for step in (-1, 1, 1, 1, -1, -5):
        head.step(step)
        seen.append(head.frame)
    assert seen == [1001, 1002, 1004, 1004, 1002, 1001]


def test_real_time_drops_frames_and_keeps_the_time() -> None:
    head = playback()
    head.play(100.0)
    assert shown(head, [0, 0.9, 1, 4.5, 8.999, 9]) == [1001, 1001, 1002, 1005, 1009, 1010]


def test_real_time_loops_after_the_length_of_the_range() -> None:
    head = playback()
    head.play(100.0)
    assert shown(head, [9.5, 10, 12, 25]) == [1010, 1001, 1003, 1006]
    assert head.is_playing


def test_every_frame_misses_none_however_late_the_pictures() -> None:
    head = playback()
    head.pace = Pace.EVERY_FRAME
    head.play(100.0)
    assert shown(head, [0, 3, 6, 9, 9.5, 10]) == [1001, 1002, 1003, 1004, 1004, 1005]


def test_every_frame_keeps_the_rate_on_a_screen_of_60_hertz() -> None:
    head = playback(range(1, 101))
    head.pace = Pace.EVERY_FRAME
    head.play(100.0)
    pictures = [tick * FPS / 60 for tick in range(121)]  # two seconds
    assert shown(head, pictures)[-1] == 1 + 2 * FPS


def test_without_loop_playing_ends_on_the_last_frame() -> None:
    for pace in Pace:
        head = playback()
        head.pace, head.loops = pace, False
        head.play(100.0)
        assert shown(head, [float(t) for t in range(1, 12)])[-1] == 1010
        assert not head.is_playing


def test_gaps_are_held_on_the_frame_before_them() -> None:
    for pace in Pace:
        head = playback([1, 2, 5, 6])
        head.pace = pace
        head.play(100.0)
        assert shown(head, [0, 1, 2, 3, 4, 5, 6]) == [1, 2, 2, 2, 5, 6, 1], pace


def test_marks_bound_what_plays_but_not_what_is_looked_at() -> None:
    head = playback()
    head.go_to(1004)
    head.mark_in()
    head.go_to(1006)
    head.mark_out()
    head.go_to(1009)
    assert head.frame == 1009
    head.play(100.0)
    assert shown(head, [0, 1, 2, 3]) == [1004, 1005, 1006, 1004]
    head.clear_marks()
    assert (head.first, head.last) == (0, 9)


def test_a_mark_beyond_the_other_takes_it_along() -> None:
    head = playback()
    head.go_to(1003)
    head.mark_out()
    head.go_to(1007)
    head.mark_in()
    assert (head.frames[head.first], head.frames[head.last]) == (1007, 1007)
    head.go_to(1002)
    head.mark_out()
    assert (head.frames[head.first], head.frames[head.last]) == (1002, 1002)


def test_scrubbing_while_playing_plays_on_from_there() -> None:
    head = playback()
    head.play(100.0)
    assert shown(head, [2.0]) == [1003]
    head.go_to(1008)
    assert shown(head, [2.5, 3.0, 4.0]) == [1008, 1009, 1010]


@pytest.mark.parametrize("pace", list(Pace))
def test_marks_that_are_set_while_playing_leave_the_playhead_where_it_is(pace: Pace) -> None:
    head = playback()
    head.pace = pace
    head.play(100.0)
    every = [float(time) for time in range(25)]  # in the third turn
    assert shown(head, every)[-1] == 1005
    head.mark_out()
    assert shown(head, [24.5, 25, 26]) == [1005, 1001, 1002]
    head.mark_in()
    assert shown(head, [26.5, 27, 28, 29]) == [1002, 1003, 1004, 1005]
    head.clear_marks()
    assert shown(head, [29.5, 30, 31]) == [1005, 1006, 1007]


@pytest.mark.parametrize("pace", list(Pace))
@pytest.mark.parametrize("outside", [1002, 1009])
def test_a_frame_outside_the_marks_is_followed_by_the_in_point(pace: Pace, outside: int) -> None:
    head = playback()
    head.pace = pace
    head.go_to(1005)
    head.mark_in()
    head.go_to(1007)
    head.mark_out()
    head.play(100.0)
    assert shown(head, [0.5]) == [1005]
    head.go_to(outside)
    assert shown(head, [0.6, 1.5, 2.5, 3.5, 4.5]) == [outside, 1005, 1006, 1007, 1005]
    assert head.dropped == 0


def test_a_frame_before_the_in_point_does_not_end_what_plays_once() -> None:
    head = playback()
    head.go_to(1005)
    head.mark_in()
    head.loops = False
    head.play(100.0)
    head.go_to(1001)
    assert shown(head, [0.5, 1, 2]) == [1001, 1005, 1006]
    assert head.is_playing


def test_stepping_pauses() -> None:
    head = playback()
    head.play(100.0)
    head.step(1)
    assert shown(head, [5.0]) == [1002]
    assert not head.is_playing


def test_play_at_the_end_starts_again() -> None:
    head = playback()
    head.go_to(1010)
    head.play(100.0)
    assert head.frame == 1001


@pytest.mark.parametrize("pace", list(Pace))
@pytest.mark.parametrize("since", [0.0, 0.4, 1.7, 6.2])
def test_the_shown_frame_stays_as_long_as_it_says_and_no_longer(pace: Pace, since: float) -> None:
    head = playback([1001, 1002, 1004, 1005, 1009])
    head.pace = pace
    head.play(100.0)
    now = 100.0 + since / FPS
    head.tick(now)
    before, stays = head.frame, 0.0
    while head.frame == before:  # a frame that is missing is waited for in several turns
        each = head.seconds_to_next(now + stays)
        assert each is not None
        head.tick(now + stays + 0.99 * each)
        assert head.frame == before
        stays += each
        head.tick(now + stays)
    assert head.frame == head.frames[head.frames.index(before) + 1]


@pytest.mark.parametrize("took", [1.0, 1.5, 3.2])
def test_a_picture_that_took_longer_than_a_frame_is_followed_at_once(took: float) -> None:
    """Else one of 1.5 frames would wait for the end of the second, and 24 a second become 12."""
    head = playback()
    head.play(100.0)
    head.tick(100.0 + 2.1 / FPS)
    assert head.seconds_to_next(100.0 + (2.1 + took) / FPS) == 0.0


def test_a_shot_that_rests_waits_for_nothing() -> None:
    assert playback().seconds_to_next(100.0) is None
