# SPDX-License-Identifier: Apache-2.0
"""Radiance that the renderer keeps from picture to picture, each drawn anew only when it must be.

A layer has a version that counts what it drew: whoever uses its texture compares versions.
"""

from collections.abc import Hashable
from typing import Any

import moderngl
import numpy as np

from asglight.lobes import Lobes
from asglight.lobes.texels import texel_means
from asglight.shading import ball_tables
from asglight.shading.ball_tables import CameraMap
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.ground_pass import GroundPass
from asglight.viewer.gl.passes import (
    BackgroundPass,
    LobesPass,
    radiance_target,
    target_texture,
)
from asglight.viewer.gl.reference.reference_cache import ReferenceCache
from asglight.viewer.gl.reference.reference_pass import ReferencePass
from asglight.viewer.gl.reference.smooth_balls import SmoothBalls, is_exact, is_tabled
from asglight.viewer.reference.reference_map import levels
from asglight.viewer.state.compared.against import Lit
from asglight.viewer.state.held import Held
from asglight.viewer.state.shown import shown_lobes
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.uniforms.map_lobes import widened

MAP_ROWS = 256
"""Rows of the lobes' map: as many as the panel shows; half of them while something moves."""

LIT_ROWS = 512
"""Rows of the map that stands for the lobes in their integral: a texel of a third of a degree, as
the sun is half a one wide."""

TEXEL_SAMPLES_AT_ONCE = 4_000_000
"""Samples of all pixels together that the reference gains between two pictures of the window: a
twelfth of a second on two cores without a GPU, which the eye still takes for continuous. With five
eighths of it a reference at rest takes 3.3 s and not 3.0 (benchmarks/shaded/window.py)."""

SAMPLES_LEAST, SAMPLES_MOST = 4, 64
"""Samples of a pixel between two pictures however large they are, when fewer would take for ever,
and however small."""

KEPT_SAMPLES = 64
"""A picture of fewer is as quickly made again, and noisier than one without samples."""

CACHE_BYTES = 1 << 28
"""Memory for pictures of the reference: 80 of 1,000 x 200 pixels."""


class Layer:
    """A radiance target that is drawn when its key changes."""

    def __init__(self, context: moderngl.Context) -> None:
        """Start empty."""
        self._context = context
        self._target = radiance_target(context, (1, 1))
        self._key: Any = None
        self.version = 0

    @property
    def texture(self) -> moderngl.Texture:
        """What was drawn last."""
        return target_texture(self._target)

    def needs(self, key: Any, size: tuple[int, int]) -> bool:
        """Tell whether a picture is another one than that drawn last, and make room for it.

        Args:
            key: Everything that the picture depends on but its size; large things as `Held`.
            size: Columns and rows.
        """
        if self._target.size != size:
            self._target, self._key = radiance_target(self._context, size), None
        if self._key == key:
            return False
        self._key = key
        self.version += 1
        return True


def camera_key(state: Lit) -> tuple[float, ...]:
    """Return what a rotation depends on."""
    camera = state.camera
    return camera.yaw_deg, camera.pitch_deg, camera.environment_deg


def lobes_key(state: Lit) -> tuple[Any, ...]:
    """Return what the light depends on."""
    return Held(state.tracks), state.playback.time, state.lit


class ClosedForm(Layer):
    """Balls lit by the lobes, by the closed forms."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the pass."""
        super().__init__(context)
        self._pass = BallsPass(context, albedo_table)

    def draw(self, state: Lit, size: tuple[int, int]) -> None:
        """Bring the layer up to date."""
        balls = state.balls
        if self.needs((lobes_key(state), camera_key(state), balls), size):
            self._target.use()
            self._target.clear()
            arrangement = cells(size, len(balls))
            rotation = state.camera.from_environment()
            self._pass.draw(state.lit_lobes, balls, rotation, arrangement, self._target)


