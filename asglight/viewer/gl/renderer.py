# SPDX-License-Identifier: Apache-2.0
"""The layers put together: what is shaded, what is only shown anew, and how fine while it moves."""

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.arrangement import cells, strip
from asglight.viewer.gl.compare import ball_errors
from asglight.viewer.gl.draft import Draft, Stopwatch
from asglight.viewer.gl.layers import (
    Background,
    ClosedForm,
    Ground,
    Integral,
    LobesMap,
    ReferenceMap,
    camera_key,
    lit_map,
    lobes_key,
)
from asglight.viewer.gl.lights.against import AgainstLayers
from asglight.viewer.gl.lights.keyed import KeyedBalls, KeyedMap
from asglight.viewer.gl.passes import BackgroundPass, Picture
from asglight.viewer.gl.pictures.reading import compared, composed, pixels, texel
from asglight.viewer.gl.pictures.screens import Name, Pictures, Screens
from asglight.viewer.gl.scopes import Scoped, Scopes
from asglight.viewer.state.display import Comparison, Subject
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Scene, ScopePlace, ScopeSide


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

    def __init__(self, context: moderngl.Context, *, screens_wait: bool = False) -> None:
        """Compile the passes that every picture needs; the reference's follow when asked for.

        Args:
            context: Where to draw.
            screens_wait: Whether `balls` and `map` return targets that `draw_screens` draws into.
        """
        self._context = context
        self._albedo_table = albedo_table(context)
        self._closed_form = ClosedForm(context, self._albedo_table)
        self._ground = Ground(context, self._albedo_table)
        self._lobes_map = LobesMap(context)
        self._keyed_map = KeyedMap(context)
        self._keyed_balls: KeyedBalls | None = None
        self._reference_map = ReferenceMap(context)
        self._lit_map = ReferenceMap(context)
        self._screens = Screens(context, waits=screens_wait)
        self._blank = context.texture((1, 1), 4, bytes(16), dtype="f4")
        background_pass = BackgroundPass(context)
        self._backgrounds = (
            Background(context, background_pass),
            Background(context, background_pass),
        )
        self._integrals: dict[bool, Integral] = {}
        self._lobes_image: tuple[Any, np.ndarray] | None = None
        self._against: AgainstLayers | None = None
        self._last: tuple[Picture, Picture | None] | None = None
        self._last_map: tuple[Picture, Picture | None] | None = None
        self._scopes = Scopes(context)
        self._truth: Picture | None = None
        self._pixel: tuple[Any, tuple[np.ndarray | None, np.ndarray | None]] | None = None
        self._errors: dict[bool, tuple[Any, list[float | None]]] = {}
        self._light: Any = None
        self._is_draft = False
        self._draft = Draft()
        self._stopwatch = Stopwatch(context)
        self.reference_progress = 1.0

    @property
    def counts(self) -> Counts:
        """What has been drawn so far."""
        return Counts(self._closed_form.version, self._screens.displayed)

    def balls(self, state: ViewerState, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Bring the picture of the balls up to date.

        Args:
            state: What to show.
            size: Columns and rows, (W, H), of the picture.

        Returns:
            Its target, sRGB.
        """
        self._context.gc()  # here the GPU is ours: see `context.collects`
        rows = strip(size[1], state.parts).rows
        if not self._wants_draft(state):
            self._last = self._pair(state, (size[0], rows))
        else:
            divisor = self._draft.divisor
            with self._stopwatch:
                self._last = self._pair(state, (-(-size[0] // divisor), -(-rows // divisor)))
        return self._screens.bring(
            "balls", state, state.shown, Pictures(*self._last, self._truth), self._versions(), size
        )

    def _wants_draft(self, state: ViewerState) -> bool:
        """Tell whether the light moves: an exposure that is dragged shades nothing anew."""
        light = lobes_key(state), camera_key(state), state.balls, state.scene, state.ground_ball
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
        if state.subject is Subject.AGAINST:
            reference = self._of_b.map(state)
        elif state.reference_image is not None:
            self._reference_map.upload(state.reference_image)
            reference = Picture(self._reference_map.texture)
        pair = self._last_map = Picture(lights_map.texture), reference
        versions = lights_map.version, self._reference_map.version, *self._of_b_versions
        return self._screens.bring("map", state, state.shown_map, Pictures(*pair), versions, size)

    def draw_screens(self) -> None:
        """Draw the screens that wait."""
        self._screens.draw_waiting()

    def scoped(self, state: ViewerState) -> Scoped | None:
        """Measure a picture as it was drawn last; while something moves the last one stays."""
        lights_map = self._map_of(state)
        versions = *self._versions(), lights_map.version, self._reference_map.version
        return self._scopes.measured(state, self._measured(state), versions)

    def _measured(self, state: ViewerState) -> moderngl.Texture | None:
        """Return the radiance that is to be measured, also where it is not shown."""
        scope = state.scope
        if scope.place is ScopePlace.MAP and scope.side is ScopeSide.FIT:
            lights_map = self._map_of(state)
            lights_map.draw(state)
            return lights_map.texture
        index = 0 if scope.side is ScopeSide.FIT else 1
        pair = self._last if scope.place is ScopePlace.BALLS else self._last_map
        picture = None if pair is None else pair[index]
        return None if picture is None else picture.front

    def shown(self, name: Name) -> moderngl.Framebuffer:
        """Return a panel's picture as it was drawn last."""
        return self._screens.shown(name)

    def _map_of(self, state: ViewerState) -> LobesMap | KeyedMap:
        """Return the map of the lights."""
        return self._lobes_map if state.keyed is None else self._keyed_map

    @property
    def shown_balls(self) -> moderngl.Framebuffer:
        """The picture of the balls as it was drawn last."""
        return self._screens.shown("balls")

    def pixel(self, x: float, y: float) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Read the radiance of fit and reference at a place of the balls' picture.

        It waits for the GPU: ask for it while nothing moves.

        Args:
            x: Share of the columns, from the left.
            y: Share of the rows of the strip of balls, from the top.

        Returns:
            Linear RGB each, without the environment's intensity; None where there is no ball.
        """
        if self._last is None:
            return None, None
        found = [
            None if picture is None else texel(self._context, picture.front, x, y)
            for picture in self._last
        ]
        return found[0], found[1]

    def probed(self, x: float, y: float) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return what `pixel` returns, read again only where the picture is another one."""
        key = (x, y, self._versions(), tuple(map(Held, self._last or ())))
        if self._pixel is None or self._pixel[0] != key:
            self._pixel = key, self.pixel(x, y)
        return self._pixel[1]

    def ball_errors(self, state: ViewerState, *, of_b: bool = False) -> list[float | None] | None:
        """Return the relative L1 error of each ball: of the fit against what it is compared with.

        Of A and B both are held against the HDRI; where there is none, A is held against B. Read
        anew each time the reference has gained a quarter of its samples, since reading waits for
        the GPU.

        Args:
            state: The session.
            of_b: Whether those of B are asked for.

        Returns:
            One number for each ball, None for a ball whose reference is black; None in place of
            all while something moves, while there is nothing to compare, and at the start.
        """
        quarter = int(4 * self.reference_progress)
        fit, reference = self._last or (None, None)
        if state.subject is Subject.AGAINST and state.references is not None:
            fit, reference = reference if of_b else fit, self._truth
        elif of_b:
            return None
        waits = quarter == 0 or state.is_moving or not state.is_fitted
        if fit is None or reference is None or waits:
            return None
        if fit.front.size != reference.front.size:  # the reference is still being read
            return None
        key = (lobes_key(state), camera_key(state), state.balls, state.subject)
        key = (*key, Held(state.reference_image), Held(state.against), fit.front.size, quarter)
        if of_b not in self._errors or self._errors[of_b][0] != key:
            arrangement = cells(fit.front.size, len(state.balls))
            errors = ball_errors(pixels(fit.front), pixels(reference.front), arrangement)
            self._errors[of_b] = key, errors
        return self._errors[of_b][1]

    def radiance(self, state: ViewerState) -> np.ndarray:
        """Return the balls as they were drawn last, before any view: linear, unexposed.

        Args:
            state: The session, whose comparison it shows; the wipe as columns of both.

        Returns:
            Radiance with the environment's intensity, or a ratio of two; 0 where nothing is.
            [H, W, 3]
        """
        fit, reference = (
            None if picture is None else composed(picture) for picture in self._last or (None, None)
        )
        assert fit is not None  # `balls` comes first
        shown = state.shown
        if reference is None:
            reference = np.zeros_like(fit)
        if shown is Comparison.ROWS:
            truth = [] if self._truth is None else [composed(self._truth)]
            picture = np.concatenate([fit, reference, *truth])
        else:
            single = compared(shown, fit, reference, state.compared.wipe)
            top, rows = strip(self.shown_balls.height, state.parts)
            picture = np.zeros((self.shown_balls.height, *single.shape[1:]), np.float32)
            picture[top : top + rows] = single
        if shown is Comparison.RATIO:
            return picture  # of either intensity it is the same
        return picture * np.float32(2.0**state.environment.intensity_ev)

    def _pair(self, state: ViewerState, size: tuple[int, int]) -> tuple[Picture, Picture | None]:
        """Bring both layers up to date and return them."""
        self._truth = None
        if state.scene is Scene.GROUND:
            self._ground.draw(state, size)
            self.reference_progress = 1.0
            return Picture(self._ground.texture), None
        subject = state.subject
        image = state.reference_image
        if subject is Subject.AGAINST:
            return self._against_pair(state, size)
        of_fit, of_reference = self._background_textures(state, size, image)
        self.reference_progress = 1.0
        if image is not None and subject is Subject.FIT:
            front = self._integral(state, size, image, of_lobes=True)
        else:
            front = self._own_front(state, size)
        fit = Picture(front, of_fit)
        if state.shown is Comparison.FIT:
            return fit, None
        if image is None or not self._screens.displayed:
            # The first picture does not wait for the reference's shader.
            if image is not None:
                self.reference_progress = 0.0
            return fit, Picture(self._blank, self._blank)
        of_lobes = subject is Subject.SHADING
        reference = self._integral(state, size, image, of_lobes=of_lobes)
        return fit, Picture(reference, of_fit if of_lobes else of_reference)

    def _against_pair(
        self, state: ViewerState, size: tuple[int, int]
    ) -> tuple[Picture, Picture | None]:
        """Bring the balls of A and of B up to date, and those of the HDRI, the truth of both."""
        image = state.reference_image
        of_fit, of_reference = self._background_textures(state, size, image)
        self.reference_progress = 1.0
        own = self._own_front(state, size)
        if state.references is not None:
            front = self._blank
            if image is not None and self._screens.displayed:
                front = self._integral(state, size, image, of_lobes=False)
            elif image is not None:  # as in `_pair`
                self.reference_progress = 0.0
            self._truth = Picture(front, of_reference)
        return Picture(own, of_fit), self._of_b.balls(state, size)

    def _own_front(self, state: ViewerState, size: tuple[int, int]) -> moderngl.Texture:
        """Bring the balls under the lights that are edited up to date."""
        if state.keyed is not None:
            return self._of_keys(state, size)
        self._closed_form.draw(state, size)
        return self._closed_form.texture

    @property
    def _of_b(self) -> AgainstLayers:
        """The layers of B, made when they are first needed."""
        if self._against is None:
            self._against = AgainstLayers(self._context, self._albedo_table)
        return self._against

    @property
    def _of_b_versions(self) -> tuple[int, ...]:
        return () if self._against is None else self._against.versions

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
        latlong = self._lit_map if of_lobes else self._reference_map
        layer.draw(state, image, latlong, name, size)
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

    def _versions(self) -> tuple[int, ...]:
        keyed = () if self._keyed_balls is None else (self._keyed_balls,)
        layers = (self._closed_form, *keyed, self._ground, *self._backgrounds)
        versions = (layer.version for layer in (*layers, *self._integrals.values()))
        return *versions, *self._of_b_versions
