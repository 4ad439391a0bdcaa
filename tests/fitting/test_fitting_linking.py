# SPDX-License-Identifier: Apache-2.0
"""Links: the best of all flows, found by trying every one; tracks that do not jump."""

import itertools
import math
from collections.abc import Iterator

import pytest
import torch
from lobe_cases import lamps
from torch import Tensor

from asglight.fitting import linking
from asglight.fitting.free_fits import REACH_DEG
from asglight.fitting.linking import DARK, linked, tracks, worths
from asglight.judging.following import jumps
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.matching import flux_shares

FRAMES, LOBES = 4, 2
NONE = torch.zeros(FRAMES, dtype=torch.bool)


def _on_equator(degrees: Tensor, light: float = 1.0) -> Lobes:
    """Return narrow lobes on the equator.  [F, N]."""
    frames = []
    for row in torch.deg2rad(degrees).tolist():
        places = [(math.sin(angle), 0.0, math.cos(angle)) for angle in row]
        frames.append(lamps(places, [4000.0] * len(row), [light] * len(row)))
    return stack(frames)


def _legal(ways: tuple[tuple[int, ...], ...], degrees: Tensor) -> bool:
    """Tell whether tracks may be so: no lobe twice in a frame, near links, dark in between."""
    if any(len({k for k in frame if k >= 0}) < sum(k >= 0 for k in frame) for frame in ways):
        return False
    for track in zip(*ways, strict=True):
        lit = [frame for frame in range(FRAMES) if track[frame] >= 0]
        for one, other in itertools.pairwise(lit):
            turned = abs(float(degrees[one, track[one]] - degrees[other, track[other]]))
            near = turned < (other - one) * REACH_DEG
            if other - one <= DARK and not near:
                return False
    return True


def _all(degrees: Tensor) -> Iterator[tuple[tuple[int, ...], ...]]:
    choices = list(itertools.product(range(-1, LOBES), repeat=LOBES))
    for ways in itertools.product(choices, repeat=FRAMES):
        if _legal(ways, degrees):
            yield ways


@pytest.mark.parametrize("seed", range(6))
def test_tracks_hold_the_most_that_any_could(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "SLACK", 0.0)
    generator = torch.Generator().manual_seed(seed)
    degrees = 40 * torch.rand(FRAMES, LOBES, generator=generator)
    worth = 0.1 + torch.rand(FRAMES, LOBES, generator=generator)
    found = tracks(_on_equator(degrees), worth, NONE)
    ways = tuple(tuple(row) for row in found.tolist())
    assert _legal(ways, degrees)

    def held(ways: tuple[tuple[int, ...], ...]) -> float:
        return sum(float(worth[f, k]) for f, row in enumerate(ways) for k in row if k >= 0)

    best = max(held(each) for each in _all(degrees))
    # a link costs 1e-6 a degree, which decides between equals alone
    assert held(ways) == pytest.approx(best, abs=1e-3)


def test_of_equal_tracks_those_that_turn_least() -> None:
    degrees = torch.tensor([[0.0, 4.0], [4.5, 0.5], [1.0, 5.0], [5.5, 1.5]])
    found = tracks(_on_equator(degrees), torch.ones(FRAMES, LOBES), NONE)
    places = degrees.gather(1, found)
    assert float((places[1:] - places[:-1]).abs().max()) == pytest.approx(0.5)


def test_lobes_that_were_followed_keep_their_order() -> None:
    """They pass each other, and turned least if they took each other's part."""
    degrees = torch.tensor([[0.0, 4.0], [2.5, 1.5], [5.0, -1.0], [7.5, -3.5]])
    shot = _on_equator(degrees)
    found = linked(shot, torch.ones(FRAMES, LOBES), ~NONE)
    torch.testing.assert_close(found.axes, shot.axes, rtol=0, atol=1e-6)
    torch.testing.assert_close(found.amplitude, shot.amplitude)


def test_tracks_take_the_order_of_the_lobes_that_were_followed() -> None:
    degrees = torch.tensor([[0.0, 90.0], [1.0, 91.0], [92.0, 2.0], [93.0, 3.0]])
    followed = torch.tensor([True, True, False, False])
    found = linked(_on_equator(degrees), torch.ones(FRAMES, LOBES), followed)
    expected = torch.tensor([[0.0, 90.0], [1.0, 91.0], [2.0, 92.0], [3.0, 93.0]])
    torch.testing.assert_close(found.axis_z, _on_equator(expected).axis_z, rtol=0, atol=1e-5)


