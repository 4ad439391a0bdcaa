# SPDX-License-Identifier: Apache-2.0
"""Settings are remembered, and whatever a settings file holds, a session starts."""

import pytest

from asglight.lobes import LobeTracks
from asglight.viewer.state import settings
from asglight.viewer.state.balls import Material
from asglight.viewer.state.display import ViewTransform
from asglight.viewer.state.time.playback import Pace
from asglight.viewer.state.viewer_state import ViewerState


def test_settings_come_back(two_lamps: LobeTracks) -> None:
    before, after = ViewerState(two_lamps), ViewerState(two_lamps)
    before.display.transform = ViewTransform.FILMIC
    before.display.zebra = True
    before.material = Material.DIELECTRIC
    before.environment.is_shown = True
    before.playback.pace = Pace.EVERY_FRAME
    before.playback.loops = False
    before.list_room.share = 0.375
    settings.restore(after, settings.as_text(before))
    assert after.display == before.display
    assert after.material is Material.DIELECTRIC
    assert after.environment.is_shown
    assert after.playback.pace is Pace.EVERY_FRAME
    assert not after.playback.loops
    assert after.list_room.share == 0.375


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"view": 3, "material": "wood", "pace": null}'])
def test_damaged_settings_leave_the_defaults(two_lamps: LobeTracks, text: str) -> None:
    state, fresh = ViewerState(two_lamps), ViewerState(two_lamps)
    settings.restore(state, text)
    assert state.display == fresh.display
    assert state.material is fresh.material
    assert state.playback.pace is fresh.playback.pace
    assert state.playback.loops
