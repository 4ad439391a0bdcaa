# SPDX-License-Identifier: Apache-2.0
"""The paper's preset: its loss to the letter, its schedule, its seed."""

import math

import numpy as np
import pytest
import scipy.special
import torch
from lobe_cases import follow, random_lobes, sky_and_sun

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper import losses as paper_losses
from asglight.lobes import Form, Lobes, asg
from asglight.sphere import latlong


def test_schedule_is_the_published_one() -> None:
    assert FitOptions(preset=Preset.PAPER).paper_steps == (24_000, 6_000)
    assert (paper_losses.ALPHA, paper_losses.BETA, paper.GAMMA) == (1.0, 1.0, 0.5)
    assert FitOptions().count == 15
    assert paper_losses.SH_DEGREE == 3


def test_frame_loss_is_radiance_l1_plus_light_map_l1() -> None:
    reference = sky_and_sun(15.0, height=16)
    lobes = random_lobes(Form.ASG).to(torch.float32)
    found = float(paper.frame_loss(lobes, paper.target(reference)))

    directions = latlong.directions(16, 32, dtype=torch.float64).reshape(-1, 3)
    omega = latlong.texel_solid_angles(16, 32, dtype=torch.float64).reshape(-1).numpy()
    fit = asg.evaluate(lobes.to(torch.float64), directions).numpy()
    truth = reference.double().reshape(-1, 3).numpy()
    x, y, z = directions.numpy().T
    polar, azimuth = np.arccos(z), np.arctan2(y, x)
    light_map = np.zeros_like(fit)
    for degree, factor in ((0, math.pi), (1, 2 * math.pi / 3), (2, math.pi / 4), (3, 0.0)):
        for order in range(-degree, degree + 1):
            harmonic = scipy.special.sph_harm_y(degree, order, polar, azimuth)
            coefficients = (omega * np.conj(harmonic)) @ (fit - truth)
            light_map += factor / math.pi * np.real(harmonic[:, None] * coefficients)
    flux = (omega[:, None] * truth).sum()
    expected = (omega[:, None] * (np.abs(fit - truth) + np.abs(light_map))).sum() / flux
    assert found == pytest.approx(expected, rel=1e-5)


def test_temporal_loss_is_the_sum_of_scaled_norms() -> None:
    before, now = random_lobes(Form.ASG, seed=0), random_lobes(Form.ASG, seed=1)
    expected = 0.0
    groups = []
    for lobes in (before, now):
        groups.append(
            [
                lobes.sharpness[:, :1].numpy(),
                lobes.sharpness[:, 1:].numpy(),
                lobes.axis_x.numpy(),
                lobes.axis_z.numpy(),
                lobes.amplitude.numpy(),
            ]
        )
    for index in range(before.count):
        squares = sum(
            (((b[index] - a[index]) / np.abs(a).max()) ** 2).sum()
            for a, b in zip(*groups, strict=True)
        )
        expected += math.sqrt(squares)
    assert float(paper.temporal_loss(now, before)) == pytest.approx(expected, rel=1e-6)


def test_adam_lowers_the_loss_and_the_temporal_term_holds_lobes_back() -> None:
    options = FitOptions(preset=Preset.PAPER, lobes=4, paper_steps=(150, 60))
    first, still = follow([sky_and_sun(0.0, 16), sky_and_sun(0.0, 16)], options)
    start = paper.start(sky_and_sun(0.0, 16), 4, Form.ASG, 0)
    start_loss = float(paper.frame_loss(start, paper.target(sky_and_sun(0.0, 16))))
    assert first.loss < 0.8 * start_loss
    assert still.loss <= first.loss * 1.05
    reference = sky_and_sun(40.0, 16)
    free = paper.fit_frame(reference, first.lobes, steps=60)
    held = paper.fit_frame(reference, first.lobes, steps=60, previous=first.lobes)
    way = [float(paper.temporal_loss(lobes, first.lobes)) for lobes in (held, free)]
    assert way[0] < 0.5 * way[1]


def test_seed_sets_the_start_and_repeats() -> None:
    reference = sky_and_sun(0.0, 16)
    one, same, other = (paper.start(reference, 15, Form.ASG, seed) for seed in (0, 0, 1))
    assert torch.equal(one.axes, same.axes)
    assert not torch.equal(one.axes, other.axes)
    options = FitOptions(preset=Preset.PAPER, lobes=3, paper_steps=(20, 10))
    runs = [follow([reference], options)[0].lobes for _ in range(2)]
    assert torch.equal(runs[0].amplitude, runs[1].amplitude)


def test_sg_keeps_both_sharpnesses_equal() -> None:
    options = FitOptions(preset=Preset.PAPER, lobes=3, form=Form.SG, paper_steps=(20, 10))
    (fit,) = follow([sky_and_sun(0.0, 16)], options)
    assert torch.equal(fit.lobes.sharpness[:, 0], fit.lobes.sharpness[:, 1])
    assert isinstance(fit.lobes, Lobes)


def test_steps_are_reported() -> None:
    seen: list[tuple[int, int]] = []
    options = FitOptions(preset=Preset.PAPER, lobes=2, paper_steps=(5, 3))
    references = [sky_and_sun(0.0, 8), sky_and_sun(1.0, 8)]
    follow(references, options, on_step=lambda step, steps, _: seen.append((step, steps)))
    assert seen == [(i, 5) for i in range(1, 6)] + [(i, 3) for i in range(1, 4)]
