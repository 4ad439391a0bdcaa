# SPDX-License-Identifier: Apache-2.0
"""What is compiled against the same in torch and float64, and where it serves."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import compiled_parts
import pytest
import torch
from adaptive_cases import CENTRES, POLES, lobes_at, plain_cells, refined_cells
from lobe_cases import DOUBLE, alike, noise
from torch import Tensor

from asglight import c_library as library
from asglight.fitting import compiled
from asglight.fitting.loss import (
    adaptive_cells,
    coordinates,
    lobe_images,
    objective,
    probes,
    temporal,
)
from asglight.fitting.loss.grid import POWERS
from asglight.fitting.steps import equations, light, newton
from asglight.lobes import Form, Lobes
from asglight.lobes import data as lobe_data

pytestmark = pytest.mark.skipif(
    compiled.LIBRARY is None and library.compiler() is None, reason="there is no C compiler"
)


def _doubled(value: Any) -> Any:
    """Return a dataclass with float64 in the place of float32; no compiled step serves that."""
    if isinstance(value, Tensor):
        return value.double() if value.is_floating_point() else value
    if isinstance(value, list):
        return [_doubled(each) for each in value]
    if not hasattr(value, "__dataclass_fields__"):
        return value
    found = {each.name: _doubled(getattr(value, each.name)) for each in fields(value)}
    if "monomials" in found:  # their squares were rounded
        x, y, z = found["monomials"].unbind(-2)[1:4]
        found["monomials"] = torch.stack([x**i * y**j * z**k for i, j, k in POWERS], dim=-2)
    return replace(value, **found)


@pytest.fixture
def in_torch(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Call a function with what it is given in float64, grids too, and so in torch."""
    grids = {module: module.grid for module in (adaptive_cells, equations)}

    def call(function: Callable[..., Any], *given: Any, **others: Any) -> Any:
        with monkeypatch.context() as patch:
            for module, grid in grids.items():
                fine = lambda height, device, grid=grid: _doubled(grid(height, device))  # noqa: E731
                patch.setattr(module, "grid", fine)
            doubled = {name: _doubled(value) for name, value in others.items()}
            return function(*(_doubled(each) for each in given), **doubled)

    return call


def _maps(frames: int, rows: int = 64) -> Tensor:
    """Return maps of noise and a lamp that a few texels hold.  [F, 3, P]."""
    maps = noise(rows, frames)
    maps[..., rows * rows + 7] += 200.0
    return maps


ADAPTIVE_CELLS = {
    "cells": (32, 32, 0),
    "cells and texels": (64, 32, 8),
    "a grid that is filtered as it is": (16, 16, 0),
    "few rows": (24, 12, 4),
}
"""Rows of the map, rows of cells and refined cells."""

COUNTS = [1, 4, 5, 8, 15, 17]
"""Lobes, below and above what fills half a vector, one and two."""


def _case(name: str, count: int, frames: int = 2) -> tuple[Lobes, objective.Target]:
    rows, cells, refined = ADAPTIVE_CELLS[name]
    maps = _maps(frames, rows)
    frame = objective.target(maps, places=adaptive_cells.adaptive_cells(maps, cells, refined))
    return alike(Form.ASG, count, tuple(range(frames))), frame


def _check_near(found: Tensor, expected: Tensor, share: float) -> None:
    """Check that no element is off by more than a share of the largest."""
    assert torch.isfinite(found).all()
    off = (found.double() - expected.double()).abs().max() if found.numel() else torch.zeros(())
    assert float(off) <= share * max(float(expected.abs().max()) if expected.numel() else 0, 1e-30)


def test_what_is_compiled_is_compiled_here() -> None:
    assert compiled.LIBRARY is not None, "run: make setup"


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ADAPTIVE_CELLS)
def test_a_step_is_that_of_torch_in_float64(
    name: str, count: int, in_torch: Callable[..., Any]
) -> None:
    lobes, frame = _case(name, count)
    shown = lobe_images.images(lobes, frame.places)
    exact = in_torch(lobe_images.images, lobes, frame.places)
    # directions in float32, times the slope of lobes of sharpness 100
    for what in ("values", "gaussian", "scale"):
        _check_near(getattr(shown, what), getattr(exact, what), 1e-5)
    sizes = objective.loss_terms(shown.radiance, frame)
    for what, value in vars(in_torch(objective.loss_terms, shown.radiance, frame)).items():
        _check_near(getattr(sizes, what), value, 1e-5)
    loss_gradient = objective.loss_gradient(shown.radiance, frame, sizes)
    expected = in_torch(objective.loss_gradient, shown.radiance, frame, sizes)
    for what, value in vars(expected).items():
        _check_near(getattr(loss_gradient, what), value, 1e-5)
    found = equations.normal_equations(shown, loss_gradient, frame)
    expected = in_torch(equations.normal_equations, shown, loss_gradient, frame)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == DOUBLE
        _check_near(one, other, 1e-4)  # sums of a thousand products, some of which cancel


