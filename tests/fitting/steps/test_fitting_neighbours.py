# SPDX-License-Identifier: Apache-2.0
"""Many lobes take their steps in parts: which these are, and what comes of it."""

import math
from typing import Any

import pytest
import torch
from lobe_cases import KNOWN, alike, flat, noise, shown, target
from torch import Tensor

from asglight.fitting.first_frame import split_merge
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.steps import neighbours, newton
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import stack


def in_parts_of(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let lobes take steps in parts of so many."""
    monkeypatch.setattr(newton, "TOGETHER", most)
    monkeypatch.setattr(newton, "PART", most)


def directions(frames: int, count: int) -> Tensor:
    generator = torch.Generator().manual_seed(3)
    found = torch.randn(frames, count, 3, generator=generator)
    return torch.nn.functional.normalize(found, dim=-1)


@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize(("count", "most"), [(5, 5), (33, 32), (120, 32), (121, 8)])
def test_parts_hold_every_lobe_once_and_are_of_one_size(count: int, most: int, turn: int) -> None:
    found = neighbours.parts(directions(2, count), most, turn)
    assert torch.equal(torch.cat(found, 1).sort(-1).values, torch.arange(count).expand(2, -1))
    sizes = {part.shape[1] for part in found}
    assert len(found) == math.ceil(count / most)
    assert max(sizes) <= most
    assert max(sizes) - min(sizes) <= 1
    assert all(torch.equal(part, part.sort(-1).values) for part in found)


def test_parts_are_of_neighbours_and_differ_from_turn_to_turn() -> None:
    axis_z = directions(1, 64)
    left, right = neighbours.parts(axis_z, 32, 0)
    assert float(axis_z[0, left[0], 0].max()) <= float(axis_z[0, right[0], 0].min())
    below, above = neighbours.parts(axis_z, 32, 1)
    assert float(axis_z[0, below[0], 1].max()) <= float(axis_z[0, above[0], 1].min())


def test_parts_of_a_frame_do_not_depend_on_others() -> None:
    axis_z = directions(3, 40)
    together = neighbours.parts(axis_z, 8, 2)
    for frame in range(3):
        alone = neighbours.parts(axis_z[frame : frame + 1], 8, 2)
        for one, part in zip(alone, together, strict=True):
            assert torch.equal(one[0], part[frame])


def test_around_lobes_are_those_whose_light_lies_there() -> None:
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(1, 6, 50, generator=generator)
    images[0, 4] = images[0, 1] + 0.01 * images[0, 4]
    images[0, 0, :25], images[0, 5, :25], images[0, 5, 25:] = 0, 0, images[0, 0, 25:]
    lobes = alike(Form.ASG, 6)
    seen = lobe_images.Images(lobes, images, images, torch.ones(1, 6))
    places = torch.tensor([[1], [0]])
    found = neighbours.around(seen, torch.full((1, 50), 0.02), places, 2)
    assert found.tolist() == [[1, 4], [0, 5]]
    both = neighbours.around(seen, torch.full((1, 50), 0.02), torch.tensor([[0, 1]]), 4)
    assert both.tolist() == [[0, 1, 4, 5]]


def _two_frames() -> tuple[Lobes, objective.Target]:
    return alike(Form.ASG, seeds=(0, 6)), target(noise(64, 2), 32, 8)


def test_some_lobes_take_the_steps_that_they_take_where_all_others_stay() -> None:
    lobes, frame = _two_frames()
    moving = torch.tensor([[0, 2, 3], [1, 2, 4]])
    still = torch.ones(2, 5, dtype=torch.bool).scatter(1, moving, False)
    priors = [temporal.prior(lobes, 1.0)]
    held = newton.minimise(lobes, frame, 3, priors=priors, still=still)
    found = newton.minimise(lobes, frame, 3, priors=priors, moving=moving)
    # the light of what is held is taken away from the map in float32
    torch.testing.assert_close(found.value, held.value, rtol=1e-4, atol=0)
    torch.testing.assert_close(found.damping, held.damping)
    for name in ("axes", "sharpness", "amplitude"):
        own, wanted = getattr(found.lobes, name), getattr(held.lobes, name)
        torch.testing.assert_close(own, wanted, rtol=1e-2, atol=1e-3)
        assert torch.equal(own[still], getattr(lobes, name)[still])


def test_some_of_those_that_may_move_stay() -> None:
    lobes, frame = _two_frames()
    still = torch.zeros(2, 5, dtype=torch.bool)
    still[:, 2] = True
    moving = torch.tensor([[0, 2], [2, 4]])
    found = newton.minimise(lobes, frame, 3, still=still, moving=moving)
    torch.testing.assert_close(found.lobes.axes[:, 2], lobes.axes[:, 2])  # made orthonormal again
    assert not torch.allclose(found.lobes.axes[0, 0], lobes.axes[0, 0])


def test_what_lobes_in_parts_come_to_is_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(2, monkeypatch)
    lobes, frame = _two_frames()
    priors = [temporal.prior(lobes)]
    reports: list[Lobes] = []
    found = newton.minimise(lobes, frame, 5, priors=priors, on_step=reports.append)
    assert found.shown is not None
    again = lobe_images.images(found.lobes, frame.places)
    torch.testing.assert_close(found.shown.values, again.values)
    value = objective.value(again.radiance, frame) + temporal.value(found.lobes, priors[0])
    torch.testing.assert_close(found.value, value)
    assert len(reports) == 3  # two steps, two and one
    assert torch.equal(reports[-1].axes, found.lobes.axes)
    assert not torch.equal(reports[0].axes, found.lobes.axes)


@pytest.mark.parametrize("form", list(Form))
def test_parts_come_to_the_truth(form: Form, monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(2, monkeypatch)
    truth = alike(form, 4, (5,))
    start = Lobes(truth.axes, 1.3 * truth.sharpness, 0.8 * truth.amplitude, form)
    frame = shown(truth[0], 32)
    before = objective.value(lobe_images.images(start, frame.places).radiance, frame)
    found = newton.minimise(start, frame, 60)
    assert float(found.value) < 0.05 * float(before)


@pytest.mark.usefixtures("torch_steps")
def test_parts_in_torch_come_to_where_compiled_ones_do(monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(2, monkeypatch)
    lobes, frame = _two_frames()
    torch_made = newton.minimise(lobes, frame, 4)
    monkeypatch.undo()  # the library as well
    in_parts_of(2, monkeypatch)
    compiled = newton.minimise(lobes, frame, 4)
    torch.testing.assert_close(compiled.value, torch_made.value, rtol=1e-3, atol=0)


def test_they_end_where_a_turn_gains_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(2, monkeypatch)
    reports: list[Lobes] = []
    frame = shown(KNOWN, 32)
    newton.minimise(KNOWN[None], frame, 40, tolerance=0.9, on_step=reports.append)
    assert len(reports) == 1


def test_an_absence_costs_no_less_where_fewer_make_up_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lobes, frame = alike(Form.ASG, 8), target(noise(64), 32, 8)
    seen = lobe_images.images(lobes, frame.places)
    all_free, _ = split_merge.leave_one_out_costs(seen, frame)
    in_parts_of(3, monkeypatch)
    costs, filled = split_merge.leave_one_out_costs(seen, frame)
    assert bool((costs > 0.999 * all_free).all())  # [Hassibi and Stork 1993]: a Schur complement
    own = filled.diagonal(dim1=0, dim2=1).mT[:, 5:]
    torch.testing.assert_close(own, -lobes.amplitude[0].double(), rtol=1e-6, atol=1e-9)
    together = {tuple(part[0].tolist()) for part in neighbours.parts(lobes.axis_z, 3, 0)}
    for gone in range(8):
        moved = tuple(filled[gone].abs().sum(-1).nonzero().flatten().tolist())
        assert moved in together


def test_of_many_lobes_those_around_a_split_try_it(monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(3, monkeypatch)
    truth = alike(Form.ASG, 6, (2,))
    frame = objective.target(flat(texels.texel_means(truth[0], 64, 128)[None].float()))
    lobes = truth.clone()
    lobes.amplitude[0, 5] = 0.0
    lobes.axes[0, 5] = lobes.axes[0, 4]
    stuck = newton.minimise(lobes, frame, 20)
    taken: list[Tensor] = []
    steps = newton.minimise

    def watched(*given: Any, **named: Any) -> newton.Outcome:
        moving = named.get("moving")
        if isinstance(moving, Tensor):
            taken.append(moving)
        return steps(*given, **named)

    monkeypatch.setattr(newton, "minimise", watched)
    found = split_merge.split_and_merge(stuck, frame, frame, 2, 0.0)
    assert {moving.shape[1] for moving in taken} == {3}
    assert float(found.value) <= float(stuck.value)


def test_frames_in_parts_do_not_see_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    in_parts_of(2, monkeypatch)
    maps = noise(64, 2) * torch.tensor([1.0, 30.0])[:, None, None]
    lobes = stack([each for each in alike(Form.ASG, seeds=(0, 6))])
    both = newton.minimise(lobes, target(maps, 32, 8), 4, tolerance=0.0)
    for index in range(2):
        single = target(maps[index : index + 1], 32, 8)
        alone = newton.minimise(lobes[index : index + 1], single, 4, tolerance=0.0)
        # float32 sums in another order, grown by four steps
        torch.testing.assert_close(both.value[index], alone.value[0], rtol=1e-3, atol=0)
