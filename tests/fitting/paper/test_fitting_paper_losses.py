# SPDX-License-Identifier: Apache-2.0
"""The six losses of the paper's comparison against sums in float64, and their slopes."""

import math

import numpy as np
import pytest
import scipy.special
import torch
from lobe_cases import DOUBLE, random_lobes, sky_and_sun
from torch import Tensor

from asglight.fitting.paper import fit as paper
from asglight.fitting.paper import losses as paper_losses
from asglight.fitting.paper.losses import Loss, frame_loss, srgb_curve, target
from asglight.lobes import Form, Lobes, asg
from asglight.sphere import latlong

HEIGHT = 16


def reference() -> Tensor:
    return sky_and_sun(15.0, HEIGHT).double()


def light_map(radiance: np.ndarray, omega: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return irradiance over pi from degree-3 harmonics, by scipy's complex ones."""
    x, y, z = directions.T
    result = np.zeros_like(radiance)
    for degree, factor in ((0, 1.0), (1, 2 / 3), (2, 1 / 4), (3, 0.0)):  # A_l over pi
        for order in range(-degree, degree + 1):
            harmonic = scipy.special.sph_harm_y(degree, order, np.arccos(z), np.arctan2(y, x))
            coefficients = (omega * np.conj(harmonic)) @ radiance
            result += factor * np.real(harmonic[:, None] * coefficients)
    return result


def expected(loss: Loss, fit: np.ndarray, truth: np.ndarray) -> float:
    """Return the loss as the head of paper_losses.py words it, in NumPy.  [P, 3] each."""
    directions = latlong.directions(HEIGHT, 2 * HEIGHT, dtype=DOUBLE).reshape(-1, 3).numpy()
    omega = latlong.texel_solid_angles(HEIGHT, 2 * HEIGHT, dtype=DOUBLE).reshape(-1).numpy()
    mean = np.average(truth.mean(1), weights=omega)

    def srgb(value: np.ndarray) -> np.ndarray:
        high = 1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055
        return np.where(value <= 0.0031308, 12.92 * value, high)

    radiance = {
        "L1": (omega @ np.abs(fit - truth)).sum() / (omega @ truth).sum(),
        "L2": (omega @ (fit - truth) ** 2).sum() / (omega @ truth**2).sum(),
        "L2 of log": np.average(
            (np.log1p(fit / mean) - np.log1p(truth / mean)) ** 2, axis=0, weights=omega
        ).mean(),
        "L2 of sRGB": np.average(
            (srgb(0.18 * fit / mean) - srgb(0.18 * truth / mean)) ** 2, axis=0, weights=omega
        ).mean(),
    }
    name, _, diffuse = loss.value.partition(" + ")
    error = light_map(fit - truth, omega, directions)
    of_light_map = (omega @ np.abs(error)).sum() / (omega @ truth).sum()
    return radiance[name] + (of_light_map if diffuse else 0.0)


@pytest.mark.parametrize("loss", list(Loss))
def test_each_loss_is_what_the_head_of_its_file_says(loss: Loss) -> None:
    lobes = random_lobes(Form.ASG)
    directions = latlong.directions(HEIGHT, 2 * HEIGHT, dtype=DOUBLE).reshape(-1, 3)
    fit = asg.evaluate(lobes, directions).numpy()
    wanted = expected(loss, fit, reference().reshape(-1, 3).numpy())
    # both in float64: what is left is the order of sums over 512 texels
    assert float(frame_loss(lobes, target(reference()), loss)) == pytest.approx(wanted, rel=1e-10)
    single = frame_loss(lobes.to(torch.float32), target(reference().float()), loss)
    assert float(single) == pytest.approx(wanted, rel=1e-5)  # as fits compute it


@pytest.mark.parametrize("loss", list(Loss))
def test_slopes_are_those_of_finite_differences(loss: Loss) -> None:
    lobes, frame = random_lobes(Form.ASG, count=3), target(reference())

    def of(sharpness: Tensor, amplitude: Tensor) -> Tensor:
        return frame_loss(Lobes(lobes.axes, sharpness, amplitude), frame, loss)

    free = (lobes.sharpness.requires_grad_(), lobes.amplitude.requires_grad_())
    assert torch.autograd.gradcheck(of, free)


def test_the_slope_of_l2_in_an_amplitude_is_the_closed_form() -> None:
    lobes, frame = random_lobes(Form.ASG, count=2), target(reference())
    amplitude = lobes.amplitude.requires_grad_()
    frame_loss(lobes, frame, Loss.L2).backward()
    unit = asg.unit_lobes(lobes, frame.directions)  # [N, P]
    difference = frame.solid_angle * (unit.mT @ lobes.amplitude - frame.radiance)
    squares = (frame.solid_angle * frame.radiance.square()).sum()
    closed = 2 * unit @ difference / squares  # d/da of sum w (a u - r)^2
    torch.testing.assert_close(amplitude.grad, closed.detach(), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("loss", list(Loss))
def test_exposure_changes_no_loss(loss: Loss) -> None:
    lobes = random_lobes(Form.ASG)
    bright = Lobes(lobes.axes, lobes.sharpness, 7 * lobes.amplitude)
    plain = float(frame_loss(lobes, target(reference()), loss))
    assert float(frame_loss(bright, target(7 * reference()), loss)) == pytest.approx(plain)


@pytest.mark.parametrize("loss", list(Loss))
def test_what_is_matched_costs_nothing_and_darkness_costs_one(loss: Loss) -> None:
    lobes = random_lobes(Form.ASG)
    directions = latlong.directions(HEIGHT, 2 * HEIGHT, dtype=DOUBLE).reshape(-1, 3)
    same = asg.evaluate(lobes, directions).view(HEIGHT, 2 * HEIGHT, 3)
    assert float(frame_loss(lobes, target(same), loss)) < 1e-12
    black = Lobes(lobes.axes, lobes.sharpness, 0 * lobes.amplitude)
    cost = float(frame_loss(black, target(reference()), loss))
    if loss in (Loss.L1, Loss.L2):
        assert cost == pytest.approx(1.0)
    elif loss in (Loss.L1_LD, Loss.L2_LD):
        assert 1.9 < cost < 2.3  # the light map of degree 3 rings below 0 opposite a sun


def test_srgb_curve_is_the_standard_s_and_goes_on() -> None:
    # IEC 61966-2-1: 0.18 -> 0.4614, 0.002 -> 0.02584, 1 -> 1; the last is the same formula at 16
    shown = srgb_curve(torch.tensor([0.18, 0.002, 1.0, 16.0], dtype=DOUBLE))
    beyond = 1.055 * 16 ** (1 / 2.4) - 0.055
    assert shown.tolist() == pytest.approx([0.46136, 0.02584, 1.0, beyond], abs=5e-6)
    zero = torch.zeros(1, requires_grad=True)
    srgb_curve(zero).backward()
    assert zero.grad is not None
    assert zero.grad.item() == pytest.approx(12.92)


def test_adam_lowers_the_loss_that_it_is_given_and_the_published_one_is_the_default() -> None:
    truth = sky_and_sun(0.0, HEIGHT)
    begin, frame = paper.start(truth, 4, Form.ASG, 0), target(truth)
    ends = {loss: paper.fit_frame(truth, begin, steps=120, loss=loss) for loss in Loss}
    for loss, lobes in ends.items():
        found = {other: float(frame_loss(lobes, frame, other)) for other in Loss}
        # of L2 hardly more: a sun 3000 times the sky grows by 1 % a step
        assert found[loss] < 0.95 * float(frame_loss(begin, frame, loss))
        assert math.isfinite(sum(found.values()))
    plain = paper.fit_frame(truth, begin, steps=120)
    assert torch.equal(plain.amplitude, ends[Loss.L1_LD].amplitude)
    assert float(frame_loss(plain, frame)) == float(frame_loss(plain, frame, Loss.L1_LD))
    assert paper_losses.WITH_LIGHT_MAP == (Loss.L1_LD, Loss.L2_LD)