@pytest.mark.parametrize("sharpness", [(1e-3, 1e-3), (3e3, 200.0), (4e4, 4e4), (1e6, 1e6)])
def test_lobes_of_any_width_are_drawn(
    sharpness: tuple[float, float], in_torch: Callable[..., Any]
) -> None:
    for places in (refined_cells(), plain_cells(32)):
        lobes = lobes_at(Form.ASG, [*CENTRES, *POLES], list(sharpness)).to(torch.float32)[None]
        shown = lobe_images.images(lobes, places)
        exact = in_torch(lobe_images.images, lobes, places)
        # components in float32 are off by 1e-7, times the slope of what a texel sees, at most 170
        _check_near(shown.values, exact.values, 3e-5)
        _check_near(shown.scale, exact.scale, 3e-5)


def test_frames_that_share_their_map_are_as_if_each_had_its_own() -> None:
    lobes, frame = _case("cells and texels", 5, 1)
    many = lobe_data.stack([lobes[0]] * 3)
    for shared in (frame.places, frame.places.repeated(3)):
        shown = lobe_images.images(many, shared)
        assert torch.equal(shown.values[2], lobe_images.images(lobes, frame.places).values[0])
    alone = objective.loss_terms(shown.radiance[:1], frame)
    for target in (frame, frame.repeated(3)):
        found = objective.loss_terms(shown.radiance, target)
        assert torch.equal(found.value, alone.value.expand(3))
        slope = objective.loss_gradient(shown.radiance, target, found).slope
        assert torch.equal(
            slope[2], objective.loss_gradient(shown.radiance[:1], frame, alone).slope[0]
        )


def _equations(lobes: Lobes) -> tuple[Tensor, Tensor]:
    """Return a matrix far from singular and a slope, in float64."""
    generator = torch.Generator().manual_seed(0)
    frames, size = len(lobes.axes), 8 * lobes.count
    root = torch.randn(frames, size, 2 * size, generator=generator, dtype=DOUBLE)
    scale = 10 ** (3 * torch.rand(size, generator=generator, dtype=DOUBLE))
    root = root * scale[:, None]
    return root @ root.mT, torch.randn(frames, size, generator=generator, dtype=DOUBLE)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("some_stay", [False, True])
def test_the_solved_step_is_that_of_torch(count: int, some_stay: bool) -> None:
    lobes = alike(Form.ASG, count, (0, 1))
    lobes.amplitude[0, 0] = 0.0  # at its bound
    lobes.sharpness[1, 0] = 1e-3
    hessian, gradient = _equations(lobes)
    hessian[0, 3] = hessian[0, :, 3] = 0.0  # nothing sees it
    damping = torch.tensor([1e-3, 10.0], dtype=DOUBLE)
    still = torch.zeros(2, count, dtype=torch.bool) if some_stay else None
    if still is not None:
        still[1, -1] = True
    expected = equations.solve(hessian, gradient, lobes, damping, still)
    found = compiled_parts.solve(hessian, gradient, lobes, damping, still)
    # both in float64; what differs is the order of a hundred thousand products
    torch.testing.assert_close(found, expected, rtol=1e-8, atol=1e-10)
    assert bool((found[0, 0, 5:][gradient[0, 5:8] > 0] == 0).all())


@pytest.mark.parametrize("solve", [compiled_parts.solve, equations.solve])
def test_a_system_that_is_not_definite_gives_no_step(solve: Callable[..., Tensor]) -> None:
    lobes = alike(Form.ASG, 2)
    hessian, gradient = _equations(lobes)
    hessian[0, 4, 5] = hessian[0, 5, 4] = 1e3 * hessian.abs().max()
    step = solve(hessian, gradient, lobes, torch.zeros(1, dtype=DOUBLE), None)
    assert torch.equal(step, torch.zeros_like(step))


