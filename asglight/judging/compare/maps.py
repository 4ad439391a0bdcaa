# SPDX-License-Identifier: Apache-2.0
"""Every method on the same map at the same number of floats, judged in one way.

A method's map is its mean radiance over the texels of the reference; from there on nothing knows
which method it was. Errors are those of `metrics`, `perceptual` and `spheres`.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from asglight.judging.compare import methods, perceptual, spheres
from asglight.judging.compare.methods import COMPARED, Task
from asglight.judging.compare.spheres import SPHERES, SphereErrors
from asglight.judging.keyed import Keyed
from asglight.judging.metrics import map_errors
from asglight.lobes import Form
from asglight.peers.approximation import LOBE_FLOATS, Approximation

FLOATS = 120
"""Fifteen ASG."""

FLOATS_MIN = max(LOBE_FLOATS.values())
"""One lobe of the dearest kind."""

BALL_SIZE, QUICK_BALL_SIZE = 96, 64
"""Pixels."""

_Item = TypeVar("_Item")


class Follow(Protocol):
    """Shows how far some work is."""

    def __call__(self, items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        """Pass items on and show how many have been."""
        ...


@dataclass(frozen=True)
class Plan:
    """What is compared.

    Attributes:
        names: Methods, keys of `COMPARED`.
        floats: Budget of each.
        full: Whether methods of many steps take all that their sources take.
        quick: Whether they take few, and balls are small.
    """

    names: tuple[str, ...] = tuple(COMPARED)
    floats: int = FLOATS
    full: bool = False
    quick: bool = False


@dataclass(frozen=True)
class Result:
    """One method on one map.

    Attributes:
        name: Key of `COMPARED`.
        floats: Numbers that it used: at most the budget, or those of an image.
        seconds: Processor seconds of the fit, one thread.
        steps: Gradient steps that it took; 0 where it counts none.
        errors: As of `metrics.map_errors`.
        psnr: Of the three balls, in decibels.
        flip: HDR-FLIP of the three balls; None where it is not installed.
        spheres: Errors of the three-sphere protocol by sphere.
        radiance: The method's map.  [H, W, 3]
        balls: The three balls under it.  [3, S, S, 3]
        bytes: Of its numbers, or of the files of an image.
    """

    name: str
    floats: int
    seconds: float
    steps: int
    errors: dict[str, float]
    psnr: float
    flip: float | None
    spheres: dict[str, SphereErrors]
    radiance: Tensor = field(repr=False)
    balls: Tensor = field(repr=False)
    bytes: int = 0


@dataclass(frozen=True)
class Comparison:
    """All methods on one map.

    Attributes:
        reference: The map.  [H, W, 3]
        balls: The three balls under it.  [3, S, S, 3]
        results: One a method.
    """

    reference: Tensor = field(repr=False)
    balls: Tensor = field(repr=False)
    results: tuple[Result, ...]


@dataclass(frozen=True)
class _Fit:
    """What a method returned, what it took, and its map."""

    approximation: Approximation
    seconds: float
    steps: int
    radiance: Tensor


def compare(reference: Tensor, plan: Plan, follow: Follow) -> Comparison:
    """Fit a map with every method and judge them.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        plan: Methods and budget.
        follow: Shows how far this is.
    """
    methods.warm_up(reference, plan.floats // LOBE_FLOATS[Form.ASG])
    fits = [_fit(name, reference, plan, follow) for name in plan.names]
    maps = torch.stack([reference, *(fit.radiance for fit in fits)])
    size = QUICK_BALL_SIZE if plan.quick else BALL_SIZE
    lights = (maps, torch.stack([spheres.tone_mapped(radiance) for radiance in maps]))
    linear, toned = (
        spheres.render(part, size) for part in follow(lights, "rendering balls", len(lights))
    )
    results = [
        _judged(name, fit, (linear[i], toned[i]), (reference, linear[0], toned[0]))
        for i, (name, fit) in enumerate(
            follow(list(zip(plan.names, fits, strict=True)), "judging", len(fits)), start=1
        )
    ]
    return Comparison(reference, linear[0], tuple(results))


def row_title(result: Result) -> str:
    """Return the method of a result, with the part of its steps that it took."""
    method = COMPARED[result.name]
    if result.steps == method.steps:
        return method.title
    return f"{method.title}, {result.steps:,} of {method.steps:,} steps"


def _fit(name: str, reference: Tensor, plan: Plan, follow: Follow) -> _Fit:
    method = COMPARED[name]
    steps = methods.steps_of(method, full=plan.full, quick=plan.quick)
    count = max(steps, 1)
    passed = follow(range(count), f"fitting {name}", count)

    def on_step() -> None:
        next(passed, None)

    on_step()  # takes the first step up; each further call finishes one
    start = time.process_time()
    approximation = methods.run(method, Task(reference, plan.floats, steps, on_step))
    seconds = time.process_time() - start
    if not steps:
        on_step()
    radiance = approximation.texel_means(*reference.shape[:2])
    return _Fit(approximation, seconds, steps, radiance)


def _judged(
    name: str, fit: _Fit, balls: Sequence[Tensor], wanted: tuple[Tensor, Tensor, Tensor]
) -> Result:
    """Compare a method's map, balls and balls of the protocol with those of the reference."""
    (linear, toned), (reference, wanted_linear, wanted_toned) = balls, wanted
    return Result(
        name=name,
        floats=fit.approximation.floats,
        seconds=fit.seconds,
        steps=fit.steps,
        errors=map_errors(fit.radiance, reference).values,
        psnr=perceptual.psnr(linear, wanted_linear),
        flip=perceptual.hdr_flip(linear, wanted_linear),
        spheres={
            sphere: spheres.sphere_errors(toned[i], wanted_toned[i])
            for i, sphere in enumerate(SPHERES)
        },
        radiance=fit.radiance,
        balls=linear,
        bytes=size_of(fit.approximation),
    )


def size_of(found: Approximation) -> int:
    """Return the bytes of a method's numbers, four each; of an image, those of its files."""
    return found.bytes if isinstance(found, Keyed) else 4 * found.floats
