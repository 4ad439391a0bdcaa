# SPDX-License-Identifier: Apache-2.0
"""The balls over time as files: PNG or EXR images, or an MP4; frame by frame, or as a turntable.

One step draws a little, so that a window can go on being a window; off screen steps follow one
another. A picture is written when its lobes and its reference are there and the reference has
gathered the samples that a screenshot waits for.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from asglight.errors import InputError
from asglight.images.exr_writer import write_exr
from asglight.viewer.gl.arrangement import cells, strip
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.io.film import Film
from asglight.viewer.io.inputs import check_apart
from asglight.viewer.io.saving import display_pixels, write_png
from asglight.viewer.io.wanted import Wanted
from asglight.viewer.state.compared.titles import titles
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.session import Session
from asglight.viewer.state.views import Scene

SAMPLED = 0.25
"""Share of a finished reference that a picture waits for: half of its noise is below a step of 8
bits."""


class Rendering:
    """Pictures that are being written.

    Attributes:
        count: How many there will be.
        done: How many are written.
    """

    def __init__(self, session: Session, renderer: Renderer, wanted: Wanted) -> None:
        """Begin; the playhead and the environment go along and come back at the end.

        Args:
            session: What to render.
            renderer: Draws it, and nothing else.
            wanted: What to write.

        Raises:
            InputError: It cannot be written, or would replace what the session is read from.
        """
        self._session, self._renderer, self._wanted = session, renderer, wanted
        state = session.state
        state.playback.pause()
        self._before = state.playback.time, state.camera.environment_deg
        self._steps = _frames(session)
        if wanted.turntable is not None:
            self._steps = _turns(wanted.turntable, state.camera.environment_deg)
        self.count, self.done = len(self._steps), 0
        wanted.check(self.count)
        is_film = wanted.path.suffix.lower() == ".mp4"
        targets = [wanted.path] if is_film else [wanted.file(step[0]) for step in self._steps]
        check_apart(session, targets)
        self._film = Film(wanted.path, wanted.size, state.playback.fps) if is_film else None

    def step(self) -> bool:
        """Draw a little; return whether all is written.

        Raises:
            InputError: A file cannot be written, or an image or a lobe cannot be had.
        """
        if self.done == self.count:
            return True
        session, state = self._session, self._session.state
        number, place = self._steps[self.done]
        state.playback.pause()
        place(session)
        status = session.update()
        if status.failure is not None:
            raise InputError(status.failure)
        if not state.is_fitted and not status.is_finished:
            return False
        if not session.check_images():
            return False
        is_dragging, state.is_dragging = state.is_dragging, False  # else it were a preview
        try:
            target = self._renderer.balls(state, self._wanted.size)
        finally:
            state.is_dragging = is_dragging
        if self._renderer.reference_progress < SAMPLED:
            return False
        self._write(number, target)
        self.done += 1
        if self.done == self.count:
            self.close()
        return self.done == self.count

    def close(self) -> None:
        """End the film, and go back to where the playhead was."""
        state = self._session.state
        time, degrees = self._before
        state.playback.go_to_time(time)
        state.camera.environment_deg = degrees
        if self._film is None:
            return
        film, self._film = self._film, None
        film.close(is_whole=self.done == self.count)

    def _write(self, number: int, target: Any) -> None:
        state, wanted = self._session.state, self._wanted
        path = wanted.file(number)
        if path.suffix.lower() == ".exr":
            radiance = torch.from_numpy(self._renderer.radiance(state))
            write_exr(path, radiance, latlong=False)
            return
        pixels = display_pixels(target)
        if wanted.is_labelled:
            pixels = labelled(pixels, self._session)
        if self._film is None:
            write_png(path, pixels)
        else:
            self._film.add(pixels)


def labelled(pixels: np.ndarray, session: Session) -> np.ndarray:
    """Write into a picture what it shows.

    Args:
        pixels: sRGB, 8 bits; it stays as it is.  [H, W, 3]
        session: What was rendered.

    Returns:
        The picture with its labels.  [H, W, 3]
    """
    state = session.state
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    height, width = pixels.shape[:2]
    is_rows = state.shown is Comparison.ROWS
    first, rows = strip(height, state.parts)
    arrangement = cells((width, rows), len(state.balls))
    font = ImageFont.load_default(max(10, round(height / 45)))

    def write(place: tuple[float, float], text: str, anchor: str) -> None:
        draw.text(place, text, "white", font, anchor, stroke_width=1, stroke_fill="black")

    tops = [part * rows for part in range(state.parts)] if is_rows else [first]
    for top in tops if state.scene is Scene.BALLS else ():
        for cell, ball in zip(arrangement, state.balls, strict=True):
            below = min(top + cell.y + cell.size + 2, top + rows - font.size - 4)
            write((cell.x + cell.size / 2, below), ball.name, "ma")
    fit, reference, truth = titles(state)
    if is_rows:
        for top, title in zip(tops[1:], (reference, truth), strict=False):
            write((8, top + 6), title, "la")
    names = {Comparison.REFERENCE: reference, Comparison.FIT: fit}
    title = names.get(state.shown, fit if is_rows else str(state.shown))
    write((8, 6), f"{session.title}   {title}", "la")
    exposure = state.display.exposure_ev + state.environment.intensity_ev
    text = f"{state.playback.time:g}   {state.display.name} {exposure:+.1f} EV"
    write((width - 8, 6), text, "ra")
    return np.asarray(image)


def _frames(session: Session) -> list[tuple[int, Callable[[Session], None]]]:
    """Return the frames from the in to the out point, and how to go to each."""
    playback = session.state.playback
    chosen = playback.frames[playback.first : playback.last + 1]
    return [(frame, _go_to(frame)) for frame in chosen]


def _go_to(frame: int) -> Callable[[Session], None]:
    return lambda session: session.state.playback.go_to(frame)


def _turns(count: int, start_deg: float) -> list[tuple[int, Callable[[Session], None]]]:
    """Return the pictures of one turn, numbered from 1: the last is a step before the first."""

    def turned(index: int) -> Callable[[Session], None]:
        def _place(session: Session) -> None:
            degrees = math.remainder(start_deg + index * 360 / count, 360)
            session.state.camera.environment_deg = degrees

        return _place

    return [(index + 1, turned(index)) for index in range(count)]
