# SPDX-License-Identifier: Apache-2.0
"""Lamps that come back together are lit at once, in their own tracks; missing lobes as well."""

from collections.abc import Sequence

import pytest
import torch
from lobe_cases import lamps
from torch import Tensor

from asglight.fitting.following.returning import lit_again
from asglight.fitting.loss import objective
from asglight.fitting.options import FitOptions, Preset
from asglight.judging.following import follow
from asglight.judging.metrics import frame_errors
from asglight.lobes import Lobes, asg, texels

ROWS, LOBES = 32, 8
PLACES = [(1, 0.3, 0.2), (0.2, 0.4, 1), (-1, 0.2, 0.3), (-0.3, 0.3, -1), (1, -0.1, -0.9), (0, 1, 0)]
CEILING = (0, 0.2, 1)


def lit(*on: int) -> Tensor:
    """Return the map of a dim ceiling and those lamps that are on."""
    places = [CEILING, *(PLACES[lamp] for lamp in on)]
    shown = lamps(places, [1.0] + [150.0] * len(on), [0.3] + [60.0] * len(on))
    return texels.texel_means(shown, ROWS, 2 * ROWS)


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
def test_lamps_that_come_back_together_are_in_their_tracks_at_once(preset: Preset) -> None:
    sets = (0, 1, 2), (3, 4, 5)
    one, other = (lit(*on) for on in sets)
    maps = [lit(*range(6)), *[one] * 3, *[other] * 3, one]
    found, _ = follow(maps, FitOptions(LOBES, preset))
    still = frame_errors(found[0], maps[0]).values
    for frame, on in ((4, sets[1]), (7, sets[0])):
        assert frame_errors(found[frame], maps[frame]).values["r0.5"] < 2 * still["r0.5"] + 2e-3
        tracks = tracks_of(found[frame], on)
        places = directions_of(on)
        there = (found[0].axis_z[tracks] * places).sum(-1)
        assert float(there.min()) > 0.99


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
def test_a_track_that_goes_dark_stays_where_its_lamp_was(preset: Preset) -> None:
    on, off = lit(*range(6)), lit(0, 1, 2)
    (before, after), _ = follow([on, off], FitOptions(LOBES, preset))
    ended = torch.nonzero((before.amplitude > 0).any(-1) & (after.amplitude == 0).all(-1)).flatten()
    assert set(tracks_of(before, (3, 4, 5))) <= set(ended.tolist())
    then, was = after.select(ended), before.select(ended)
    torch.testing.assert_close(then.axis_z, was.axis_z, rtol=0, atol=1e-6)
    torch.testing.assert_close(then.sharpness, was.sharpness)


def tracks_of(lobes: Lobes, on: Sequence[int]) -> list[int]:
    """Return the track that has most of the radiance at each lamp."""
    light = asg.unit_lobes(lobes, directions_of(on))[..., None] * lobes.amplitude[:, None]
    return light.sum(-1).argmax(0).tolist()


def directions_of(on: Sequence[int]) -> Tensor:
    """Return the directions of lamps.  [K, 3]."""
    return torch.nn.functional.normalize(torch.tensor([PLACES[lamp] for lamp in on]), dim=-1)


def test_as_many_tracks_are_lit_as_may_be_and_those_that_the_map_has() -> None:
    known = lamps([*PLACES, CEILING], [150.0] * 6 + [1.0], [60.0, 60.0, *[0.0] * 4, 0.3])
    frame = objective.target(lit(1, 3, 4)[None].flatten(1, 2).mT)
    tracks, shown = lit_again(known, frame, 7)
    found = dict(zip(tracks.tolist(), shown.lobes.amplitude[0, :, 0].tolist(), strict=True))
    wanted = {1: 60.0, 3: 60.0, 4: 60.0, 6: 0.3}
    assert {track: found[track] for track in wanted} == pytest.approx(wanted, rel=0.02)
    assert all(light < 0.5 for track, light in found.items() if track not in wanted)
    assert len(lit_again(known, frame, 2)[0]) == 2
