# SPDX-License-Identifier: Apache-2.0
"""Many maps side by side come to what each comes to by itself."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import alike, noise, sky_and_sun, target
from torch import Tensor

from asglight.fitting.first_frame import reweighting, seeding, split_merge
from asglight.fitting.first_frame.fit import FAST, exposed, fit_first_frame, soft_to_sharp
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import newton
from asglight.fitting.stills import fit_stills, fits
from asglight.fitting.stills.frames import picked, put, with_weights
from asglight.fitting.stills.reweighting import balanced_each
from asglight.fitting.stills.splitting import split_and_merge_each
from asglight.fitting.stills.starting import seeds_of_each
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form

DARK = torch.zeros(32, 64, 3)


def _maps(height: int = 32, count: int = 3) -> list[Tensor]:
    """Return a sky, and rooms of noise.  [H, 2 H, 3] each."""
    rooms = noise(height, count - 1).mT.unflatten(1, (height, 2 * height))
    return [sky_and_sun(0.0, height), *rooms]


@pytest.mark.parametrize("form", [Form.ASG, Form.SG, Form.FLAT])
def test_stills_are_as_good_as_one_by_one(form: Form, monkeypatch: pytest.MonkeyPatch) -> None:
    maps = _maps() if form is Form.ASG else _maps(16, 2)
    if form is not Form.ASG:
        # what lags behind is another matter, below
        brief = replace(FAST, levels=soft_to_sharp(rounds=1)[1::2], left=(9.0,) * len(FAST.left))
        monkeypatch.setattr(fits, "SETTINGS", brief)
    alone = [fit_first_frame(each, 4, form, fits.SETTINGS) for each in maps]
    for fit, single, reference in zip(fit_stills(maps, 4, form), alone, maps, strict=True):
        found, expected = (frame_errors(each.lobes, reference).values for each in (fit, single))
        # steps go on while other maps gain by them, which may lead a little further
        assert fit.loss == pytest.approx(single.loss, rel=0.02)
        for name in ("env", "irr", "r0.5"):
            assert found[name] <= 1.1 * expected[name] + 1e-4, name
        assert fit.flux_error == pytest.approx(single.flux_error, abs=1e-5)


def test_one_still_is_the_fit_of_that_map() -> None:
    reference = _maps()[0]
    alone, fit = fit_frame(reference, FitOptions(3), None), fit_stills([reference], 3)[0]
    assert fit.loss == pytest.approx(alone.loss, rel=1e-4)
    torch.testing.assert_close(fit.lobes.axes, alone.lobes.axes, rtol=0, atol=1e-3)
    torch.testing.assert_close(fit.lobes.sharpness, alone.lobes.sharpness, rtol=1e-2, atol=0)
    fit.lobes.amplitude.mul_(2.0)  # it can be changed


def test_maps_at_once_bound_the_memory_and_say_how_far_it_is() -> None:
    maps, done = _maps(16, 3), []
    some = fit_stills(maps, 2, at_once=2, on_done=done.append)
    assert done == [2, 3]
    for fit, whole in zip(some, fit_stills(maps, 2), strict=True):
        assert fit.loss == pytest.approx(whole.loss, rel=0.02)


def test_black_maps_are_dark_lobes_among_the_others() -> None:
    bright = _maps()[0]
    first, dark, last = fit_stills([bright, DARK, bright], 3)
    assert dark.loss == 0.0
    assert not dark.lobes.amplitude.any()
    assert first.loss == pytest.approx(last.loss, rel=1e-6)
    assert not fit_stills([DARK], 3)[0].lobes.amplitude.any()
    assert fit_stills([], 3) == []


def test_maps_of_two_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"references: of sizes .*; expected one size"):
        fit_stills([DARK, DARK[:16, :32]], 3)


@pytest.mark.parametrize("spread", [math.inf, 4.0, None])
@pytest.mark.parametrize("is_compiled", [True, False])
def test_starts_are_those_of_each_map(
    spread: float | None, is_compiled: bool, request: pytest.FixtureRequest
) -> None:
    sources = [seeding.cells(each) for each in _maps(64)]
    assert len({len(source.weight) for source in sources}) > 1  # some are filled up
    if not is_compiled:
        request.getfixturevalue("torch_steps")
    found = seeds_of_each(sources, 5, Form.ASG, spread)
    for index, source in enumerate(sources):
        expected = seeding.seed_lobes(source, 5, Form.ASG, spread)
        torch.testing.assert_close(found.axes[index], expected.axes, rtol=0, atol=1e-4)
        for name in ("sharpness", "amplitude"):
            own, wanted = getattr(found, name)[index], getattr(expected, name)
            torch.testing.assert_close(own, wanted, rtol=1e-3, atol=1e-6)


def test_splits_of_each_map_are_tried() -> None:
    maps = torch.cat([exposed(each).radiance for each in _maps()])
    frames = objective.target(maps)
    begun = newton.minimise(alike(Form.ASG, 4, (1, 2, 3)), frames, 6)
    together = split_and_merge_each(begun, frames, frames, 2, 0.0)
    assert (together.value < begun.value).all()
    for index in range(3):
        which = torch.tensor([index])
        one = picked(frames, which)
        alone = split_merge.split_and_merge(begun[which], one, one, 2, 0.0)
        assert float(together.value[index]) == pytest.approx(float(alone.value), rel=0.05)


def test_a_map_without_splits_left_waits_and_one_lobe_has_none() -> None:
    frames = target(noise(16, 2), 16)
    two = newton.minimise(alike(Form.SG, 2, (1, 2)), frames, 4)
    # two lobes have two splits: the second round has none to try
    assert (split_and_merge_each(two, frames, frames, 3, 0.0).value <= two.value).all()
    one = newton.minimise(alike(Form.SG, 1, (1, 2)), frames, 4)
    assert split_and_merge_each(one, frames, frames, 3, 0.0) is one


def test_what_lags_behind_is_brought_forward_map_by_map() -> None:
    maps = torch.cat([exposed(each).radiance for each in _maps()])
    frames = objective.target(maps)
    found = newton.minimise(alike(Form.ASG, 4, (1, 2, 3)), frames, 6)
    aims = reweighting.lags_of_each(found, frames, torch.ones(5)) * torch.tensor(
        [[2.0, 2.0, 2.0, 0.9, 2.0], [2.0, 2.0, 2.0, 2.0, 2.0], [0.9, 2.0, 2.0, 2.0, 2.0]]
    )
    better = balanced_each(found, frames, aims, 0.0)
    for index in range(3):
        which = torch.tensor([index])
        frame = picked(frames, which)
        own = reweighting.measured(found[which], frame, aims[index])
        alone = reweighting.reweighted(own, frame, aims[index], 0.0).found
        assert float(better.value[index]) == pytest.approx(float(alone.value), rel=0.02)
    assert torch.equal(better.lobes.axes[1], found.lobes.axes[1])  # where nothing lags
    before, after = (
        reweighting.lags_of_each(each, frames, aims).amax(-1) for each in (found, better)
    )
    assert (after <= before).all()
    assert after[0] < before[0]


def test_weights_of_each_map_are_those_of_one_by_one() -> None:
    frames = target(noise(32, 2), 32)
    factors = torch.tensor([[2.0, 3.0, 1.0, 4.0, 1.0], [1.0, 1.0, 5.0, 1.0, 2.0]])
    together = with_weights(frames, factors)
    shown = lobe_images.images(alike(Form.ASG, 3, (0, 1)), frames.places).radiance
    for index in range(2):
        which = torch.tensor([index])
        alone = reweighting.with_weights(picked(frames, which), factors[index])
        expected = objective.value(shown[which], alone) / factors[index, 0]
        found = objective.value(shown, together)[which]
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=0)


def test_outcomes_are_put_in_place() -> None:
    frames = target(noise(16, 3), 16)
    every = newton.minimise(alike(Form.ASG, 2, (0, 1, 2)), frames, 1)
    other = newton.minimise(alike(Form.ASG, 2, (3,)), picked(frames, torch.tensor([2])), 1)
    found = put(every, torch.tensor([2]), other)
    assert torch.equal(found.value[:2], every.value[:2])
    assert torch.equal(found.lobes.axes[2], other.lobes.axes[0])
    assert found.shown is not None
    assert other.shown is not None
    assert torch.equal(found.shown.values[2], other.shown.values[0])
    none = torch.zeros(0, dtype=torch.long)
    assert torch.equal(put(every, none, other[none]).value, every.value)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device here")
def test_stills_on_a_gpu_are_as_good_as_on_the_processor() -> None:
    maps = _maps()
    there = fit_stills(maps, 4, device="cuda")
    for found, expected in zip(there, fit_stills(maps, 4), strict=True):
        assert found.lobes.axes.device.type == "cpu"
        assert found.loss == pytest.approx(expected.loss, rel=0.05)