class Ground(Layer):
    """A ball and a post on the ground, lit by the lobes; of a keyed stage too, by all of them."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the passes."""
        super().__init__(context)
        self._pass = GroundPass(context, BallsPass(context, albedo_table))

    def draw(self, state: ViewerState, size: tuple[int, int]) -> None:
        """Bring the layer up to date."""
        ball = state.balls[state.ground_ball]
        if self.needs((lobes_key(state), camera_key(state), ball), size):
            lobes, playback = state.lit_lobes, state.playback
            if state.keyed is not None:
                lobes = shown_lobes(Held(state.keyed.lobes), playback.index, playback.part)
            self._pass.draw(lobes, ball, state.camera, self._target)


class LobesMap(Layer):
    """The lobes as a latlong map."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        super().__init__(context)
        self._pass = LobesPass(context)

    def draw(self, state: Lit) -> None:
        """Bring the layer up to date."""
        rows = MAP_ROWS // 2 if state.is_moving else MAP_ROWS
        if self.needs(lobes_key(state), (2 * rows, rows)):
            self._pass.draw(widened(state.lit_lobes, rows), self._target)
            _wraps(self.texture)


class Background(Layer):
    """A map behind the balls."""

    def __init__(self, context: moderngl.Context, background_pass: BackgroundPass) -> None:
        """Take the pass, which several backgrounds share."""
        super().__init__(context)
        self._pass = background_pass

    def draw(
        self, state: Lit, latlong: moderngl.Texture, version: int, size: tuple[int, int]
    ) -> None:
        """Bring the layer up to date with a map and its version."""
        if self.needs((Held(latlong), version, camera_key(state)), size):
            self._pass.draw(latlong, state.camera.from_environment(), self._target)


class ReferenceMap:
    """The reference as a texture: front of the map panel, and background."""

    def __init__(self, context: moderngl.Context) -> None:
        """Start black."""
        self._context = context
        self._image: np.ndarray | None = None
        self._texture = context.texture((2, 1), 4, np.zeros(8, "f4").tobytes(), dtype="f4")
        self.version = 0

    @property
    def texture(self) -> moderngl.Texture:
        """The map, alpha 1."""
        return self._texture

    def upload(self, image: np.ndarray) -> None:
        """Take an image, float32 [H, W, 3], if it is another one."""
        if image is self._image:
            return
        height, width, _ = image.shape
        if self._texture.size != (width, height):
            self._texture = self._context.texture((width, height), 4, dtype="f4")
        opaque = np.ones((height, width, 4), np.float32)
        opaque[..., :3] = image
        self._texture.write(opaque.tobytes())
        _wraps(self._texture)
        self._image = image
        self.version += 1

    def filter_levels(self) -> None:
        """Make the map's levels, means over solid angles, and filter between them from now on."""
        assert self._image is not None  # upload comes first
        opaque = np.ones((*self._image.shape[:2], 4), np.float32)
        opaque[..., :3] = self._image
        coarser = levels(opaque)[1:]
        self._texture.build_mipmaps(0, len(coarser))  # the room; what it holds is written anew
        for level, values in enumerate(coarser, start=1):
            self._texture.write(values.tobytes(), level=level)
        self._texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR

    def filter_linearly(self) -> None:
        """Leave the levels out again."""
        _wraps(self._texture)


class Preview(Layer):
    """Balls lit by a map without samples: rough ones from tables, others from the map's levels."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the pass."""
        super().__init__(context)
        self._pass = SmoothBalls(context, albedo_table)

    def draw(
        self,
        state: ViewerState,
        image: np.ndarray,
        latlong: ReferenceMap,
        name: Hashable,
        size: tuple[int, int],
    ) -> None:
        """Bring the layer up to date; arguments as of `Integral.draw`."""
        balls = state.balls
        if not self.needs((name, camera_key(state), balls), size):
            return
        rotation = state.camera.from_environment()
        seen = CameraMap(image, rotation)
        coarse = ball_tables.COARSE
        cosines = seen.shown(ball_tables.cosines(coarse), coarse)
        irradiance = self._pass.table(cosines.numpy())
        latlong.upload(image)
        latlong.filter_levels()
        self._target.use()
        self._target.clear()
        for ball, cell in zip(balls, cells(size, len(balls)), strict=True):
            if is_tabled(ball):
                shown = ball_tables.ball(seen, ball.roughness, ball.f0, ball.albedo)
                self._pass.draw_table(self._pass.table(shown), cell, self._target)
            else:
                self._pass.draw_levels(
                    ball, latlong.texture, irradiance, rotation, cell, self._target
                )
        latlong.filter_linearly()


