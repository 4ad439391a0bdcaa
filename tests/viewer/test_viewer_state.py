# SPDX-License-Identifier: Apache-2.0
"""The viewer's state keeps to the frames there are and to its ranges."""

import pytest
import torch

from asglight.errors import InputError
from asglight.lobes import Lobes, LobeTracks
from asglight.viewer.state import EXPOSURE_EV_MAX, Display, ViewerState


@pytest.mark.parametrize(
    ("wanted", "shown"),
    [(1001, 1001), (1002, 1002), (1003, 1002), (1004, 1004), (0, 1001), (5000, 1004)],
)
def test_going_to_a_frame_shows_the_nearest_there_is(
    two_lamps: LobeTracks, wanted: int, shown: int
) -> None:
    state = ViewerState(two_lamps)
    state.go_to(wanted)
    assert state.frame == shown


def test_steps_skip_the_gap_and_stop_at_the_ends(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    seen = []
    for step in (-1, 1, 1, 1, -1, -5):
        state.step(step)
        seen.append(state.frame)
    assert seen == [1001, 1002, 1004, 1004, 1002, 1001]


def test_lobes_are_those_of_the_frame(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.go_to(1004)
    torch.testing.assert_close(state.lobes.axes, two_lamps.at(1004).axes)


def test_exposure_stops_at_its_ends() -> None:
    display = Display()
    display.expose(1e9)
    assert display.exposure_ev == EXPOSURE_EV_MAX
    display.expose(-1e9)
    assert display.exposure_ev == -EXPOSURE_EV_MAX


def test_more_lobes_than_the_viewer_holds_are_refused() -> None:
    lobes = Lobes(torch.eye(3).expand(1, 129, 3, 3), torch.ones(1, 129, 2), torch.ones(1, 129, 3))
    with pytest.raises(InputError, match=r"^tracks: 129 lobes; expected at most 128"):
        ViewerState(LobeTracks((1,), 24.0, lobes))
