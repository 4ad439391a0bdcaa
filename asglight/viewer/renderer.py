# SPDX-License-Identifier: Apache-2.0
"""The passes one after another, each run only when something it reads has changed."""

from dataclasses import replace

import moderngl

from asglight.lobes import LobeTracks
from asglight.viewer.passes import (
    DisplayPass,
    LobesPass,
    display_target,
    radiance_target,
    release_target,
    target_texture,
)
from asglight.viewer.state import Display, ViewerState


class Renderer:
    """Draws a viewer's state as an sRGB latlong.

    Changing the exposure runs the display pass alone; an unchanged state runs nothing.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int]) -> None:
        """Compile the passes and make targets of `size`, (W, H)."""
        self._context = context
        self._lobes_pass = LobesPass(context)
        self._display_pass = DisplayPass(context)
        self._make_targets(size)

    def resize(self, size: tuple[int, int]) -> None:
        """Make the targets anew if their size, (W, H), has changed."""
        if size != self._radiance.size:
            before = self._radiance, self._shown
            self._make_targets(size)
            # moderngl binds the last used framebuffer again whenever it makes one: it must exist.
            self._shown.use()
            for target in before:
                release_target(target)

    def draw(self, state: ViewerState) -> moderngl.Framebuffer:
        """Bring the picture up to date and return its target."""
        if self._drawn_tracks is not state.tracks or self._drawn_frame != state.frame_index:
            self._lobes_pass.draw(state.lobes, self._radiance)
            self._drawn_tracks, self._drawn_frame = state.tracks, state.frame_index
            self._drawn_display = None
        if self._drawn_display != state.display:
            self._display_pass.draw(target_texture(self._radiance), state.display, self._shown)
            self._drawn_display = replace(state.display)
        return self._shown

    def _make_targets(self, size: tuple[int, int]) -> None:
        self._radiance = radiance_target(self._context, size)
        self._shown = display_target(self._context, size)
        self._drawn_tracks: LobeTracks | None = None
        self._drawn_frame = -1
        self._drawn_display: Display | None = None