class Integral:
    """Balls lit by a map, by the integral over it, a few samples with every picture.

    While something moves, and until there are samples enough, it is a preview that has no noise.
    """

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the pass."""
        self._pass = ReferencePass(context, albedo_table)
        self._preview = Preview(context, albedo_table)
        self._is_preview = True
        self._cache = ReferenceCache(CACHE_BYTES)
        self._image: np.ndarray | None = None
        self._key: Hashable = None
        self._sampled = 0
        self.progress = 0.0

    @property
    def version(self) -> int:
        """Counts what was drawn."""
        return self._sampled + self._preview.version

    @property
    def texture(self) -> moderngl.Texture:
        """The picture so far."""
        return self._preview.texture if self._is_preview else self._pass.texture

    @property
    def samples(self) -> int:
        """Samples of each pixel in the picture so far."""
        return self._pass.samples

    def draw(
        self,
        state: ViewerState,
        image: np.ndarray,
        latlong: ReferenceMap,
        name: Hashable,
        size: tuple[int, int],
    ) -> None:
        """Bring the picture of a map up to date, or add samples to it.

        `progress` is the share of the samples that make a finished picture; in motion there are
        none.

        Args:
            state: The session.
            image: The map.  [H, W, 3]
            latlong: Its texture, which takes the image where it is needed.
            name: What tells it from other maps, now and later.
            size: Columns and rows.
        """
        self._is_preview = state.is_moving
        self.progress = 1.0
        if not state.is_moving:
            self._sample(state, image, name, size)
            self._is_preview = self._pass.samples < KEPT_SAMPLES
            self.progress = self._pass.samples / self._pass.target_samples
        if self._is_preview:
            self._preview.draw(state, image, latlong, name, size)

    def _sample(
        self, state: ViewerState, image: np.ndarray, name: Hashable, size: tuple[int, int]
    ) -> None:
        """Add samples to the picture of a map."""
        if image is not self._image:
            self._pass.set_map(image)
            self._image = image
        key = (name, camera_key(state), state.balls, size)
        if key != self._key:
            self._turn_to(key, state, size)
        before = self._pass.samples
        sampled = [
            cell.size**2
            for ball, cell in zip(state.balls, cells(size, len(state.balls)), strict=True)
            if not is_exact(ball)
        ]
        wanted = TEXEL_SAMPLES_AT_ONCE // max(sum(sampled), 1)
        self._pass.accumulate(min(max(wanted, SAMPLES_LEAST), SAMPLES_MOST))
        self._sampled += self._pass.samples != before

    def _turn_to(self, key: Hashable, state: ViewerState, size: tuple[int, int]) -> None:
        """Put the picture away and go on with another, which may be a new one."""
        if self._key is not None:
            worth_keeping = self._pass.samples >= KEPT_SAMPLES
            put_away = self._pass.detach()
            assert put_away is not None
            if worth_keeping:
                self._cache.put(self._key, put_away)
        found = self._cache.take(key)
        if found is not None:
            self._pass.resume(found)
        else:
            rotation = state.camera.from_environment()
            self._pass.restart(state.balls, rotation, cells(size, len(state.balls)), size)
        self._key = key
        self._sampled += 1


def _wraps(texture: moderngl.Texture) -> None:
    """Filter a latlong map as what it is: closed in columns, ended in rows."""
    texture.filter = moderngl.LINEAR, moderngl.LINEAR
    texture.repeat_x, texture.repeat_y = True, False


def lit_map(lobes: Lobes) -> np.ndarray:
    """Return the lobes' texel means on a grid fine enough for their integral.  [H, W, 3]."""
    return texel_means(lobes, LIT_ROWS, 2 * LIT_ROWS).numpy()
