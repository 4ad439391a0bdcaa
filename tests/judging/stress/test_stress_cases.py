# SPDX-License-Identifier: Apache-2.0
"""The stress cases are well formed, and hold what they say."""

import re

import pytest
import torch

from asglight.errors import InputError
from asglight.judging.stress import maps
from asglight.judging.stress.case import FLUX, GRADIENT, IRRADIANCE, Case, Group
from asglight.judging.stress.cases import CASES, chosen

HOLDS_MAX = 48
"""Characters of a cell of the table that still leave room for eight numbers beside it."""

LARGE = ("4096x8192", "1024x2048")
"""Gigabytes and seconds, which a run takes and a test does not."""


def named(place: str) -> Case:
    (case,) = chosen([place])
    return case


def test_there_are_cases_of_every_group_and_enough_of_them() -> None:
    assert len(CASES) >= 60
    assert {case.group for case in CASES} == set(Group)


def test_names_are_unique_and_can_be_typed() -> None:
    places = [(case.group, case.name) for case in CASES]
    assert len(set(places)) == len(places)
    assert all(re.fullmatch(r"[a-z0-9.+-]+", case.name) for case in CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.group}/{case.name}")
def test_a_case_says_what_it_holds_and_why_it_may_be_worse(case: Case) -> None:
    assert 0 < len(case.holds) <= HOLDS_MAX
    pairs = ((case.flux, FLUX), (case.irradiance, IRRADIANCE), (case.gradient, GRADIENT))
    for bound, common in pairs:
        assert (bound.value > common.value) is bool(bound.reason)
        assert not bound.reason or bound.reason.endswith(".")
    assert (case.recovery is not None) is (case.group is Group.RECOVERY)
    assert case.refused is None or case.group is Group.BROKEN


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.name not in LARGE], ids=lambda case: case.name
)
def test_frames_are_maps_and_known_lobes_are_as_many(case: Case) -> None:
    frames = case.frames()
    for frame in frames:
        height, width, channels = frame.shape
        assert frame.dtype == torch.float32
        assert channels == 3
        assert case.refused is not None or width == 2 * height
    if case.known is not None:
        known = case.known()
        assert len(known) == len(frames)
        assert all(lobes.form is case.form for lobes in known)
        if case.recovery is not None:
            assert {lobes.count for lobes in known} == {case.lobes}


def test_shots_do_what_they_say() -> None:
    frozen = named("time/frozen").frames()
    assert all(torch.equal(frame, frozen[0]) for frame in frozen)
    up = named("time/stops-up").frames()
    assert float(up[2].sum() / up[1].sum()) == pytest.approx(2**20 / 1.01, rel=1e-5)
    before, after = (named("time/turn-180").frames()[k] for k in (1, 2))
    assert torch.equal(torch.roll(before, maps.ROWS, 1), after)
    assert not named("time/black-between").frames()[1].any()
    lamp = named("time/flash").frames()
    lit = [int((frame - lamp[0] * 1.01 > 1).sum()) for frame in lamp]
    assert lit == [0, 0, 3, 0, 0]


def test_rectangles_lie_where_they_should() -> None:
    rows = maps.ROWS
    lit = maps.rectangle((0, 90), (-180, 0)).any(-1)
    assert bool(lit[: rows // 2, rows:].all())  # above the horizon, right of the middle
    assert int(lit.sum()) == rows * rows // 2


def test_groups_and_cases_are_chosen_in_the_order_of_the_table() -> None:
    assert chosen([]) == CASES
    time = chosen(["time"])
    assert {case.group for case in time} == {Group.TIME}
    some = chosen(["time/cut", "stiff/pole", "time/cut"])
    assert [case.name for case in some] == ["pole", "cut"]


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("speed", r"^only: 'speed'; expected a group: stiff, radiance, .*recovery\.$"),
        ("time/cat", r"^only: no case 'time/cat'; expected time/ and one of flash, cut, .*\.$"),
    ],
)
def test_an_unknown_name_is_refused_with_those_there_are(word: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        chosen(["time", word])
