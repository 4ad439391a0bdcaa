# SPDX-License-Identifier: Apache-2.0
"""The layers put together: what is shaded, what is only shown anew, and how fine while it moves."""

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.compare import ball_errors
from asglight.viewer.gl.draft import Draft, Stopwatch
from asglight.viewer.gl.keyed import KeyedBalls, KeyedMap
from asglight.viewer.gl.layers import (
    Background,
    ClosedForm,
    Integral,
    LobesMap,
    ReferenceMap,
    camera_key,
    lit_map,
    lobes_key,
)
from asglight.viewer.gl.passes import (
    BackgroundPass,
    DisplayPass,
    Picture,
    display_target,
    release_target,
)
from asglight.viewer.state.display import Comparison, Subject
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState


@dataclass
class Counts:
    """What the renderer has drawn.

    Attributes:
        shaded: Balls lit by the closed forms, all of a row at once.
        displayed: Pictures brought to the screen's colours.
    """

    shaded: int = 0
    displayed: int = 0


class Renderer:
    """Draws a viewer's state. An unchanged state draws nothing."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the passes that every picture needs; the reference's follow when asked for."""
        self._context = context
        self._albedo_table = albedo_table(context)
        self._closed_form = ClosedForm(context, self._albedo_table)
        self._lobes_map = LobesMap(context)
        self._keyed_map = KeyedMap(context)
        self._keyed_balls: KeyedBalls | None = None
        self._reference_map = ReferenceMap(context)
        self._display = DisplayPass(context)
        self._blank = context.texture((1, 1), 4, bytes(16), dtype="f4")
        background_pass = BackgroundPass(context)
        self._backgrounds = (
            Background(context, background_pass),
            Background(context, background_pass),
        )
        self._integrals: dict[bool, Integral] = {}
        self._lobes_image: tuple[Any, np.ndarray] | None = None
        self._shown = {name: _Shown(context) for name in ("balls", "map")}
        self._last: tuple[Picture, Picture | None] | None = None
        self._pixel: tuple[Any, tuple[np.ndarray | None, np.ndarray | None]] | None = None
        self._errors: tuple[Any, list[float | None]] | None = None
        self._light: Any = None
        self._is_draft = False
        self._draft = Draft()
        self._stopwatch = Stopwatch(context)
        self.displayed = 0
        self.reference_progress = 1.0

    @property
    def counts(self) -> Counts:
        """What has been drawn so far."""
        return Counts(self._closed_form.version, self.displayed)

    def balls(self, state: ViewerState, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Bring the picture of the balls up to date.

        Args:
            state: What to show.
            size: Columns and rows, (W, H), of the picture.

        Returns:
            Its target, sRGB.
        """
        rows = max(1, size[1] // 2) if state.shown is Comparison.ROWS else size[1]
        if not self._wants_draft(state):
            self._last = self._pair(state, (size[0], rows))
        else:
            divisor = self._draft.divisor
            with self._stopwatch:
                self._last = self._pair(state, (-(-size[0] // divisor), -(-rows // divisor)))
        return self._bring("balls", state, state.shown, self._last, self._versions(), size)

    def _wants_draft(self, state: ViewerState) -> bool:
        """Tell whether the light moves: an exposure that is dragged shades nothing anew."""
        light = lobes_key(state), camera_key(state), state.balls
        moves = state.is_moving and (light != self._light or self._is_draft)
        self._light, self._is_draft = light, moves
        return moves

    def learn(self) -> None:
        """Choose how fine the next picture in motion is; to be called when one is finished.

        Earlier, asking how long it took would wait for it.
        """
        self._draft.took(self._stopwatch.seconds())

    def map(self, state: ViewerState, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Bring the picture of the latlong panel up to date; arguments as of `balls`."""
        lights_map = self._map_of(state)
        if state.shown_map is not Comparison.REFERENCE:
            lights_map.draw(state)
        reference = None if state.references is None else Picture(self._blank)
        if state.reference_image is not None:
            self._reference_map.upload(state.reference_image)
            reference = Picture(self._reference_map.texture)
        pair = Picture(lights_map.texture), reference
        versions = lights_map.version, self._reference_map.version
        return self._bring("map", state, state.shown_map, pair, versions, size)

    def _map_of(self, state: ViewerState) -> LobesMap | KeyedMap:
        """Return the map of the lights."""
        return self._lobes_map if state.keyed is None else self._keyed_map

    @property
    def shown_balls(self) -> moderngl.Framebuffer:
        """The picture of the balls as it was drawn last."""
        return self._shown["balls"].target

    def pixel(self, x: float, y: float) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Read the radiance of fit and reference at a place of the balls' picture.

        It waits for the GPU: ask for it while nothing moves.

        Args:
            x: Share of the columns, from the left.
            y: Share of the rows of one row of balls, from the top.

        Returns:
            Linear RGB each, without the environment's intensity; None where there is no ball.
        """
        if self._last is None:
            return None, None
        found = [
            None if picture is None else self._read(picture.front, x, y) for picture in self._last
        ]
        return found[0], found[1]

    def probed(self, x: float, y: float) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return what `pixel` returns, read again only where the picture is another one."""
        key = (x, y, self._versions(), tuple(map(Held, self._last or ())))
        if self._pixel is None or self._pixel[0] != key:
            self._pixel = key, self.pixel(x, y)
        return self._pixel[1]

    def ball_errors(self, state: ViewerState) -> list[float | None] | None:
        """Return the relative L1 error of each ball of the pair that is compared.

        Read anew each time the reference has gained a quarter of its samples, since reading waits
        for the GPU.

        Returns:
            One number for each ball, None for a ball whose reference is black; None in place of
            all while something moves, while there is nothing to compare, and at the start.
        """
        quarter = int(4 * self.reference_progress)
        fit, reference = self._last or (None, None)
        waits = quarter == 0 or state.is_moving or not state.is_fitted
        if fit is None or reference is None or waits:
            return None
        if fit.front.size != reference.front.size:  # the reference is still being read
            return None
        key = (lobes_key(state), camera_key(state), state.balls, state.compared.subject)
        key = (*key, Held(state.reference_image), fit.front.size, quarter)
        if self._errors is None or self._errors[0] != key:
            arrangement = cells(fit.front.size, len(state.balls))
            errors = ball_errors(_pixels(fit.front), _pixels(reference.front), arrangement)
            self._errors = key, errors
        return self._errors[1]

    def radiance(self, state: ViewerState) -> np.ndarray:
        """Return the balls as they were drawn last, before any view: linear, unexposed.

        Args:
            state: The session, whose comparison it shows; the wipe as columns of both.

        Returns:
            Radiance with the environment's intensity; 0 where nothing is.  [H, W, 3]
        """
        fit, reference = (
            None if picture is None else _composed(picture)
            for picture in self._last or (None, None)
        )
        assert fit is not None  # `balls` comes first
        shown = state.shown
        if reference is None:
            reference = np.zeros_like(fit)
        if shown is Comparison.ROWS:
            picture = np.concatenate([fit, reference])
        elif shown is Comparison.WIPE:
            at = round(state.compared.wipe * fit.shape[1])
            picture = np.concatenate([fit[:, :at], reference[:, at:]], axis=1)
        elif shown is Comparison.RATIO:
            picture = fit / np.maximum(reference, np.finfo(np.float32).tiny)
        elif shown is Comparison.DIFFERENCE:
            picture = fit - reference
        else:
            picture = fit if shown is Comparison.FIT else reference
        return picture * np.float32(2.0**state.environment.intensity_ev)

    def _pair(self, state: ViewerState, size: tuple[int, int]) -> tuple[Picture, Picture | None]:
        """Bring both layers up to date and return them."""
        subject = state.compared.subject
        image = state.reference_image
        of_fit, of_reference = self._background_textures(state, size, image)
        self.reference_progress = 1.0
        if image is not None and subject is Subject.FIT:
            front = self._integral(state, size, image, of_lobes=True)
        elif state.keyed is not None:
            front = self._of_keys(state, size)
        else:
            self._closed_form.draw(state, size)
            front = self._closed_form.texture
        fit = Picture(front, of_fit)
        if state.shown is Comparison.FIT:
            return fit, None
        if image is None or not self.displayed:
            # The first picture does not wait for the reference's shader.
            if image is not None:
                self.reference_progress = 0.0
            return fit, Picture(self._blank, self._blank)
        of_lobes = subject is Subject.SHADING
        reference = self._integral(state, size, image, of_lobes=of_lobes)
        return fit, Picture(reference, of_fit if of_lobes else of_reference)

    def _of_keys(self, state: ViewerState, size: tuple[int, int]) -> moderngl.Texture:
        """Add samples to the balls under keys and rest, and return them."""
        if self._keyed_balls is None:
            self._keyed_balls = KeyedBalls(self._context, self._albedo_table)
        self._keyed_balls.draw(state, self._closed_form, size)
        self.reference_progress = self._keyed_balls.progress
        return self._keyed_balls.texture

    def _integral(
        self, state: ViewerState, size: tuple[int, int], image: np.ndarray, *, of_lobes: bool
    ) -> moderngl.Texture:
        """Add samples to the balls under the lobes' map or the image, and return them."""
        if of_lobes not in self._integrals:
            self._integrals[of_lobes] = Integral(self._context, self._albedo_table)
        name: Any = "map", Held(state.references), state.playback.time
        if of_lobes:
            key = lobes_key(state)
            if self._lobes_image is None or self._lobes_image[0] != key:
                self._lobes_image = key, lit_map(state.lit_lobes)
            image = self._lobes_image[1]
            name = "lobes", key
            if state.keyed is not None:
                self._keyed_map.draw(state)
                image, name = self._keyed_map.image, ("keys", key, Held(self._keyed_map.image))
        layer = self._integrals[of_lobes]
        layer.draw(state, image, name, size)
        self.reference_progress = min(self.reference_progress, layer.progress)
        return layer.texture

    def _background_textures(
        self, state: ViewerState, size: tuple[int, int], image: np.ndarray | None
    ) -> tuple[moderngl.Texture | None, moderngl.Texture | None]:
        if not state.environment.is_shown:
            return None, None
        lights_map = self._map_of(state)
        lights_map.draw(state)
        first, second = self._backgrounds
        first.draw(state, lights_map.texture, lights_map.version, size)
        if image is None:
            return first.texture, None
        self._reference_map.upload(image)
        second.draw(state, self._reference_map.texture, self._reference_map.version, size)
        return first.texture, second.texture

    def _read(self, texture: moderngl.Texture, x: float, y: float) -> np.ndarray | None:
        """Read one texel; the others stay where they are."""
        width, height = texture.size
        place = min(int(x * width), width - 1), min(int(y * height), height - 1)
        target = self._context.framebuffer([texture])
        texel = np.frombuffer(target.read((*place, 1, 1), components=4, dtype="f4"), np.float32)
        target.release()
        return texel[:3] / texel[3] if texel[3] > 0 else None

    def _versions(self) -> tuple[int, ...]:
        keyed = () if self._keyed_balls is None else (self._keyed_balls,)
        layers = (self._closed_form, *keyed, *self._backgrounds, *self._integrals.values())
        return tuple(layer.version for layer in layers)

    def _bring(
        self,
        name: str,
        state: ViewerState,
        wanted: Comparison,
        pair: tuple[Picture, Picture | None],
        versions: tuple[int, ...],
        size: tuple[int, int],
    ) -> moderngl.Framebuffer:
        """Draw pictures in the screen's colours, if they or what is wanted of them changed."""
        fit, reference = pair
        comparison = Comparison.FIT if reference is None else wanted
        wipe = state.compared.wipe if name == "balls" else state.map_view.wipe
        shown = self._shown[name]
        textures = tuple(map(Held, (*fit, *(reference or ()))))
        key = (textures, versions, *_display_key(state), comparison, wipe)
        if not shown.needs(key, size):
            return shown.target
        columns, rows = size
        parts: list[tuple[Comparison, tuple[int, int, int, int] | None]] = [(comparison, None)]
        if comparison is Comparison.ROWS:
            half = rows // 2
            parts = [
                (Comparison.FIT, (0, 0, columns, half)),
                (Comparison.REFERENCE, (0, half, columns, rows - half)),
            ]
        for part, area in parts:
            self._display.draw(
                fit,
                reference,
                state.display,
                part,
                shown.target,
                gain_ev=state.environment.intensity_ev,
                wipe=wipe,
                area=area,
            )
        self.displayed += 1
        return shown.target


class _Shown:
    """A display target, and what it shows."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self.target = display_target(context, (1, 1))
        self._key: tuple[Any, ...] | None = None

    def needs(self, key: tuple[Any, ...], size: tuple[int, int]) -> bool:
        """Tell whether a picture is another one than that shown, and make room for it."""
        if self.target.size != size:
            target = display_target(self._context, size)
            target.use()  # moderngl binds the last used framebuffer again: it must exist
            release_target(self.target)
            self.target, self._key = target, None
        changed = self._key is None or self._key != key
        self._key = key
        return changed


def _display_key(state: ViewerState) -> tuple[Any, ...]:
    display = state.display
    values = (display.exposure_ev, display.transform, display.channel, display.zebra)
    return (*values, state.environment.intensity_ev)


def _composed(picture: Picture) -> np.ndarray:
    """Return balls over their background, if there is one, row 0 at the top.  [H, W, 3]."""
    front = _pixels(picture.front)
    radiance = front[..., :3]
    if picture.background is None:
        return radiance
    return radiance + (1 - front[..., 3:]) * _pixels(picture.background)[..., :3]


def _pixels(texture: moderngl.Texture) -> np.ndarray:
    width, height = texture.size
    return np.frombuffer(texture.read(), np.float32).reshape(height, width, 4)
