# SPDX-License-Identifier: Apache-2.0
"""What the viewer remembers from one session to the next: habits, not the shot's own values."""

import json
from contextlib import suppress
from dataclasses import asdict, astuple

from asglight.viewer.state.balls import Material
from asglight.viewer.state.display import ColourView, ViewTransform
from asglight.viewer.state.time.playback import Pace
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Theme


def as_text(state: ViewerState) -> str:
    """Return a session's settings as JSON."""
    return json.dumps(
        {
            "view": state.display.transform,
            "colour view": asdict(state.display.colour_view),
            "zebra": state.display.zebra,
            "material": state.material,
            "background": state.environment.is_shown,
            "pace": state.playback.pace,
            "theme": state.theme,
            "loop": state.playback.loops,
            "list of lobes": state.list_room.share,
        }
    )


def restore(state: ViewerState, text: str) -> None:
    """Bring a session to remembered settings; what cannot be read keeps its default."""
    try:
        values = json.loads(text)
    except ValueError:
        return
    if not isinstance(values, dict):
        return
    with suppress(ValueError):
        state.display.transform = ViewTransform(values.get("view"))
    with suppress(TypeError):
        found = ColourView(**values.get("colour view", {}))
        if all(isinstance(name, str) for name in astuple(found)):
            state.display.colour_view = found
    with suppress(ValueError):
        state.material = Material(values.get("material"))
    with suppress(ValueError):
        state.playback.pace = Pace(values.get("pace"))
    with suppress(ValueError):
        state.theme = Theme(values.get("theme"))
    share = values.get("list of lobes")
    if isinstance(share, float) and 0 < share < 1:
        state.list_room.share = share
    state.display.zebra = values.get("zebra") is True
    state.environment.is_shown = values.get("background") is True
    state.playback.loops = values.get("loop") is not False
