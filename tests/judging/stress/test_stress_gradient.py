# SPDX-License-Identifier: Apache-2.0
"""The check of the fit's derivative: its own J is the fit's, and it finds a wrong gradient."""

import pytest
import torch

from asglight.fitting.first_frame.fit import exposed
from asglight.fitting.loss import adaptive_cells, lobe_images, objective
from asglight.fitting.steps import equations
from asglight.judging.stress import gradient as stress_gradient
from asglight.judging.stress.maps import constant, lobe, sun_and_sky, together, toward
from asglight.lobes import Form, Lobes


def lamps(form: Form = Form.ASG) -> Lobes:
    return together(
        lobe((0.0, 1.0, 0.2), 2.0, (0.3, 0.4, 0.9), form=form),
        lobe(toward(50, 35), 300.0, 200.0, form=form),
        lobe(toward(-60, -10), 40.0, (0.5, 0.0, 0.1), form=form),
    )


@pytest.mark.parametrize("form", list(Form))
def test_the_derivative_of_the_fit_is_that_of_its_loss(form: Form) -> None:
    error = stress_gradient.gradient_error(lamps(form), sun_and_sky())
    assert error is not None
    assert error < 2e-3  # float32, and a texel's shape that is held


def test_the_loss_written_down_once_more_is_the_loss_of_the_fit() -> None:
    frame = exposed(sun_and_sky())
    places = adaptive_cells.adaptive_cells(
        frame.radiance, stress_gradient.ROWS, stress_gradient.REFINED
    )
    target = objective.target(frame.radiance, objective.Corners(), places)
    values = []
    for lobes in (lamps(), lamps().select(torch.tensor([0, 2]))):
        own = lobes.to(torch.float32)[None]
        plain = stress_gradient._loss(own.to(torch.float64), target)
        shown = lobe_images.images(own, places).radiance
        values.append((float(plain), float(objective.value(shown, target))))
    (first, first_fit), (second, second_fit) = values
    # the constant that the fit leaves out is the same for both; float32 sums
    assert first - second == pytest.approx(first_fit - second_fit, rel=1e-4)


@pytest.mark.parametrize("factor", [1.1, 0.0, -1.0])
def test_a_gradient_that_is_wrong_is_off_by_that(
    factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = equations.normal_equations

    def wrong(*arguments: object) -> tuple[torch.Tensor, torch.Tensor]:
        hessian, gradient = exact(*arguments)  # pyright: ignore
        gradient = gradient.clone()
        gradient[:, ::8] *= factor  # the first tilt of each lobe
        gradient[:, 2::8] *= factor  # and a width
        return hessian, gradient

    monkeypatch.setattr(equations, "normal_equations", wrong)
    error = stress_gradient.gradient_error(lamps(), sun_and_sky())
    assert error is not None
    assert error > 0.02


def test_there_is_nothing_to_differentiate_in_a_black_map() -> None:
    assert stress_gradient.gradient_error(lamps(), constant(0.0)) is None
