# SPDX-License-Identifier: Apache-2.0
"""Steps on frames side by side, on the host and on a device; what passes from step to step."""

import pytest
import torch
from lobe_cases import DOUBLE, KNOWN, alike, flat, noise, target
from tape import Tape, on_device
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.steps import newton
from asglight.fitting.steps.captured import Replays
from asglight.lobes import Form, Lobes, texels


def _pair() -> tuple[Lobes, objective.Target]:
    """Return two frames' lobes and maps; with little damping the first's first step fails."""
    maps = torch.cat([noise(), flat(texels.texel_means(KNOWN, 32, 64)[None])])
    return alike(Form.ASG, seeds=(59, 11)), objective.target(maps)


@pytest.mark.parametrize("form", list(Form))
def test_frames_of_a_batch_do_not_see_each_other(form: Form) -> None:
    maps = noise(64, 2) * torch.tensor([1.0, 30.0])[:, None, None]
    lobes, frame = alike(form, seeds=(0, 6)), target(maps, 32, 8)
    held = temporal.prior(lobes)
    both = newton.minimise(lobes, frame, 4, priors=[held], tolerance=0.0)
    for index in range(2):
        one = lobes[index : index + 1]
        single = target(maps[index : index + 1], 32, 8)
        alone = newton.minimise(one, single, 4, priors=[temporal.prior(one)], tolerance=0.0)
        # float32 sums in another order, grown by four steps
        torch.testing.assert_close(both.value[index], alone.value[0], rtol=1e-3, atol=0)
        torch.testing.assert_close(both.lobes.axes[index], alone.lobes.axes[0], rtol=0, atol=1e-2)
        for name in ("sharpness", "amplitude"):
            found, expected = getattr(both.lobes, name)[index], getattr(alone.lobes, name)[0]
            torch.testing.assert_close(found, expected, rtol=3e-2, atol=1e-3)
        assert float(both.damping[index]) == float(alone.damping[0])


def test_a_frame_whose_step_fails_keeps_its_lobes_while_the_other_is_taken() -> None:
    lobes, frame = _pair()
    damping = torch.full((2,), 1e-6, dtype=DOUBLE)
    found = newton.minimise(lobes, frame, 1, damping=damping)
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(found.lobes, name)[0], getattr(lobes, name)[0])
        assert not torch.equal(getattr(found.lobes, name)[1], getattr(lobes, name)[1])
    before = objective.value(lobe_images.images(lobes, frame.places).radiance, frame)
    assert float(found.value[0]) == pytest.approx(float(before[0]), rel=1e-6)  # the same sums
    assert float(found.value[1]) < float(before[1])
    assert found.damping.tolist() == pytest.approx([5e-6, newton.DAMPING_MIN])


@pytest.mark.usefixtures("torch_steps")
def test_steps_decided_on_the_device_are_those_decided_on_the_host(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(newton, "REPLAYS", Replays(Tape))
    lobes, frame = _pair()
    damping = torch.full((2,), 1e-6, dtype=DOUBLE)
    there = on_device(lobes)
    assert there.axes.is_cuda
    for steps in (1, 2, 6):
        host = newton.minimise(lobes, frame, steps, damping=damping, tolerance=0.0)
        device = newton.minimise(there, frame, steps, damping=damping, tolerance=0.0)
        # the same arithmetic: only the order of decisions differs
        assert torch.equal(host.damping, device.damping)
        torch.testing.assert_close(host.value, device.value, rtol=1e-6, atol=0)
        torch.testing.assert_close(host.lobes.axes, device.lobes.axes, rtol=0, atol=1e-6)
    seen: list[Lobes] = []
    newton.minimise(there, frame, 9, tolerance=1.0, on_step=seen.append)
    assert len(seen) == 9  # and no step waits to learn that it was the last


def _tensors(state: newton._State) -> tuple[Tensor, ...]:
    shown, sizes = state.shown, state.sizes
    shape = (shown.lobes.axes, shown.lobes.sharpness, shown.lobes.amplitude)
    images = (shown.values, shown.gaussian, shown.scale)
    errors = (sizes.value, sizes.parts, sizes.texels, sizes.views, sizes.seen)
    return (*shape, *images, *errors, state.value)


@pytest.mark.parametrize("form", list(Form))
def test_each_frame_is_chosen_whole_from_one_state_or_the_other(form: Form) -> None:
    frame = target(noise(32, 3), 16, 4)
    tried, before = (
        newton._judged(lobe_images.images(alike(form, seeds=seeds), frame.places), frame, ())
        for seeds in ((0, 1, 2), (3, 4, 5))
    )
    chosen = newton._chosen(torch.tensor([True, False, True]), tried, before)
    for index, source in ((0, tried), (1, before), (2, tried)):
        for found, expected in zip(_tensors(chosen), _tensors(source), strict=True):
            assert torch.equal(found[index], expected[index])
    assert chosen.shown.lobes.form is form


def test_best_is_the_frame_with_the_least_loss() -> None:
    lobes = alike(Form.ASG, seeds=(0, 1, 2))
    value, damping = torch.tensor([3.0, 1.0, 2.0]), torch.tensor([0.1, 0.2, 0.3])
    best = newton.Outcome(lobes, value, damping).best()
    assert torch.equal(best.lobes.axes, lobes.axes[1:2])
    assert torch.equal(best.lobes.amplitude, lobes.amplitude[1:2])
    assert best.value.tolist() == [1.0]
    assert best.damping.tolist() == pytest.approx([0.2])


def test_lobes_whose_images_are_known_take_the_same_steps() -> None:
    frame = target(noise(32, 1), 16, 4)
    lobes = alike(Form.ASG, seeds=(0,))
    shown = lobe_images.images(lobes, frame.places)
    plain = newton.minimise(lobes, frame, 3)
    known = newton.minimise(lobes, frame, 3, shown=shown)
    assert torch.equal(known.lobes.axes, plain.lobes.axes)
    assert torch.equal(known.value, plain.value)
    # and what comes out is what the lobes show
    again = lobe_images.images(known.lobes, frame.places)
    assert known.shown is not None
    assert torch.equal(known.shown.radiance, again.radiance)
    assert torch.equal(known.best().shown.radiance, again.radiance)
