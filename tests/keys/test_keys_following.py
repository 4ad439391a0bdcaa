# SPDX-License-Identifier: Apache-2.0
"""Lamps over a shot: identity, gaps, fades, and which of them are keys."""

import numpy as np
import pytest

from asglight.keys.following import FADE, GAP, SHADOW, Sighting, keys, linked, weight


def lamp(
    longitude: float, share: float = 0.3, figure: float = 1.0, shadow: float = 0.0
) -> Sighting:
    turn = np.radians(longitude)
    direction = np.array([np.sin(turn), 0.0, np.cos(turn)])
    return Sighting(np.array([1]), direction, 0.02, share, shadow, 8.0, figure)


def test_two_lamps_that_pass_each_other_stay_two() -> None:
    frames = [[lamp(-20 + 4 * k, 0.3), lamp(20 - 4 * k, 0.1)] for k in range(11)]
    tracks = linked(frames)
    assert len(tracks) == 2
    for track, step in zip(sorted(tracks, key=lambda one: -one.light), (4, -4), strict=True):
        assert len(track.seen) == 11
        ends = [np.degrees(np.arctan2(*track.seen[k].direction[[0, 2]])) for k in (0, 10)]
        assert ends[1] - ends[0] == pytest.approx(10 * step)


def test_a_lamp_that_goes_does_not_take_over_its_neighbour() -> None:
    # a spot beside a tube goes, and a small lamp appears on the tube's other side
    tube, spot, small = lamp(0, 0.03), lamp(7, 0.01), lamp(-8, 0.004)
    frames = [[tube, spot]] * 5 + [[tube]] * 2 + [[tube, small]] * 5
    tracks = linked(frames)
    [whole] = [track for track in tracks if track.seen[track.first] is tube]
    assert all(one is tube for one in whole.seen.values())
    assert len(whole.seen) == 12


def test_a_lamp_behind_a_pillar_is_the_same_key_and_is_looked_for_where_it_should_be() -> None:
    frames = [[lamp(2 * k)] if not 5 <= k < 5 + GAP - 2 else [] for k in range(20)]
    [track] = linked(frames)
    direction, texels, _ = track.at(7)
    assert texels is None
    assert np.degrees(np.arctan2(direction[0], direction[2])) == pytest.approx(14, abs=0.1)
    assert weight(track, 7, 20) == 1


def test_a_lamp_that_stays_away_comes_back_as_another() -> None:
    frames = [[lamp(0)] if k < 3 or k > 3 + GAP else [] for k in range(20)]
    assert len(linked(frames)) == 2


def test_a_key_that_comes_and_goes_fades_and_never_pops() -> None:
    frames = [[lamp(0)] if 6 <= k < 26 else [] for k in range(32)]
    [track] = keys(frames)
    weights = np.array([weight(track, k, 32) for k in range(32)])
    assert weights[:6].max() == weights[26:].max() == 0
    assert weights[6 + FADE : 26 - FADE].min() == 1
    assert np.abs(np.diff(weights)).max() < 0.5
    assert (np.diff(weights[5:12]) >= 0).all()


def test_a_key_that_is_there_at_the_ends_of_a_shot_does_not_fade_there() -> None:
    [track] = keys([[lamp(0)]] * 10)
    assert {weight(track, k, 10) for k in range(10)} == {1.0}


def test_keys_are_as_few_as_carry_most_of_the_light_of_lamps() -> None:
    one = [lamp(0, 0.5), lamp(60, 0.05), lamp(120, 0.04)]
    assert len(keys([one])) == 1
    even = [lamp(60 * k, 0.06) for k in range(6)]
    assert len(keys([even])) == 4
    assert len(keys([even], 3)) == 3


def test_a_lamp_whose_shadow_is_plainly_seen_is_a_key_at_any_rate() -> None:
    strong = lamp(0, 0.7)
    assert len(keys([[strong, lamp(90, 0.05, shadow=SHADOW + 0.01)]])) == 2
    assert len(keys([[strong, lamp(90, 0.2, shadow=SHADOW - 0.01)]])) == 1


def test_what_has_little_light_or_no_outline_is_no_key() -> None:
    assert keys([[lamp(0, 0.005)]]) == []
    assert keys([[lamp(0, 0.3, figure=0.5)]]) == []
    assert keys([[]]) == []


def test_a_flash_of_a_frame_is_no_key() -> None:
    frames = [[lamp(0), *([lamp(90)] if k == 4 else [])] for k in range(10)]
    assert len(keys(frames)) == 2  # it was a key as long as it lived
    frames = [[lamp(0, 0.3), lamp(90, 0.6 if k == 4 else 0.01)] for k in range(10)]
    assert len(keys(frames)) == 1
