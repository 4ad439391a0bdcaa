# SPDX-License-Identifier: Apache-2.0
"""Stress cases of a few frames: what a shot may do from one frame to the next."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from asglight.judging.stress import maps
from asglight.judging.stress.case import Case, Group
from asglight.judging.stress.maps import lobe, render, sun_and_sky, together, toward


def _shot(name: str, holds: str, frames: Callable[[], list[Tensor]]) -> Case:
    return Case(name, Group.TIME, holds, frames)


def _lamp(places: Sequence[tuple[float, float]]) -> list[Tensor]:
    """Return a lamp of 3 degrees under a dim sky, at a longitude and latitude each frame."""
    sky = lobe((0.0, 1.0, 0.1), 1.0, 0.2)
    return [render(together(sky, lobe(toward(*place), 1e3, 300.0))) for place in places]


def _flash() -> list[Tensor]:
    day = sun_and_sky()
    return [day, day * 1.01, day + maps.texel(30, 90, 5e4), day * 1.01, day]


def _cut() -> list[Tensor]:
    room = maps.rectangle((0, 30), (-120, -60), 5.0, 0.2)
    return [sun_and_sky(), sun_and_sky() * 1.01, room, room * 1.01]


def _strobe() -> list[Tensor]:
    return [sun_and_sky() * (k % 2) for k in range(5)]


def _strobe_lamp() -> list[Tensor]:
    lamp = maps.rectangle((0, 10), (-100, -90), 1e3)
    return [sun_and_sky() + lamp * (k % 2) for k in range(6)]


def _exposure(stops: float) -> list[Tensor]:
    day, after = sun_and_sky(), sun_and_sky() * 2.0**stops
    return [day, day * 1.01, after, after * 1.01]


def _turn() -> list[Tensor]:
    day = sun_and_sky()
    return [day, maps.panned(day, 1), maps.panned(day, 181), maps.panned(day, 182)]


def _spin() -> list[Tensor]:
    return [maps.panned(sun_and_sky(), 45.0 * k) for k in range(3)]


def _fade() -> list[Tensor]:
    return [sun_and_sky() * 10.0**-k for k in (0, 3, 6, 3, 0)]


def _black_between() -> list[Tensor]:
    return [sun_and_sky(), maps.constant(0.0), sun_and_sky()]


def _colours() -> list[Tensor]:
    return [sun_and_sky() * (0.01 + torch.eye(3)[k]) for k in range(3)]


def _grain() -> list[Tensor]:
    return [sun_and_sky() * (0.8 + 0.4 * maps.noise(seed=k)) for k in range(4)]


TIME = (
    _shot("flash", "a lamp for one frame of 5", _flash),
    _shot("cut", "outside, then a room", _cut),
    _shot("strobe", "all light off and on, 5 frames", _strobe),
    _shot("strobe-lamp", "a lamp off and on, 6 frames", _strobe_lamp),
    _shot("frozen", "the same frame 4 times", lambda: [sun_and_sky()] * 4),
    _shot("grain", "new grain of 20 % each frame", _grain),
    _shot(
        "pole-crossing",
        "a lamp goes over the pole, 6 degrees a frame",
        lambda: _lamp([(40, 80), (40, 86), (220, 88), (220, 82), (220, 76)]),
    ),
    _shot(
        "seam-crossing",
        "a lamp goes over the seam, 6 degrees a frame",
        lambda: _lamp([(170 + 6 * k, 20) for k in range(5)]),
    ),
    _shot("stops-up", "20 stops brighter in a frame", lambda: _exposure(20)),
    _shot("stops-down", "20 stops darker in a frame", lambda: _exposure(-20)),
    _shot("turn-180", "the camera turns by 180 degrees in a frame", _turn),
    _shot("spin-45", "the camera turns by 45 degrees a frame", _spin),
    _shot(
        "lamp-jump",
        "a lamp jumps by 90 degrees",
        lambda: _lamp([(0, 30), (1, 30), (91, 30), (92, 30)]),
    ),
    _shot("fade", "down by 1e6 and up again", _fade),
    _shot("black-between", "a black frame in a shot", _black_between),
    _shot("colours", "red, green, blue light", _colours),
)
