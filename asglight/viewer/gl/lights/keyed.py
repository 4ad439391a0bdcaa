# SPDX-License-Identifier: Apache-2.0
"""Balls and map of a keyed stage: under its keys, and under the rest.

Of the balls the rest is integrated as a reference is, once for a frame and a camera. Keys are
added: while something moves by the closed form of lobes, else by the integral over their cards, in
which a mirror shows a lamp's own outline.
"""

from typing import Any

import moderngl
import numpy as np

from asglight.viewer.gl.layers import (
    KEPT_SAMPLES,
    LIT_ROWS,
    ClosedForm,
    Integral,
    Layer,
    ReferenceMap,
    lobes_key,
)
from asglight.viewer.gl.passes import cover, pass_program
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.uniforms.key_cards import with_cards

_DARK = np.zeros((1, 2, 3), np.float32)


class KeyedBalls(Layer):
    """Balls lit by keys and rest."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the passes."""
        super().__init__(context)
        self._rest = Integral(context, albedo_table)
        self._cards = Integral(context, albedo_table)
        self._rest_map, self._cards_map = ReferenceMap(context), ReferenceMap(context)
        self._program = pass_program(context, "sum.frag")
        for unit, name in enumerate(("u_first", "u_second")):
            self._program[name] = unit
        self._triangle = context.vertex_array(self._program, [])
        self._map: tuple[Any, np.ndarray] | None = None
        self.progress = 1.0

    def draw(self, state: ViewerState, closed_form: ClosedForm, size: tuple[int, int]) -> None:
        """Bring the layer up to date.

        Args:
            state: Of a keyed stage.
            closed_form: Draws keys while something moves.
            size: Columns and rows.
        """
        keys = self._keys(state, closed_form, size)
        image = state.rest_image
        if image is None:  # it is being read: until then keys are shown alone
            image = _DARK
        name = Held(state.keyed), Held(image), state.playback.time
        self._rest.draw(state, image, self._rest_map, name, size)
        self.progress = min(self.progress, self._rest.progress if image is not _DARK else 0.0)
        textures = keys[0], self._rest.texture
        if not self.needs((*map(Held, textures), keys[1], self._rest.version), size):
            return
        for unit, texture in enumerate(textures):
            texture.use(location=unit)
        cover(self._context, self._triangle, self._target)

    def _keys(
        self, state: ViewerState, closed_form: ClosedForm, size: tuple[int, int]
    ) -> tuple[moderngl.Texture, int]:
        """Return the balls under the keys, and a number that counts their pictures."""
        self.progress = 1.0
        if not state.is_moving:
            key = lobes_key(state)
            if self._map is None or self._map[0] != key:
                dark = np.zeros((LIT_ROWS, 2 * LIT_ROWS, 3), np.float32)
                self._map = key, with_cards(dark, state.lit_lobes)
            self._cards.draw(state, self._map[1], self._cards_map, ("keys", key), size)
            self.progress = self._cards.progress
            if self._cards.samples >= KEPT_SAMPLES:
                return self._cards.texture, self._cards.version
        closed_form.draw(state, size)
        return closed_form.texture, closed_form.version


class KeyedMap:
    """Keys and rest as a latlong map: the rest, and the rectangles of the keys on it."""

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
