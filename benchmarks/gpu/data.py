# SPDX-License-Identifier: Apache-2.0
"""Maps and shots to measure on: real ones where they are at hand, made up ones elsewhere."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.lobes import Lobes, texels
from asglight.lobes.frames import axes_around, axes_from_quaternion
from benchmarks.gpu.rows import Given

ROWS, SHOT_ROWS, SHORT_ROWS = 256, 128, 16
"""Of maps as the fit works on them, of a shot, and of both in a short run."""

MADE_UP = 8
"""Maps that are made up; more are made of these."""


def maps(given: Given) -> dict[str, Tensor]:
    """Return maps by name.  [H, 2 H, 3] each."""
    rows = SHORT_ROWS if given.short else ROWS
    found = {} if given.short else dict(_read(given))
    return found or {f"made up {seed}": room(seed, rows) for seed in range(MADE_UP)}


def _read(given: Given) -> Iterator[tuple[str, Tensor]]:
    """Yield the maps of the folder; none where it is missing, or what reads images is."""
    try:
        from asglight.images import read_latlong
    except ImportError:
        return
    for path in sorted(given.maps.glob("*.exr")):
        yield path.stem, read_latlong(path, height=ROWS).radiance


def room(seed: int, rows: int, turned: float = 0.0) -> Tensor:
    """Return a map of a sky and a few lamps of all widths.  [H, 2 H, 3].

    Args:
        seed: Of their places.
        rows: H.
        turned: Degrees by which every second lamp has gone about the vertical.
    """
    lobes = lamps(12, seed)
    angle = math.radians(turned)
    about = torch.tensor(
        [
            [math.cos(angle), 0.0, math.sin(angle)],
            [0.0, 1.0, 0.0],
            [-math.sin(angle), 0.0, math.cos(angle)],
        ]
    )
    axes = lobes.axes.clone()
    axes[1::2] = axes[1::2] @ about.mT
    moved = Lobes(axes, lobes.sharpness, lobes.amplitude, lobes.form)
    return texels.texel_means(moved, rows, 2 * rows).float() + 0.05


def lamps(count: int, seed: int) -> Lobes:
    """Return lobes, the first a sky, from wide to narrow.  [N, .]."""
    generator = torch.Generator().manual_seed(seed)
    axes = axes_from_quaternion(torch.randn(count, 4, generator=generator))
    axes[0] = axes_around(torch.tensor([0.0, 1.0, 0.0]))
    wide = torch.logspace(-0.3, 3.3, count)[:, None]
    sharpness = wide * (1 + torch.rand(count, 2, generator=generator))
    light = 0.3 + torch.rand(count, 3, generator=generator)
    return Lobes(axes, sharpness, light * wide.sqrt())


def stills(given: Given, count: int) -> list[Tensor]:
    """Return maps no two of which are alike: two of `maps` turned, tinted and added up.

    Args:
        given: Where maps are.
        count: How many.
    """
    sources = list(maps(given).values())
    generator = torch.Generator().manual_seed(0)
    found = []
    for index in range(count):
        one, other = (sources[k % len(sources)] for k in (index, index // len(sources) + index + 1))
        turns = torch.randint(0, one.shape[1], (2,), generator=generator).tolist()
        tint = 0.5 + torch.rand(2, 3, generator=generator)
        found.append(tint[0] * one.roll(turns[0], 1) + 0.5 * tint[1] * other.roll(turns[1], 1))
    return found


def shot(given: Given, count: int) -> list[Tensor]:
    """Return frames of a shot: those of the sequence there and back, or lamps that go about.

    Frames of the sequence are turned by one texel more each, so that none is met twice.

    Args:
        given: Where the sequence is.
        count: How many.
    """
    frames = [] if given.short else _sequence(given)
    if not frames:
        rows = SHORT_ROWS if given.short else SHOT_ROWS
        return [room(0, rows, turned=1.5 * frame) for frame in range(count)]
    way = [*frames, *frames[-2:0:-1]]
    return [way[k % len(way)].roll(k, 1) for k in range(count)]


def _sequence(given: Given) -> list[Tensor]:
    try:
        from asglight.images import open_sequence

        sequence = open_sequence(given.sequence)
        return [sequence.read(frame).radiance for frame in sequence.frames]
    except (ImportError, InputError):
        return []
