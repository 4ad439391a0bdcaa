# SPDX-License-Identifier: Apache-2.0
"""Whole fits on a device apart from the host (elsewhere.py): nothing is left behind."""

from collections.abc import Iterator

import pytest
import torch
from elsewhere import DEVICE, Elsewhere, watched
from lobe_cases import sky_and_sun

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.first_frame import other_forms, reweighting, seeding, split_merge
from asglight.fitting.first_frame.fit import Level, fit_first_frame
from asglight.fitting.following.next_frame import LIVE, fit_next_frame
from asglight.fitting.following.whole_shot import Refinement, refine_shot
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import newton
from asglight.fitting.stills import fit_stills, fits, splitting
from asglight.fitting.stills import reweighting as stills_reweighting
from asglight.lobes import Form
from asglight.lobes.data import stack

LEVELS = (Level(1, Corners(), rounds=1),)
SHORT = first_frame.FirstFrameSettings((None, 4.0), LEVELS, (0.5,) * 5, 1, again=1)

MIDDLING = first_frame.FirstFrameSettings((4.0,), LEVELS, (9.0,) * 5, 1)
"""Nothing lags behind."""

REFINEMENT = Refinement(steps=2)

pytestmark = pytest.mark.usefixtures("torch_steps")


@pytest.fixture(autouse=True)
def _without_graphs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(newton, "REPLAYED_FRAMES", 0)


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take each kind of step, once or twice: all of a kind are on the same device."""
    for module in (split_merge, splitting):
        for name in ("SETTLING_STEPS", "TRIAL_STEPS", "STEPS"):
            monkeypatch.setattr(module, name, 1)
    for module in (reweighting, stills_reweighting, other_forms):
        monkeypatch.setattr(module, "STEPS", 1)
    for module in (reweighting, stills_reweighting):
        monkeypatch.setattr(module, "ROUNDS", 2)
    for name in ("EM_STEPS", "EVEN_STEPS"):
        monkeypatch.setattr(seeding, name, 2)


@pytest.mark.slow
def test_a_first_frame_stays_on_the_device() -> None:
    reference = sky_and_sun(0.0, 16)
    with watched(), torch.inference_mode():
        found = fit_first_frame(reference.to(DEVICE), 3, None, SHORT)
        assert isinstance(found.lobes.axes, Elsewhere)
        there = found.lobes.to("cpu")
    expected = fit_first_frame(reference, 3, None, SHORT)
    assert found.loss == pytest.approx(expected.loss, rel=1e-3)
    torch.testing.assert_close(there.axes, expected.lobes.axes, rtol=0, atol=1e-2)


def test_a_next_frame_stays_on_the_device() -> None:
    first = fit_first_frame(sky_and_sun(0.0, 16), 3, Form.ASG, SHORT).lobes
    reference = sky_and_sun(8.0, 16)
    with watched(), torch.inference_mode():
        found = fit_next_frame(reference.to(DEVICE), first.to(DEVICE), None, LIVE)
        assert isinstance(found.lobes.axes, Elsewhere)
    expected = fit_next_frame(reference, first, None, LIVE)
    assert found.loss == pytest.approx(expected.loss, rel=1e-2)


@pytest.mark.slow
def test_the_pass_over_a_shot_stays_on_the_device() -> None:
    maps = [sky_and_sun(degrees, 16) for degrees in (0.0, 4.0, 8.0)]
    shot = stack([fit_first_frame(maps[0], 3, Form.ASG, SHORT).lobes] * 3)

    def there() -> Iterator[list[first_frame.Exposed]]:
        yield [first_frame.exposed(each.to(DEVICE)) for each in maps]

    with watched(), torch.inference_mode():
        _, losses = refine_shot(shot, there, REFINEMENT)
    expected = refine_shot(shot, lambda: [[first_frame.exposed(each) for each in maps]], REFINEMENT)
    # there every step is taken, here none after one that gains too little
    assert losses == pytest.approx(expected[1], rel=3e-2)


def test_stills_stay_on_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fits, "SETTINGS", MIDDLING)
    maps = [sky_and_sun(degrees, 16) for degrees in (0.0, 50.0)]
    with watched():
        found = fit_stills(maps, 3, device=str(DEVICE))
    for fit, expected in zip(found, fit_stills(maps, 3), strict=True):
        assert fit.lobes.axes.device.type == "cpu"
        assert fit.loss == pytest.approx(expected.loss, rel=1e-3)


def test_what_was_left_behind_is_found() -> None:
    with watched():
        there = torch.zeros(3, device=DEVICE)
        assert (there + torch.tensor(1.0)).tolist() == [1.0, 1.0, 1.0]  # a single number may be
        assert there.new_tensor([1.0, 2.0])[[1, 0]].tolist() == [2.0, 1.0]  # and so may indices
        assert torch.tensor([1, 2], device=DEVICE).sum().item() == 3
        assert (there.to("cpu") + torch.ones(3)).sum() == 3
        with pytest.raises(AssertionError, match=r"aten::add: a tensor \(3,\) was left on the hos"):
            there + torch.ones(3)
    with pytest.raises(AssertionError, match="outside of"):
        there + 1
