# SPDX-License-Identifier: Apache-2.0
"""A fit that is watched replaces its tracks: edits and selection stay with their lights."""

import itertools
from dataclasses import replace

import pytest
import torch
from light_edits import scale_amplitude
from usd_tracks import beginning, moving

from asglight.lobes import LobeTracks
from asglight.viewer.state.edits import acting, carrying
from asglight.viewer.state.edits.carrying import places_in
from asglight.viewer.state.edits.edit import Mute, Rename
from asglight.viewer.state.edits.history import EditHistory
from asglight.viewer.state.session import padded
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Renaming

FRAMES = tuple(range(1001, 1009))

ORDER = [3, 1, 0]
"""Of a stage: by energy, and lobe 2 is left out."""


def reordered(tracks: LobeTracks) -> LobeTracks:
    return replace(tracks, lobes=tracks.lobes.select(torch.tensor(ORDER)), names=())


@pytest.mark.parametrize("count", [2, 8])
def test_edits_and_selection_go_with_their_lights_to_the_stage_that_is_written(count: int) -> None:
    """After two frames of eight, the others of which are black, as after all."""
    running = moving(FRAMES, lobes=4)
    state = ViewerState(padded(beginning(running, count), FRAMES))
    state.history.add(scale_amplitude(0, None, 1.0), scale_amplitude(2, None, 1.0))
    state.history.add(Mute(3))
    state.history.add(Rename(1, "window"))
    state.history.undo()
    state.history.drag(scale_amplitude(1, None, 2.0))
    state.select(2)
    state.selection.others = (3, 0)
    acting.toggle_solo(state, (2, 1))
    state.renaming = Renaming(3, "sun")
    written = reordered(running)
    state.replace_tracks(written)
    gain = (state.tracks.lobes.amplitude / written.lobes.amplitude).mean((0, 2))
    torch.testing.assert_close(gain, torch.tensor([1.0, 4.0, 2.0]))
    assert state.history.muted == {0}
    assert (state.selection.lobe, state.selection.others) == (0, (2,))
    assert state.selection.solo == {1}
    assert state.renaming is not None
    assert state.renaming.lobe == 0
    assert state.message == "1 edit was let go: its light is gone from the fit."
    state.history.cancel()
    state.history.redo()
    assert state.history.names[1] == "window"


def test_what_was_undone_cannot_be_made_again_to_a_light_that_is_gone() -> None:
    history = EditHistory(moving(FRAMES, lobes=4))
    history.add(Mute(0))
    history.add(scale_amplitude(2, None, 1.0))
    history.undo()
    history.undo()
    after = history.over(reordered(history.original))
    after.redo()
    assert after.muted == {2}
    assert not after.can_redo


def test_frames_that_come_move_nothing_and_are_not_matched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(carrying, "found_again", None)
    running = moving(FRAMES, lobes=4)
    tracks = [padded(beginning(running, count), FRAMES) for count in range(1, 9)]
    for before, after in itertools.pairwise(tracks):
        assert places_in(after, before).moved is None


def test_edits_of_another_environment_are_let_go() -> None:
    state = ViewerState(moving(FRAMES, lobes=4))
    state.history.add(Mute(0), Mute(1))
    lobes = state.tracks.lobes.clone()
    lobes.axes.copy_(-lobes.axes.roll(1, -2))
    state.replace_tracks(replace(state.tracks, lobes=lobes))
    assert not state.history.is_changed
    assert state.selection.lobe is None
    assert state.message == "2 edits were let go: their light is gone from the fit."
