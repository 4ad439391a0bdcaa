# SPDX-License-Identifier: Apache-2.0
"""Pictures brought to the screen's colours, each drawn anew only where it is another one."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import moderngl

from asglight.errors import InputError
from asglight.viewer.colour import opencolorio
from asglight.viewer.gl.arrangement import drawn_areas, strip
from asglight.viewer.gl.display_pass import DisplayPass
from asglight.viewer.gl.passes import Area, Picture, display_target
from asglight.viewer.state.display import Comparison, ViewTransform
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Scene
from asglight.viewer.uniforms.shader_defines import SURROUND

Name = Literal["balls", "map"]


class Pictures(NamedTuple):
    """What is shown, one beside the other or compared.

    Attributes:
        fit: Of the lights that are edited.
        reference: What it is compared with, if there is anything.
        truth: What both are held against, below them, if there is anything.
    """

    fit: Picture
    reference: Picture | None
    truth: Picture | None = None


class Screens:
    """The screens of the balls and of the map.

    Drivers without a GPU let whoever draws with a texture wait until it is finished. A window
    therefore lets its screens wait, and has them drawn when its panels have done their work.

    Attributes:
        displayed: Pictures drawn so far.
    """

    def __init__(self, context: moderngl.Context, *, waits: bool = False) -> None:
        """Prepare the pass that knows the screen.

        Args:
            context: Where to draw.
            waits: Whether pictures are drawn by `draw_waiting`, not at once.
        """
        self._display = DisplayPass(context)
        self._shown: dict[Name, _Shown] = {"balls": _Shown(context), "map": _Shown(context)}
        self._waits = waits
        self._waiting: list[Callable[[], None]] = []
        self.displayed = 0

    def shown(self, name: Name) -> moderngl.Framebuffer:
        """Return a picture as it was drawn last."""
        return self._shown[name].target

    def bring(
        self,
        name: Name,
        state: ViewerState,
        wanted: Comparison,
        pictures: Pictures,
        versions: tuple[int, ...],
        size: tuple[int, int],
    ) -> moderngl.Framebuffer:
        """Draw pictures in the screen's colours, if they or what is wanted of them changed.

        Args:
            name: Which screen.
            state: How radiance is shown.
            wanted: What is shown of the pictures.
            pictures: Radiance.
            versions: Count what was drawn into them.
            size: Columns and rows.

        Returns:
            The target, sRGB.
        """
        _leave_unusable_view(state)
        fit, reference, truth = pictures
        comparison = Comparison.FIT if reference is None else wanted
        wipe = state.compared.wipe if name == "balls" else state.map_view.wipe
        shown = self._shown[name]
        frame = astuple(state.map_frame) if name == "map" else None
        textures = tuple(map(Held, (*fit, *(reference or ()), *(truth or ()))))
        key = (textures, versions, *_display_key(state), comparison, wipe, frame)
        if not shown.needs(key, size):
            return shown.target
        parts = _parts(name, state, comparison, truth is not None, size)
        is_row = name == "balls" and state.scene is Scene.BALLS
        is_sparse = is_row and fit.background is None
        draws: list[Callable[[], None]] = []
        for place, (part, area) in enumerate(parts):
            within = [(0, 0, *size)] if name == "map" else None
            if is_sparse:
                within = drawn_areas(fit.front.size, len(state.balls), area)
            draw = partial(
                self._display.draw,
                fit,
                truth if place == 2 else reference,
                replace(state.display),
                part,
                shown.target,
                gain_ev=state.environment.intensity_ev,
                wipe=wipe,
                area=area,
                within=within,
            )
            draws.append(draw)
        self._waiting.append(partial(self._draw, shown.target, draws))
        if not self._waits:
            self.draw_waiting()
        return shown.target

    def draw_waiting(self) -> None:
        """Draw what was wanted and is not drawn yet."""
        waiting, self._waiting = self._waiting, []
        for draw in waiting:
            draw()

    def _draw(self, target: moderngl.Framebuffer, draws: Sequence[Callable[[], None]]) -> None:
        target.clear(*SURROUND, 1.0)
        for draw in draws:
            draw()
        self.displayed += 1


class _Shown:
    """A display target, and what it shows."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self.target = display_target(context, (1, 1))
        self._key: tuple[Any, ...] | None = None

    def needs(self, key: tuple[Any, ...], size: tuple[int, int]) -> bool:
        """Tell whether a picture is another one than that shown, and make room for it."""
        if self.target.size != size:
            self.target, self._key = display_target(self._context, size), None
        changed = self._key is None or self._key != key
        self._key = key
        return changed


def _parts(
    name: Name, state: ViewerState, comparison: Comparison, has_truth: bool, size: tuple[int, int]
) -> list[tuple[Comparison, Area]]:
    """Return what is drawn of the pictures, and where."""
    columns, rows = size
    parts: list[tuple[Comparison, Area]] = [(comparison, (0, 0, columns, rows))]
    if comparison is Comparison.ROWS:
        count = 3 if has_truth else 2
        each = rows // count
        parts = [
            (Comparison.FIT, (0, 0, columns, each)),
            (Comparison.REFERENCE, (0, each, columns, each)),
        ]
        if has_truth:
            parts.append((Comparison.REFERENCE, (0, 2 * each, columns, each)))
    elif name == "balls":
        top, height = strip(rows, state.parts)
        parts = [(comparison, (0, top, columns, height))]
    else:
        x, y, wide, high = map(round, state.map_frame.area(columns, rows))
        parts = [(comparison, (x, y, wide, high))]
    return parts


def _leave_unusable_view(state: ViewerState) -> None:
    """Go back to sRGB, and say why, where a view of OpenColorIO cannot be had (any more)."""
    display = state.display
    if display.transform is not ViewTransform.OPENCOLORIO:
        return
    try:
        opencolorio.view_shader(display.colour_view)
    except InputError as error:
        state.message = str(error)
        display.transform = ViewTransform.SRGB


def _display_key(state: ViewerState) -> tuple[Any, ...]:
    display = state.display
    values = (display.exposure_ev, display.transform, display.channel, display.zebra)
    values = (*values, display.colour_view)
    return (*values, state.environment.intensity_ev)
