# SPDX-License-Identifier: Apache-2.0
"""Reads pictures back and measures them: what the scopes show, kept until it is another one."""

from typing import Any, NamedTuple

import moderngl
import numpy as np
import torch

from asglight.sphere import latlong
from asglight.viewer.colour.scopes import histogram, waveform
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import ScopeKind, ScopePlace


class Scoped(NamedTuple):
    """A picture measured.

    Attributes:
        histogram: Shares of it, before exposure; of a waveform what was measured last.  [3, B]
        texture: The waveform's, sRGB, as Dear ImGui takes it.
    """

    histogram: np.ndarray
    texture: int


class Scopes:
    """The measurements of the picture that was measured last."""

    def __init__(self, context: moderngl.Context) -> None:
        """Begin without any."""
        self._context = context
        self._key: Any = None
        self._texture = context.texture((1, 1), 3, bytes(3), alignment=1)
        self._found: Scoped | None = None

    def measured(
        self, state: ViewerState, radiance: moderngl.Texture | None, version: tuple[int, ...]
    ) -> Scoped | None:
        """Measure a picture, reading it back: it waits for the GPU, so not while something moves.

        Args:
            state: What is to be measured of it.
            radiance: RGB times the coverage in the fourth channel.
            version: Counts what was drawn into it.
        """
        if state.is_moving and self._found is not None:
            return self._found
        if radiance is None or min(radiance.size) < 2:
            return None
        key = Held(radiance), version, state.scope.kind, state.scope.place
        if key == self._key:
            return self._found
        self._key = key
        width, height = radiance.size
        values = np.frombuffer(radiance.read(), np.float32).reshape(height, width, 4)
        weight = np.ascontiguousarray(values[..., 3])
        colour = values[..., :3] / np.maximum(weight, 1e-6)[..., None]  # 1e-6: no coverage
        if state.scope.place is ScopePlace.MAP:
            areas = latlong.texel_solid_angles(height, width).expand(-1, width)
            weight = areas.to(torch.float32).numpy()
        if state.scope.kind is ScopeKind.HISTOGRAM:
            self._found = Scoped(histogram(colour, weight), self._texture.glo)
            return self._found
        picture = waveform(colour, weight)
        rows, columns = picture.shape[:2]
        if self._texture.size != (columns, rows):
            self._texture = self._context.texture((columns, rows), 3, alignment=1)
        self._texture.write((255 * picture).astype(np.uint8).tobytes(), alignment=1)
        shares = np.zeros((3, rows)) if self._found is None else self._found.histogram
        self._found = Scoped(shares, self._texture.glo)
        return self._found
