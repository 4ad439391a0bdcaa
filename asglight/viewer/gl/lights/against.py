# SPDX-License-Identifier: Apache-2.0
"""The layers of another fit, B: its balls, its map, its background."""

import moderngl

from asglight.viewer.gl.layers import Background, ClosedForm, LobesMap
from asglight.viewer.gl.passes import BackgroundPass, Picture
from asglight.viewer.state.viewer_state import ViewerState


class AgainstLayers:
    """Radiance of B, drawn anew only when it must be."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the passes."""
        self._closed_form = ClosedForm(context, albedo_table)
        self._map = LobesMap(context)
        self._background = Background(context, BackgroundPass(context))

    @property
    def versions(self) -> tuple[int, ...]:
        """What the layers have drawn."""
        return tuple(one.version for one in (self._closed_form, self._map, self._background))

    def balls(self, state: ViewerState, size: tuple[int, int]) -> Picture:
        """Bring its balls up to date, before its light where the environment is shown.

        Args:
            state: The session, which holds another fit against its own.
            size: Columns and rows.
        """
        assert state.against is not None
        seen = state.against.seen_with(state)
        self._closed_form.draw(seen, size)
        if not state.environment.is_shown:
            return Picture(self._closed_form.texture)
        self._map.draw(seen)
        self._background.draw(seen, self._map.texture, self._map.version, size)
        return Picture(self._closed_form.texture, self._background.texture)

    def map(self, state: ViewerState) -> Picture:
        """Bring its map up to date; arguments as of `balls`."""
        assert state.against is not None
        self._map.draw(state.against.seen_with(state))
        return Picture(self._map.texture)
