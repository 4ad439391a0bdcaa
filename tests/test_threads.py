# SPDX-License-Identifier: Apache-2.0
"""Two threads where cores are idle, one beside a busy program, none above what was allowed."""

import itertools
from collections.abc import Iterator

import pytest
import torch

from asglight import threads
from asglight.threads import Team, one_thread


@pytest.fixture(autouse=True)
def allowed() -> Iterator[None]:
    """Allow four threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    assert torch.get_num_threads() == 4
    torch.set_num_threads(before)


class Clock:
    """Wall and CPU seconds of turns of a second in which threads got so much of it."""

    def __init__(self) -> None:
        self.wall = self.cpu = 0.0

    def __call__(self) -> tuple[float, float]:
        return self.wall, self.cpu

    def run(self, share: float) -> int:
        """Let a second pass; return the threads that computed."""
        self.wall += 1.0
        self.cpu += share * torch.get_num_threads()
        return torch.get_num_threads()


def _turns(team: Team, clock: Clock, shares: list[float]) -> list[int]:
    found = []
    for share in shares:
        with team.turn():
            found.append(clock.run(share))
    return found


def test_one_thread_is_one_and_gives_back_what_was() -> None:
    with one_thread():
        assert torch.get_num_threads() == 1
    with pytest.raises(KeyError), one_thread():
        raise KeyError


def test_a_team_is_two_while_cores_are_idle() -> None:
    clock = Clock()
    assert _turns(Team(clock), clock, [0.95] * 5) == [2] * 5


def test_beside_a_busy_program_one_goes_on_alone_twice_as_long_each_time() -> None:
    clock = Clock()
    found = _turns(Team(clock), clock, [0.75] * 400)
    asked = [turn for turn, count in enumerate(found) if count == 2]
    assert asked == [0, 5, 14, 31, 64, 129, 258]


def test_it_rests_for_256_turns_at_most() -> None:
    clock = Clock()
    found = _turns(Team(clock), clock, [0.5] * 1500)
    asked = [turn for turn, count in enumerate(found) if count == 2]
    assert max(b - a for a, b in itertools.pairwise(asked)) == 257


def test_after_the_program_ended_it_is_two_again_and_the_next_rest_is_short() -> None:
    clock = Clock()
    team = Team(clock)
    assert _turns(team, clock, [0.75] * 14) == [2, 1, 1, 1, 1, 2] + [1] * 8
    assert _turns(team, clock, [0.95] * 3) == [2] * 3
    assert _turns(team, clock, [0.75] * 6) == [2, 1, 1, 1, 1, 2]


def test_a_team_has_no_more_threads_than_its_caller() -> None:
    clock = Clock()
    team = Team(clock)
    with one_thread():
        assert _turns(team, clock, [0.5] * 3) == [1] * 3
    assert _turns(team, clock, [0.95]) == [2]  # one alone tells nothing of other programs


def test_a_turn_that_fails_gives_back_the_threads() -> None:
    with pytest.raises(KeyError), Team().turn():
        raise KeyError
    assert torch.get_num_threads() == 4


def test_seconds_of_a_team_are_those_of_the_clock_and_the_processor() -> None:
    wall, cpu = threads._seconds()
    torch.randn(400, 400) @ torch.randn(400, 400)
    later = threads._seconds()
    assert later[0] > wall
    assert later[1] > cpu
