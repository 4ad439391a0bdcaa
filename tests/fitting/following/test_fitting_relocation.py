# SPDX-License-Identifier: Apache-2.0
"""Relocation: the lobe that is needed least goes to where one more is needed, if that gains."""

from dataclasses import replace

import torch
from lobe_cases import angle_deg, flat, lamps

from asglight.fitting.following.relocation import Relocation, placed, relocated
from asglight.fitting.following.trials import TrialSettings
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.steps import newton
from asglight.lobes import Lobes, texels

HEIGHT = 64
A, B, C, SKY = (1.0, 0.2, 0.0), (-1.0, 0.5, 0.3), (-0.3, 0.3, 0.9), (0.0, 1.0, 0.1)
TRUTH = lamps([A, B, C, SKY], [80.0, 60.0, 70.0, 3.0], [10.0, 8.0, 7.0, 1.0])
TWICE_ON_A = lamps([A, B, A, SKY], [80.0, 60.0, 80.0, 3.0], [5.0, 8.0, 5.0, 1.0])
"""As the truth, but that two lobes share one lamp and none is on another."""
SETTINGS = Relocation(rounds=2, trial=TrialSettings(4))


def _frame(lobes: Lobes) -> objective.Target:
    maps = texels.texel_means(lobes, HEIGHT, 2 * HEIGHT)
    return objective.trial_target(flat(maps[None]), objective.Corners(0.1, 0.005))


def _relocated(lobes: Lobes, *, count: int, room: int, frame: objective.Target | None = None):
    start = newton.Outcome(lobes[None], torch.empty(0), torch.tensor([0.05]))
    return relocated(start, lobes, frame or _frame(TRUTH), count, room, 0.0, SETTINGS)


def _direction(place: tuple[float, ...]) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor(place), dim=0)


def test_a_spare_lobe_goes_to_the_lamp_that_has_none() -> None:
    found, stays = _relocated(TWICE_ON_A, count=4, room=4)
    assert int(stays.sum()) == 4
    assert found.count > 4
    assert stays.tolist().index(False) in (0, 2)  # one of the two on lamp A
    lit = found.select(stays)
    assert min(float(angle_deg(lit.axis_z[k], _direction(C))) for k in range(4)) < 3.0
    frame = _frame(TRUTH)
    before, after = (
        float(objective.value(lobe_images.images(each[None], frame.places).radiance, frame))
        for each in (TWICE_ON_A, lit)
    )
    assert after < 0.3 * before


def test_a_lobe_is_added_where_fewer_are_lit_than_may_be() -> None:
    three = TWICE_ON_A.select(torch.tensor([0, 1, 3]))
    found, stays = _relocated(three, count=4, room=4)
    assert bool(stays.all())
    assert found.count == 4


def test_what_a_new_lamp_pulled_away_stays_where_it_was() -> None:
    """A lamp is switched on under a sky of one lobe, which steps have brought to the lamp."""
    truth = TRUTH.select(torch.tensor([0, 3]))
    sky, pulled = truth.select(torch.tensor([1])), truth.select(torch.tensor([0]))
    frame = _frame(truth)
    start = newton.Outcome(pulled[None], torch.empty(0), torch.tensor([0.05]))

    def loss(before: Lobes) -> float:
        found, stays = relocated(start, before, frame, 4, 4, 0.0, SETTINGS)
        shown = lobe_images.images(found.select(stays)[None], frame.places)
        return float(objective.value(shown.radiance, frame))

    assert loss(sky) < 0.2 * loss(pulled)


def test_without_a_free_track_nothing_goes() -> None:
    found, stays = _relocated(TWICE_ON_A, count=4, room=0)
    assert bool(stays.all())
    assert torch.equal(found.axes, TWICE_ON_A.axes)


def test_nothing_goes_where_that_gains_too_little() -> None:
    found, stays = _relocated(TRUTH, count=4, room=4)
    assert bool(stays.all())
    assert found.count == 4


def test_a_dark_lobe_does_not_stay() -> None:
    dark = replace(TRUTH, amplitude=TRUTH.amplitude * torch.tensor([1.0, 0.0, 1.0, 1.0])[:, None])
    found, stays = _relocated(dark, count=4, room=0)
    assert stays.tolist() == [True, False, True, True]
    assert temporal.is_dark(found).tolist() == [False, True, False, False]


def test_a_lobe_is_placed_where_light_lacks_most_and_nowhere_if_none_does() -> None:
    frame = _frame(TRUTH)
    lobes = replace(TRUTH, amplitude=TRUTH.amplitude * torch.tensor([1.0, 1.0, 0.0, 1.0])[:, None])
    seen = lobe_images.images(lobes[None], frame.places)
    found = placed(lobes, 2, seen, frame)
    assert found is not None
    # the probe's directions lie 11 degrees apart
    assert float(angle_deg(found.axis_z[2], _direction(C))) < 8.0
    brighter = replace(TRUTH, amplitude=2 * TRUTH.amplitude)
    seen = lobe_images.images(brighter[None], frame.places)
    assert placed(brighter, 2, seen, frame) is None


def test_the_lobe_that_goes_is_not_lit_again_in_the_trials() -> None:
    """Two lobes make up a room, and neither can be spared for its lamp: all of it would be dark."""
    room = lamps([SKY, (0.0, -1.0, 0.0), A], [0.1, 0.1, 60.0], [1.0, 1.0, 9.0])
    frame, two = _frame(room), room.select(torch.tensor([0, 1]))
    found, stays = _relocated(two, count=2, room=2, frame=frame)
    before, after = (
        float(objective.value(lobe_images.images(each[None], frame.places).radiance, frame))
        for each in (two, found.select(stays))
    )
    assert after <= before