@pytest.mark.parametrize("size", [1e-3, 0.3, 30.0])
def test_lobes_move_as_in_torch(size: float, in_torch: Callable[..., Any]) -> None:
    lobes = alike(Form.ASG, 15, (0, 1))
    generator = torch.Generator().manual_seed(1)
    step = size * torch.randn(2, 15, 8, generator=generator, dtype=DOUBLE)
    found = compiled_parts.advance(lobes, step, 1e-2)
    expected = in_torch(coordinates.advance, lobes, step, 1e-2)
    # sinh of a shear that is no shear is lost a little in float32
    _check_near(found.axes, expected.axes, 1e-6)
    torch.testing.assert_close(found.sharpness.double(), expected.sharpness, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(found.amplitude.double(), expected.amplitude, rtol=1e-5, atol=1e-6)


def test_the_temporal_term_is_that_of_torch(in_torch: Callable[..., Any]) -> None:
    lobes, before = alike(Form.ASG, 7, (0, 1)), alike(Form.ASG, 7, (2, 3))
    held = temporal.prior(before)
    value, *found = compiled_parts.term(lobes, held)
    _check_near(value, in_torch(temporal.value, lobes, held), 1e-6)
    for one, other in zip(found, in_torch(temporal.slopes, lobes, held), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-9)


def _near(name: str, count: int, held: str) -> tuple[Lobes, objective.Target, dict[str, Any]]:
    """Return lobes near those that a map shows, the map, and what holds them."""
    truth, frame = _case(name, count)
    shown = lobe_images.images(truth, frame.places).radiance
    parts = shown[:, None, :, : frame.places.count].expand_as(frame.parts).contiguous()
    frame = replace(frame, radiance=shown, parts=parts)
    generator = torch.Generator().manual_seed(3)
    step = 0.1 * torch.randn(2, count, 8, generator=generator, dtype=DOUBLE)
    lobes = coordinates.advance(truth, step)
    others: dict[str, Any] = {"damping": 1e-2, "width_min": 1e-2}
    if held != "none":
        others["priors"] = [temporal.prior(truth), temporal.prior(lobes)]
        others["still"] = torch.arange(count).expand(2, count) == 4
    return lobes, frame, others


@pytest.mark.parametrize(
    ("count", "held", "steps"),
    [(1, "none", 1), (8, "none", 3), (15, "none", 1), (15, "none", 3), (15, "held", 3)],
)
@pytest.mark.parametrize("name", ADAPTIVE_CELLS)
def test_steps_are_those_of_torch_in_float64(
    name: str, count: int, held: str, steps: int, in_torch: Callable[..., Any]
) -> None:
    lobes, frame, others = _near(name, count, held)
    found = newton.minimise(lobes, frame, steps, tolerance=0.0, **others)
    exact = in_torch(newton.minimise, lobes, frame, steps, tolerance=0.0, **others)
    start = in_torch(newton.minimise, lobes, frame, 0, **others).value
    assert bool((exact.value < 0.9 * start).all())
    assert torch.equal(found.damping, exact.damping)
    # J is a difference of sums in float32; each step multiplies what the one before rounded
    torch.testing.assert_close(found.value / start, exact.value / start, rtol=1e-3, atol=3e-5)
    _check_near(found.lobes.axes, exact.lobes.axes, 1e-3)
    torch.testing.assert_close(
        found.lobes.sharpness.double(), exact.lobes.sharpness, rtol=1e-2, atol=1e-3
    )
    again = lobe_images.images(found.lobes, frame.places)
    assert found.shown is not None
    for what in ("values", "gaussian", "scale"):
        assert torch.equal(getattr(found.shown, what), getattr(again, what))
    if held != "none":
        _check_near(found.lobes.axes[:, 4], lobes.axes[:, 4], 1e-6)


def test_frames_side_by_side_take_the_steps_that_each_takes_alone() -> None:
    lobes, frame, _ = _near("cells and texels", 5, "none")
    seldom = replace(frame, radiance=frame.radiance.clone(), parts=frame.parts.clone())
    seldom.radiance[1] *= 3.0
    seldom.parts[1] *= 3.0
    found = newton.minimise(lobes, seldom, 5, tolerance=0.0)
    for index in range(2):
        places = {
            name: value[[index]] if isinstance(value, Tensor) else value
            for name, value in vars(seldom.places).items()
            if name != "compiled"
        }
        own = {
            name: value[[index]] if isinstance(value, Tensor) else value
            for name, value in vars(seldom).items()
            if name not in ("compiled", "places")
        }
        single = objective.Target(places=adaptive_cells.AdaptiveCells(**places), **own)
        alone = newton.minimise(lobes[[index]], single, 5, tolerance=0.0)
        assert torch.equal(found.value[[index]], alone.value)
        assert torch.equal(found.lobes.axes[[index]], alone.lobes.axes)


def test_steps_may_be_taken_after_a_step() -> None:
    lobes, frame, others = _near("cells and texels", 15, "one")
    inner, other, _ = _near("cells", 8, "none")
    alone = newton.minimise(inner, other, 3, on_step=lambda _: None)
    found: list[newton.Outcome] = []

    def after(_: Lobes) -> None:
        found.append(newton.minimise(inner, other, 3, on_step=lambda _: None))

    outer = newton.minimise(lobes, frame, 3, tolerance=0.0, on_step=after, **others)
    quiet = newton.minimise(lobes, frame, 3, tolerance=0.0, **others)
    assert torch.equal(outer.lobes.axes, quiet.lobes.axes)
    assert torch.equal(outer.value, quiet.value)
    assert len(found) == 3
    assert all(torch.equal(each.value, alone.value) for each in found)


def test_steps_without_gain_leave_lobes_as_they_are() -> None:
    truth, frame, _ = _near("cells and texels", 5, "none")
    best = newton.minimise(truth, frame, 200, tolerance=0.0)
    assert bool((best.damping == newton.DAMPING_MAX).all())  # all fail from there
    found = newton.minimise(best.lobes, frame, 3, tolerance=0.0, damping=newton.DAMPING_MAX)
    assert torch.equal(found.lobes.axes, best.lobes.axes)
    assert found.shown is not None
    assert best.shown is not None
    assert torch.equal(found.shown.values, best.shown.values)
    assert torch.equal(found.value, best.value)


def test_each_step_is_reported_and_changes_nothing() -> None:
    lobes, frame, others = _near("cells and texels", 15, "one")
    seen: list[Lobes] = []
    found = newton.minimise(lobes, frame, 4, tolerance=0.0, on_step=seen.append, **others)
    quiet = newton.minimise(lobes, frame, 4, tolerance=0.0, **others)
    for steps, each in enumerate(seen, 1):
        alone = newton.minimise(lobes, frame, steps, tolerance=0.0, **others)
        assert torch.equal(each.axes, alone.lobes.axes)
    assert len(seen) == 4
    assert torch.equal(found.lobes.amplitude, quiet.lobes.amplitude)


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError("told to end")])
def test_what_is_raised_after_a_step_ends_the_steps(error: Any) -> None:
    lobes, frame, others = _near("cells and texels", 5, "none")
    calls: list[Lobes] = []

    def after(each: Lobes) -> None:
        calls.append(each)
        if len(calls) == 2:
            raise error

    with pytest.raises(KeyboardInterrupt if error is KeyboardInterrupt else RuntimeError):
        newton.minimise(lobes, frame, 9, tolerance=0.0, on_step=after, **others)
    assert len(calls) == 2


