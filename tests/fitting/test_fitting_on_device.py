# SPDX-License-Identifier: Apache-2.0
"""Steps on a device apart from the host, by torch's own one without data.

What mixes devices or reads a value fails there; on a GPU it would fail or wait.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from lobe_cases import alike, noise, target
from tape import tensors_among
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from asglight.fitting.loss import lobe_images, temporal
from asglight.fitting.steps import newton
from asglight.fitting.steps.captured import kind_of, mapped
from asglight.lobes import Form, asg

DEVICE = torch.device("meta")


class _OnlyThere(TorchDispatchMode):
    """Refuses what is made on the host or comes from there."""

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        out = func(*args, **(kwargs or {}))
        for tensor in tensors_among((args, out)):
            assert tensor.device == DEVICE, f"{func}: a tensor on {tensor.device}"
        return out


def _brought(data: Any, *_: Any, **__: Any) -> Tensor:
    assert isinstance(data, Tensor), f"{data} brought along"
    return data


def _new(like: Tensor, data: Any, **_: Any) -> Tensor:
    return _brought(data)


@contextmanager
def _only_there() -> Iterator[None]:
    """Refuse all that a step on a device must not do: no mode sees tensors made of numbers."""
    with pytest.MonkeyPatch.context() as patched, _OnlyThere():
        for name in ("tensor", "as_tensor", "asarray", "from_numpy"):
            patched.setattr(torch, name, _brought)
        patched.setattr(Tensor, "new_tensor", _new)
        yield


def _start(form: Form, frames: int, held: bool) -> tuple[newton._Progress, newton.Setting]:
    """Return where a step begins, as a pass over a shot takes it if lobes are held.

    There each neighbour has a prior, and some lobes stay.
    """
    lobes = alike(form, seeds=tuple(range(frames)))
    frame = target(noise(64, frames), 32, 8)
    priors, still = (), None
    if held:
        priors = (temporal.prior(lobes, 0.05),) * 2
        still = asg.flux(lobes).sum(-1) < asg.flux(lobes).sum(-1).mean(-1, keepdim=True)
    state = newton._judged(lobe_images.images(lobes, frame.places), frame, priors)
    damping = torch.full((frames,), 0.01, dtype=torch.float64)
    return (state, damping), newton.Setting(frame, priors, 0.003, still)


def _there(value: Any) -> Any:
    """Return a value's like on the device."""
    return mapped(value, lambda tensor: tensor.to(DEVICE))


@pytest.mark.parametrize(
    ("form", "frames", "held"),
    # lobes of each form, and what they are held by, are taken apart from each other
    [
        *((Form.ASG, *case) for case in ((1, False), (1, True), (4, True))),
        *((form, 4, True) for form in Form if form is not Form.ASG),
    ],
)
def test_a_step_stays_on_the_device(form: Form, frames: int, held: bool) -> None:
    progress, given = map(_there, _start(form, frames, held))
    newton._step(progress, given)  # brings constants there, which stay
    with _only_there():
        found = newton._step(progress, given)
    assert kind_of(found) == kind_of(progress)  # the next one can start there


def test_a_narrowest_width_and_one_size_of_leaves_stay_there_too() -> None:
    lobes, frame = alike(Form.ASG), target(noise(32), 32)
    state = newton._judged(lobe_images.images(lobes, frame.places), frame, ())
    start = (state, torch.full((1,), 0.01, dtype=torch.float64))
    progress, given = map(_there, (start, newton.Setting(frame, (), 0.0)))
    newton._step(progress, given)
    with _only_there():
        found = newton._step(progress, given)
    assert kind_of(found) == kind_of(progress)


@pytest.mark.parametrize(
    "waits",
    [
        lambda flags: bool(flags.any()),
        lambda flags: flags[flags],
        lambda flags: flags.tolist(),
        lambda flags: flags & torch.ones(3, dtype=torch.bool),
        lambda flags: flags & torch.tensor([True, False, True]),
        lambda flags: torch.where(flags, torch.zeros(3), 1.0),
        lambda flags: flags.new_tensor([True]),
        lambda flags: torch.as_tensor([1.0, 2.0], device=DEVICE),
    ],
)
def test_what_waits_or_brings_something_along_is_found(waits: Callable[[Tensor], Any]) -> None:
    flags = torch.empty(3, dtype=torch.bool, device=DEVICE)
    with pytest.raises((AssertionError, RuntimeError)), _only_there():
        waits(flags)
