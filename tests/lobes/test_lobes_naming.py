# SPDX-License-Identifier: Apache-2.0
"""A name means the same light in every fit of a shot."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from usd_tracks import moving, rows

from asglight.lobes import Form, Lobes, LobeTracks
from asglight.lobes.data import lobe_names
from asglight.lobes.identity.naming import by_energy, named_as

FRAMES = (1001, 1002, 1003)
PLACES = (0.0, 40.0, 90.0, 150.0, 220.0, 300.0)
"""Degrees on the equator, far apart: each is a light of its own."""


def lamps(light: list[float], places: list[float], frames: tuple[int, ...] = FRAMES) -> LobeTracks:
    """Return one lamp at each place, the same in all frames."""
    turns = Rotation.from_euler("y", np.reshape(places, (-1, 1)), degrees=True)
    axes = torch.from_numpy(rows(turns)).float().expand(len(frames), -1, -1, -1).clone()
    amplitude = torch.tensor(light)[None, :, None].expand(len(frames), -1, 3).clone()
    sharpness = torch.full((len(frames), len(places), 2), 50.0)
    return LobeTracks(frames, 24.0, Lobes(axes, sharpness, amplitude))


def place_of(tracks: LobeTracks) -> dict[str, int]:
    """Return the place of each lamp by name, to the degree."""
    x, _, z = tracks.lobes.axis_z[0].unbind(-1)
    degrees = torch.rad2deg(torch.atan2(x, z)) % 360
    return dict(zip(tracks.names, degrees.round().int().tolist(), strict=True))


def test_the_first_names_are_sorted_by_energy():
    tracks = by_energy(lamps([1, 5, 3], [0, 40, 90]))
    assert place_of(tracks) == {"lobe_00": 40, "lobe_01": 90, "lobe_02": 0}


def test_energy_is_flux_over_the_shot_and_not_a_peak():
    tracks = lamps([1, 1.5], [0, 40])
    tracks.lobes.sharpness[:, 0] = 5.0  # ten times the solid angle
    assert place_of(by_energy(tracks)) == {"lobe_00": 0, "lobe_01": 40}


def test_names_are_kept_whatever_the_order_and_the_energy_are():
    earlier = by_energy(lamps([6, 5, 4, 3, 2, 1], list(PLACES)))
    again = lamps([1, 2, 3, 4, 5, 6], [place + 4 for place in PLACES])
    named = named_as(again, earlier)
    assert named.names == earlier.names
    assert place_of(named) == {name: place + 4 for name, place in place_of(earlier).items()}


def test_a_new_light_gets_a_name_that_nobody_had_and_a_lost_one_gives_its_name_to_none():
    earlier = by_energy(lamps([6, 5, 4, 3], [0, 40, 90, 150]))
    named = named_as(lamps([9, 8, 5, 4, 3], [300, 220, 40, 90, 150]), earlier)
    assert place_of(named) == {
        "lobe_01": 40,
        "lobe_02": 90,
        "lobe_03": 150,
        "lobe_04": 300,
        "lobe_05": 220,
    }
    again = named_as(lamps([7, 9, 5, 4, 3], [0, 300, 40, 90, 150]), named)
    assert place_of(again) == {
        "lobe_01": 40,
        "lobe_02": 90,
        "lobe_03": 150,
        "lobe_04": 300,
        "lobe_06": 0,
    }


def test_names_that_somebody_gave_are_kept():
    earlier = replace(lamps([6, 5], [0, 40]), names=("key", "rim"))
    named = named_as(lamps([5, 6, 1], [0, 40, 90]), earlier)
    assert place_of(named) == {"key": 0, "rim": 40, "lobe_00": 90}


@pytest.mark.parametrize("change", ["frames", "places", "form"])
def test_another_environment_is_named_anew(change):
    earlier = replace(lamps([6, 5, 4], [0, 40, 90]), names=("lobe_07", "lobe_08", "lobe_09"))
    tracks = lamps([4, 5, 6], [0, 40, 90])
    if change == "frames":
        tracks = replace(tracks, frames=(1, 2, 3))
    elif change == "places":
        tracks = lamps([1, 50, 60], [0, 200, 300])
    else:
        tracks = replace(tracks, lobes=replace(tracks.lobes, form=Form.BINGHAM))
    assert named_as(tracks, earlier).names == lobe_names(3)


@pytest.mark.parametrize("form", Form)
def test_a_fit_named_after_itself_is_itself(form):
    tracks = by_energy(moving(range(1001, 1100), lobes=6, form=form))
    tracks = replace(tracks, names=tuple(reversed(tracks.names)))
    again = named_as(tracks, tracks)
    assert again.names == tracks.names
    torch.testing.assert_close(again.lobes.amplitude, tracks.lobes.amplitude, rtol=0, atol=0)


def test_only_the_frames_in_common_count():
    earlier = by_energy(lamps([6, 5, 4], [0, 40, 90], (1, 2, 3, 4)))
    moved = lamps([4, 5, 6], [90, 0, 40], (4, 5))
    moved.lobes.axes[1] = moved.lobes.axes[1, [1, 2, 0]]
    assert place_of(named_as(moved, earlier)) == place_of(earlier)


def test_names_must_fit_the_lobes():
    with pytest.raises(ValueError, match=r"names: .* for 2 lobes; expected one each"):
        replace(lamps([1, 2], [0, 40]), names=("a",))
    with pytest.raises(ValueError, match="expected one each"):
        replace(lamps([1, 2], [0, 40]), names=("a", "a"))


def test_what_a_person_calls_a_light_stays_with_it():
    earlier = by_energy(lamps([6, 5, 4], [0, 40, 90]))
    earlier = replace(earlier, display_names={"lobe_01": "Tube", "lobe_02": "Window"})
    named = named_as(lamps([9, 8, 5], [40, 220, 0]), earlier)
    assert place_of(named) == {"lobe_00": 0, "lobe_01": 40, "lobe_03": 220}
    assert named.display_names == {"lobe_01": "Tube"}


def test_sorting_by_energy_keeps_what_a_person_calls_a_light():
    tracks = replace(lamps([1, 5], [0, 40]), display_names={"lobe_01": "Tube"})
    found = by_energy(tracks)
    assert place_of(found) == {"lobe_00": 40, "lobe_01": 0}
    assert found.display_names == {"lobe_00": "Tube"}
