# SPDX-License-Identifier: Apache-2.0
"""Paths of lamps, from maps that are drawn texel by texel with lamps of known paths."""

import functools
import math

import numpy as np
import pytest
import torch

from asglight.judging.motion import lamps
from asglight.lobes import Lobes, LobeTracks, asg, frames
from asglight.sphere import latlong

HEIGHT = 96
TEXEL = math.pi / HEIGHT

RADIUS = math.radians(4)


def overhead(angle_deg: float, tilt_deg: float = 0.0) -> np.ndarray:
    """Return a direction on a circle over the pole, which is tilted from it."""
    angle, tilt = np.radians([angle_deg, tilt_deg])
    return np.array(
        [math.sin(tilt), math.sin(angle) * math.cos(tilt), math.cos(angle) * math.cos(tilt)]
    )


def drawn(*centres: np.ndarray, power: float = 100.0) -> torch.Tensor:
    """Return a map with round lamps of one radiance on a dim ground; edges by eight samples."""
    fine = fine_directions()
    lit = torch.zeros(8 * HEIGHT, 16 * HEIGHT, dtype=torch.float64)
    for centre in centres:
        lit += (fine @ torch.from_numpy(centre) > math.cos(RADIUS)).double()
    grey = latlong.reduce(0.1 + power * lit[..., None], HEIGHT, 2 * HEIGHT)
    return grey.float().repeat(1, 1, 3)


@functools.cache
def fine_directions() -> torch.Tensor:
    return latlong.directions(8 * HEIGHT, 16 * HEIGHT).double()


def tracks_along(directions: list[np.ndarray], flux: np.ndarray) -> LobeTracks:
    """Return one lobe that points where it is told, of a flux."""
    axis_z = torch.from_numpy(np.stack(directions))[:, None]
    count = len(directions)
    unit = Lobes(
        frames.axes_around(axis_z),
        torch.full((count, 1, 2), 200.0).double(),
        torch.ones(count, 1, 3).double(),
    )
    amplitude = torch.from_numpy(flux)[:, None, None] / (3 * asg.integral(unit)[..., None])
    lobes = Lobes(unit.axes, unit.sharpness, amplitude.expand(-1, -1, 3))
    return LobeTracks(tuple(range(1, count + 1)), 24.0, lobes)


@pytest.fixture(scope="module")
def passing() -> tuple[list[torch.Tensor], list[list[np.ndarray]]]:
    """Return maps in which two lamps pass overhead, one after the other, and where they are."""
    angles = np.arange(20, 161, 10.0)
    first = [overhead(angle, 2) for angle in angles]
    second = [overhead(max(angle - 60, 5), -1) for angle in angles]
    maps = [drawn(*pair) for pair in zip(first, second, strict=True)]
    return maps, [first, second]


def test_paths_are_those_of_the_lamps_to_a_tenth_of_a_texel(passing) -> None:
    maps, known = passing
    found = lamps.passages(maps, 5)
    assert len(found) == 2
    for path in found:
        assert len(path.flux) == len(maps)
        apart = [
            np.arccos(np.clip(np.sum(np.stack(path.directions) * np.stack(one), -1), -1, 1)).max()
            for one in known
        ]
        assert min(apart) < 0.1 * TEXEL
    solid_angle = 2 * math.pi * (1 - math.cos(RADIUS))
    np.testing.assert_allclose(found[0].flux, 300 * solid_angle, rtol=0.02)
    # of a disc, the mean square of the distance is half the square of the radius; texels are means
    # over squares, and are squares, each of which adds a sixth of the square of their side
    of_disc = RADIUS**2 / 2
    assert min(found[0].width) > 0.999 * math.sqrt(of_disc)
    assert max(found[0].width) < 1.01 * math.sqrt(of_disc + TEXEL**2 / 3)


@pytest.mark.parametrize("centre", [(0, 1, 0), (0, -1, 0), (0, 0, -1), (0.02, 0.01, -1)])
def test_a_spot_on_a_pole_or_on_the_seam_is_one(centre: tuple[float, ...]) -> None:
    direction = np.asarray(centre) / np.linalg.norm(centre)
    found = lamps.spots(drawn(direction), 10.0)
    assert len(found.flux) == 1
    assert math.acos(min(1.0, float(found.directions[0] @ direction))) < 0.1 * TEXEL


def test_a_track_that_goes_with_the_lamp_follows_it(passing) -> None:
    maps, known = passing
    path = lamps.passages(maps, 1)[0]
    which = min(known, key=lambda one: np.linalg.norm(path.directions[5] - one[5]))
    flux = np.asarray(path.flux)
    numbers = range(1, len(maps) + 1)
    held = lamps.followed(tracks_along(which, flux), path, numbers)
    assert held.share == 1.0
    lost = [*which[:10], *[which[9]] * (len(which) - 10)]
    held = lamps.followed(tracks_along(lost, flux), path, numbers)
    assert held.share == pytest.approx(10 / 15)
    dark = lamps.followed(tracks_along(which, 0.05 * flux), path, numbers)
    assert dark.share == 0


def test_only_frames_that_are_fitted_count(passing) -> None:
    maps, known = passing
    path = lamps.passages(maps, 1)[0]
    which = min(known, key=lambda one: np.linalg.norm(path.directions[5] - one[5]))
    tracks = tracks_along(which[::2], np.asarray(path.flux)[::2])
    tracks = LobeTracks(tuple(range(1, len(maps) + 1, 2)), 24.0, tracks.lobes)
    held = lamps.followed(tracks, path, range(1, len(maps) + 1))
    assert held.frames == tracks.frames
    assert held.share == 1.0


def test_a_lamp_that_fades_out_is_not_seen_any_more() -> None:
    centre = overhead(60)
    maps = [drawn(centre, power=power) for power in (100.0, 100.0, 20.0, 0.0, 0.0)]
    path = lamps.passages(maps, 1)[0]
    assert (path.first, path.last) == (0, 2)


def test_a_shot_without_lamps_has_no_passages() -> None:
    assert lamps.passages([torch.full((8, 16, 3), 0.0)] * 3, 5) == []
