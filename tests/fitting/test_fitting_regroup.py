# SPDX-License-Identifier: Apache-2.0
"""Split and merge finds the share of lobes that each lamp needs."""

import pytest
import torch
from lobe_cases import lamps, random_lobes

from asglight.fitting import lobe_images, newton, objective, regroup
from asglight.lobes import Form, Lobes, asg, texels

TWO = [(1.0, 0.0, 0.2), (1.0, 0.0, -0.5)]
ALONE = (-1.0, 0.3, 0.0)


def misplaced() -> tuple[Lobes, objective.Target]:
    """Return two lobes on one lamp and one between two lamps, and the map."""
    truth = lamps([*TWO, ALONE], [80.0, 60.0, 40.0], [5.0, 6.0, 3.0])
    frame = objective.target(texels.texel_means(truth, 64, 128))
    start = lamps([(1.0, 0.0, -0.15), ALONE, (-1.0, 0.32, 0.02)], [20.0, 40.0, 40.0], [5, 1.5, 1.5])
    return start, frame


def test_a_lobe_goes_from_where_two_stand_to_where_one_stands_for_two() -> None:
    start, frame = misplaced()
    stuck = newton.minimise(start, frame, 40)
    found = regroup.regroup(stuck, frame, 6, 0.0)
    assert found.value < 0.05 * stuck.value
    wanted = torch.nn.functional.normalize(torch.tensor([*TWO, ALONE]), dim=-1)
    assert float((found.lobes.axis_z @ wanted.mT).amax(0).min()) > 0.999


def test_it_never_gives_back_a_worse_fit() -> None:
    start, frame = misplaced()
    state = newton.minimise(start, frame, 3)
    for trials in (0, 1, 2):
        assert regroup.regroup(state, frame, trials, 0.0).value <= state.value


def test_the_lobe_that_costs_nothing_is_the_one_that_stands_in_for_another() -> None:
    start, frame = misplaced()
    lobes = newton.minimise(start, frame, 40).lobes
    costs = regroup.absence_costs(lobe_images.images(lobes, frame.grid), frame)
    assert float(costs[1:].min()) < 0.1 * float(costs[0])


def test_a_single_lobe_is_left_alone() -> None:
    _, frame = misplaced()
    alone = newton.minimise(lamps([ALONE], [40.0], [3.0]), frame, 3)
    assert regroup.regroup(alone, frame, 5, 0.0) is alone


@pytest.mark.parametrize("form", list(Form))
def test_halves_of_a_narrow_lobe_keep_its_flux_and_middle(form: Form) -> None:
    lobes = random_lobes(form, count=3)
    narrow = Lobes(lobes.axes, lobes.sharpness + 300, lobes.amplitude, form)
    halves = regroup.halved(narrow, 0, 2, 0)
    before, after = asg.flux(narrow)[0], asg.flux(halves)[[0, 2]].sum(0)
    # an sg half is narrower along both axes, and loses 1 - sqrt(1 - 0.36) of the flux
    kept = 0.8 if form is Form.SG else 1.0
    assert after.tolist() == pytest.approx((kept * before).tolist(), rel=0.01)
    middle = torch.nn.functional.normalize(halves.axis_z[[0, 2]].sum(0), dim=0)
    assert float(middle @ narrow.axis_z[0]) > 1 - 1e-9
    assert torch.equal(halves.axes[1], narrow.axes[1])
