# SPDX-License-Identifier: Apache-2.0
"""What changes too hard to be followed: the presets beside fits from nothing, change by change.

    python -m benchmarks.shots.hard_changes --maps ../shared/hdri

Each change is made to each map of the folder, on 128 rows, over 9 frames. Errors are those of
asglight.fitting.loss.measures, within 1 % of the judge's, in the mean over maps and frames; worst
is the r0.5 of the worst frame of all, and flicker is taken of what r0.5 shows. `afresh` is `fast`
on every frame from nothing, which nothing holds.
"""

import math
import statistics
from collections.abc import Callable, Iterator, Sequence

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from asglight.fitting.loss import measures
from asglight.fitting.options import LOBES, FitOptions, Preset
from asglight.judging.following import follow
from asglight.sphere import latlong
from benchmarks.fits.unseen import turned
from benchmarks.given import maps_given
from benchmarks.shots.turned import Shot, measured

ROWS = 128
FRAMES = 9

LAMP_DEG = 6.0
"""Across the disc of a lamp that is added."""

LAMP_FLUX = 0.25
"""Of a lamp that is added, over that of the map."""

HAND_DEG = 1.0
"""Standard deviation of each angle by which a camera in the hand turns in a frame."""

Change = Callable[[Tensor, Tensor], list[Tensor]]
"""Makes a sequence of a map and of the next one in the folder."""


def turning_lamp(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Add a lamp that turns by 20 degrees a frame."""
    return [radiance + lamp(radiance, 20.0 * frame) for frame in range(FRAMES)]


def switched_lamps(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Add three lamps that are on for two, three and four frames, and off as long."""
    places = {2: 10.0, 3: 130.0, 4: 250.0}
    return [
        radiance + sum(lamp(radiance, at) for every, at in places.items() if frame // every % 2)
        for frame in range(FRAMES)
    ]


def half_off(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Dim one half of the map to a fiftieth for three frames, light it for three, and again."""
    dim = torch.ones(ROWS, 2 * ROWS, 1)
    dim[:, :ROWS] = 0.02
    return [radiance * dim if frame // 3 % 2 else radiance for frame in range(FRAMES)]


def cuts(radiance: Tensor, other: Tensor) -> list[Tensor]:
    """Cut to the next map and back, three frames each."""
    return [other if frame // 3 % 2 else radiance for frame in range(FRAMES)]


def whip_pan(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Turn the map by 20 degrees a frame for five frames, then hold it."""
    step = round(2 * ROWS * 20 / 360)
    return [radiance.roll(step * min(frame, 5), dims=1) for frame in range(FRAMES)]


def walk(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Walk through the map as if it were painted on a ball, from -.6 of its radius to .6."""
    ways = torch.linspace(-0.6, 0.6, FRAMES).tolist()
    return [seen_from(radiance, way) for way in ways]


def in_the_hand(radiance: Tensor, _: Tensor) -> list[Tensor]:
    """Turn the map as a camera in the hand does, by some `HAND_DEG` about each axis a frame."""
    generator = torch.Generator().manual_seed(FRAMES)
    turns = torch.randn(FRAMES, 3, generator=generator, dtype=torch.float64).cumsum(0)
    angles = (HAND_DEG * turns).tolist()
    axes = [Rotation.from_euler("yxz", each, degrees=True).as_matrix() for each in angles]
    return [turned(radiance, torch.from_numpy(each)) for each in axes]


CHANGES: dict[str, Change] = {
    "a lamp turns by 20 degrees a frame": turning_lamp,
    "three lamps are switched on and off": switched_lamps,
    "half of the map is switched off and on": half_off,
    "hard cuts": cuts,
    "a whip pan, 20 degrees a frame": whip_pan,
    "a walk through the map": walk,
    "a camera in the hand, 1 degree a frame": in_the_hand,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Make every change to every map, print a table."""
    maps = [
        latlong.reduce(each, ROWS, 2 * ROWS)
        for each in maps_given("hard_changes", __doc__, argv).values()
    ]
    print(HEAD)
    for name, change in CHANGES.items():
        shots = [change(*pair) for pair in zip(maps, [*maps[1:], maps[0]], strict=True)]
        for row in rows(name, shots):
            print(row, flush=True)
    return 0


def lamp(radiance: Tensor, longitude_deg: float) -> Tensor:
    """Return a disc of light, 30 degrees above the horizon.  [H, 2 H, 3]."""
    height, fine = radiance.shape[0], 4
    around, up = math.radians(longitude_deg), math.radians(30.0)
    centre = torch.tensor(
        [math.cos(up) * math.sin(around), math.sin(up), math.cos(up) * math.cos(around)]
    )
    inside = latlong.directions(fine * height, 2 * fine * height) @ centre > math.cos(
        math.radians(LAMP_DEG / 2)
    )
    disc = latlong.reduce(inside[..., None].float(), height, 2 * height)
    areas = latlong.texel_solid_angles(height, 2 * height)[..., None]
    flux = (areas * radiance).sum((0, 1))
    return LAMP_FLUX * flux * disc / (areas * disc).sum()


def seen_from(radiance: Tensor, way: float) -> Tensor:
    """Return what is seen from a place inside a unit ball on which the map is painted.

    Args:
        radiance: Seen from its centre.  [H, 2 H, 3]
        way: Along x, from -1 to 1.
    """
    height = radiance.shape[0]
    sight = latlong.directions(height, 2 * height, dtype=torch.float64)
    along = way * sight[..., 0]
    reach = -along + (along.square() + 1 - way**2).sqrt()  # |place + reach sight| = 1
    hit = reach[..., None] * sight + torch.tensor([way, 0.0, 0.0], dtype=torch.float64)
    u, v = latlong.uv_from_direction(hit)
    column = (u * 2 * height).long() % (2 * height)
    row = (v * height).long().clamp(max=height - 1)
    return radiance[row, column]


def rows(name: str, shots: list[list[Tensor]]) -> Iterator[str]:
    """Follow sequences in each way, return a row each.

    Args:
        name: Of the change.
        shots: The sequences.
    """
    for preset in (Preset.LIVE, Preset.FAST, Preset.BEST):
        found = [measured(maps, FitOptions(LOBES, preset)) for maps in shots]
        yield row(name, preset.value, found)
    yield row(name, "afresh", [_afresh(maps) for maps in shots])


def _afresh(maps: list[Tensor]) -> Shot:
    found, _ = follow(maps, FitOptions(LOBES), fresh=True)
    errors = [measures.errors(*pair) for pair in zip(found, map(measures.shown, maps), strict=True)]
    irr, rough = ([each[of] for each in errors] for of in ("irr", "r0.5"))
    return Shot(irr, rough, math.nan, math.nan)


HEAD = "| change | fit | irr | r0.5 | worst r0.5 | flicker |\n|---|---|" + "--:|" * 4


def row(name: str, fit: str, found: list[Shot]) -> str:
    """Return a row of the table.

    Args:
        name: Of the change.
        fit: How it was followed.
        found: What was measured of each sequence.
    """
    irr = statistics.fmean(error for shot in found for error in shot.irr)
    rough = [error for shot in found for error in shot.rough]
    flicker = statistics.fmean(shot.flicker for shot in found)
    shown = "–" if math.isnan(flicker) else f"{flicker:.4f}"
    errors = f"{irr:.4f} | {statistics.fmean(rough):.4f} | {max(rough):.3f}"
    return f"| {name} | {fit} | {errors} | {shown} |"


if __name__ == "__main__":
    raise SystemExit(main())
