# SPDX-License-Identifier: Apache-2.0
"""A picture of lobes for a notebook: the map with their outlines, and balls."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from asglight.arrays.light import Light, Time, balls, latlong
from asglight.errors import InputError
from asglight.judging.pictures import layout
from asglight.judging.pictures.display import ball_exposure_stops, view_transform
from asglight.judging.pictures.outlines import draw_lobes
from asglight.lobes import Lobes, LobeTracks, motion

MAP, BALL = (720, 360), 170
"""Pixels of the map and of a ball."""

STOPS_MAX = 150
"""Of an exposure. From the dimmest number of float32 to 1 are 149 stops, from 1 to the brightest
128: beyond, a picture is all white or all black."""

SHOWN: tuple[float | None, ...] = (0.1, 0.25, 0.5, None)
"""Roughness of the balls; the last one is matte, and sets the exposure."""


@dataclass(frozen=True)
class Picture:
    """A figure that a notebook shows by itself.

    Attributes:
        figure: For matplotlib, to be changed or saved.
    """

    figure: Figure

    def save(self, path: str | Path) -> None:
        """Write a PNG.

        Raises:
            InputError: It cannot be written there.
        """
        layout.save(self.figure, Path(path))

    def _repr_png_(self) -> bytes:
        """Return the PNG that a notebook shows."""
        stream = io.BytesIO()
        self.figure.savefig(stream, format="png", dpi=layout.DPI)
        return stream.getvalue()


def plot(light: Light, time: Time = None, *, exposure: float | None = None) -> Picture:
    """Draw lobes: their map with an outline around each, and balls from glossy to matte.

    Examples:
        >>> asglight.plot(tracks, 1001.5).save("tracks.png")

    Args:
        light: Tracks or lobes.
        time: When; one time.
        exposure: Stops; None brings the matte ball to a light grey.

    Raises:
        InputError: The time is missing, none, or several, or there is no such exposure.
    """
    if isinstance(time, np.generic | np.ndarray | torch.Tensor) and time.ndim == 0:
        time = time.item()
    if time is not None and not isinstance(time, int | float):
        raise InputError(f"time: {time}; expected one time for a picture.")
    if exposure is not None and not abs(exposure) <= STOPS_MAX:
        raise InputError(f"exposure: {exposure:g}; expected {-STOPS_MAX} to {STOPS_MAX} stops.")
    with torch.no_grad():
        row = balls(light, time, roughness=SHOWN, size=BALL).cpu().float()
        radiance = latlong(light, MAP[1], time).cpu().float()
        lobes = _lobes(light, time)
    stops = ball_exposure_stops(row[None]) if exposure is None else exposure
    margin, gap, head = 24, 14, 76
    height = head + MAP[1] + gap + BALL + 44
    figure = layout.sheet(MAP[0] + 2 * margin, height, _title(light, time), f"{stops:+.1f} stops")
    grid = layout.Grid(figure, left=margin, top=head, cell=MAP, step=MAP)
    axes = grid.axes(0, 0)
    axes.imshow(view_transform(radiance, stops), extent=(0, 1, 1, 0), aspect="auto")
    draw_lobes(axes, lobes)
    step = (MAP[0] - len(SHOWN) * BALL) // (len(SHOWN) - 1) + BALL
    below = head + MAP[1] + gap
    cells = layout.Grid(figure, left=margin, top=below, cell=(BALL, BALL), step=(step, BALL))
    for place, (roughness, ball) in enumerate(zip(SHOWN, row, strict=True)):
        cells.axes(0, place).imshow(view_transform(ball, stops))
        name = "matte" if roughness is None else f"roughness {roughness:g}"
        cells.caption(0, place, name, centred=True)
    return Picture(figure)


def _lobes(light: Light, time: float | None) -> Lobes:
    """Return the lobes of a time, float32 on the CPU.  [N, .]."""
    if isinstance(light, LobeTracks):
        light = motion.at(light, [light.frames[0] if time is None else time])[0]
    return light.to("cpu", torch.float32)


def _title(light: Light, time: float | None) -> str:
    if isinstance(light, Lobes):
        return f"{light.count} lobes"
    when = light.frames[0] if time is None else time
    return f"{light.lobes.count} lobes, frame {when:g}"