def test_a_lamp_that_outruns_the_leash_is_held_by_lobes_in_turn() -> None:
    """A row of lobes of which one ends and another begins in each frame."""
    frames = 9
    degrees = torch.stack([25.0 * k + torch.tensor([0.0, 8.0, 16.0, 24.0]) for k in range(frames)])
    parts = _on_equator(degrees)
    shot = stack([parts[k].select(torch.tensor([0, 1, 2, 3] * 3)) for k in range(frames)])
    shot.amplitude[:, 4:] = 0.0  # eight more are dark
    worth = torch.stack([worths(shot[k], torch.full((12,), 0.01)) for k in range(frames)])
    assert bool((worth[:, 4:] == 0).all())
    found = linked(shot, worth, torch.zeros(frames, dtype=torch.bool))
    shares = torch.stack([flux_shares(found[k]) for k in range(frames)])
    assert ((shares > 0.1).sum(-1) == 4).all()
    assert jumps([found[k] for k in range(frames)]) == 0
    for k in range(frames):
        lit = found.axis_z[k][shares[k] > 0.1]
        nearest = (parts.axis_z[k] @ lit.mT).amax(-1)
        assert float(nearest.min()) > math.cos(math.radians(0.1))


def test_a_lobe_that_is_not_found_for_a_frame_stays_lit_halfway() -> None:
    degrees = torch.tensor([[0.0, 90.0], [40.0, 92.0], [8.0, 94.0], [12.0, 96.0]])
    worth = torch.tensor([[1.0, 1.0], [0.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    found = linked(_on_equator(degrees), worth, NONE)
    expected = torch.tensor([[0.0, 90.0], [4.0, 92.0], [8.0, 94.0], [12.0, 96.0]])
    there = _on_equator(expected).axis_z
    order = [int((found.axis_z[0] @ place).argmax()) for place in there[0]]
    torch.testing.assert_close(found.axis_z[:, order], there, rtol=0, atol=1e-5)
    assert bool((found.amplitude > 0).all())


def test_a_dark_track_keeps_its_place_for_a_frame_and_waits_in_the_next_one() -> None:
    degrees = torch.tensor([[0.0], [50.0], [50.0], [80.0], [85.0]])
    worth = torch.tensor([[1.0], [0.0], [0.0], [1.0], [1.0]])
    found = linked(_on_equator(degrees), worth, torch.zeros(5, dtype=torch.bool))
    expected = torch.tensor([[0.0], [0.0], [80.0], [80.0], [85.0]])
    torch.testing.assert_close(found.axis_z, _on_equator(expected).axis_z, rtol=0, atol=1e-5)
    assert (found.amplitude[:, 0, 0] > 0).tolist() == [True, False, False, True, True]


def test_a_lobe_further_than_its_leash_comes_as_near_as_it_can() -> None:
    """A broad one, which serves nearly as well a few degrees off."""
    angle = math.radians(12.0)
    places = [(0.0, 0.0, 1.0), (math.sin(angle), 0.0, math.cos(angle))]
    shot = stack([lamps([place], [8.0], [1.0]) for place in places])
    found = linked(shot, torch.ones(2, 1), torch.zeros(2, dtype=torch.bool))
    turned = torch.acos((found.axis_z[0] * found.axis_z[1]).sum())
    assert math.degrees(float(turned)) == pytest.approx(REACH_DEG, abs=0.01)
    assert bool((found.amplitude > 0).all())


def test_a_lobe_is_worth_what_it_is_missed_and_a_broad_one_its_light() -> None:
    lobes = lamps([(0, 0, 1), (1, 0, 0), (0, 1, 0)], [4000.0, 1.0, 4000.0], [100.0, 1.0, 0.0])
    missed = torch.tensor([0.02, 0.001, 0.3])
    share = float(flux_shares(lobes)[1])
    assert worths(lobes, missed).tolist() == pytest.approx([0.02, 0.001 + 2 * share, 0.0])
    assert worths(lobes, torch.full((3,), torch.inf)).tolist()[0] == 1.0
