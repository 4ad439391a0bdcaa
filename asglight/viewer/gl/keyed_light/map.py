# SPDX-License-Identifier: Apache-2.0
"""Keys and rest as a latlong map."""

from typing import Any

import moderngl
import numpy as np

from asglight.viewer.gl.layers import LIT_ROWS, ReferenceMap, lobes_key
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.uniforms.key_cards import with_cards


class KeyedMap:
    """The rest, and the rectangles of the keys on it."""

    def __init__(self, context: moderngl.Context) -> None:
        """Start black."""
        self._map = ReferenceMap(context)
        self._key: Any = None
        self.image = np.zeros((1, 2, 3), np.float32)

    @property
    def texture(self) -> moderngl.Texture:
        """The map, alpha 1."""
        return self._map.texture

    @property
    def version(self) -> int:
        """What was drawn, counted."""
        return self._map.version

    def draw(self, state: ViewerState) -> None:
        """Bring the map up to date."""
        rest = state.rest_image
        key = lobes_key(state), Held(rest)
        if key == self._key:
            return
        self._key = key
        if rest is None:
            rest = np.zeros((LIT_ROWS // 2, LIT_ROWS, 3), np.float32)
        self.image = with_cards(rest, state.lit_lobes)
        self._map.upload(self.image)