@pytest.mark.parametrize("rows", [16, 50, 64, 65])
def test_few_images_are_probed_to_the_bit_as_among_many(rows: int) -> None:
    images = torch.randn(11, 2 * rows * rows, generator=torch.Generator().manual_seed(rows))
    among = probes.probe(images, rows)
    for first, last in ((0, 1), (2, 5), (7, 11)):
        assert torch.equal(probes.probe(images[first:last], rows), among[first:last])


@pytest.mark.parametrize("rows", [7, 10, 32, 64])
@pytest.mark.parametrize("count", [1, 3, 15])
def test_probes_show_what_they_do_in_torch(
    rows: int, count: int, in_torch: Callable[..., Any]
) -> None:
    images = noise(rows, count)[:, 0]
    # filters in float32, a row of 2 H of them a product
    _check_near(probes.probe(images, rows), in_torch(probes.probe, images, rows), 1e-5)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ADAPTIVE_CELLS)
def test_what_is_asked_of_the_light_is_that_of_torch(
    name: str, count: int, in_torch: Callable[..., Any]
) -> None:
    lobes, frame = _case(name, count)
    found = light._normal_equations(lobe_images.images(lobes, frame.places), frame)
    shown = in_torch(lobe_images.images, lobes, frame.places)
    for one, other in zip(found, in_torch(light._normal_equations, shown, frame), strict=True):
        assert one.dtype == DOUBLE
        _check_near(one, other, 1e-5)  # of images in float32


def test_lobes_that_coincide_have_equal_rows() -> None:
    lobes, frame = _case("cells and texels", 5)
    both = lobes.select(torch.tensor([0, 3, 1, 3]))
    gram, slope = light._normal_equations(lobe_images.images(both, frame.places), frame)
    assert torch.equal(gram[:, 1], gram[:, 3])
    assert torch.equal(gram[:, :, 1], gram[:, :, 3])
    assert torch.equal(slope[:, 1], slope[:, 3])
