# SPDX-License-Identifier: Apache-2.0
"""Frames fitted with lobes free to jump: what they gain, what keeps its leash, cuts."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import lamps
from torch import Tensor

from asglight.fitting import free_fits
from asglight.fitting.first_frame import exposed
from asglight.fitting.following import LEASH_DEG
from asglight.fitting.free_fits import FreeFit, free_fit, is_broad
from asglight.judging.metrics import frame_errors
from asglight.lobes import Lobes, texels


def _scene(degrees: float) -> Lobes:
    """Return a lamp on its way over a broad light, and two lamps that stand."""
    angle = math.radians(degrees)
    return lamps(
        [(math.sin(angle), 0.3, math.cos(angle)), (0, 1, 0), (0.2, -0.3, -1), (-1, -0.3, -0.2)],
        [90.0, 2.0, 60.0, 60.0],
        [12.0, 0.5, 4.0, 3.0],
    )


def _map(lobes: Lobes) -> Tensor:
    return texels.texel_means(lobes, 64, 128)


def _fit(truth: Lobes, before: Lobes, followed: Lobes) -> FreeFit:
    return free_fit(exposed(_map(truth)), before, followed)


def test_a_narrow_lobe_jumps_to_where_it_is_needed() -> None:
    """From a lamp that went out to one that two lamps share, as a half."""
    before = _scene(0.0)
    truth = _scene(25.0)
    truth.axes[3] = lamps([(math.sin(0.9), 0.3, math.cos(0.9))], [1.0], [1.0]).axes[0]
    followed = replace(before, axes=before.axes.clone())
    followed.axes[0] = lamps([(math.sin(0.17), 0.3, math.cos(0.17))], [1.0], [1.0]).axes[0]
    found = _fit(truth, before, followed)
    errors = [frame_errors(lobes, _map(truth)).values["r0.5"] for lobes in (found.lobes, followed)]
    assert errors[0] < 0.2 * errors[1]
    assert found.gain > 0.5


def test_a_broad_lobe_keeps_its_leash() -> None:
    before = _scene(0.0)
    axes = before.axes.clone()
    truth = replace(before, axes=axes)
    truth.axes[1] = lamps([(1.0, 0.3, 0.0)], [2.0], [1.0]).axes[0]
    found = _fit(truth, before, before).lobes
    broad = is_broad(found)
    turned = torch.rad2deg(torch.acos((found.axis_z * before.axis_z).sum(-1).clamp(-1, 1)))
    assert broad.tolist()[1]
    assert float(turned[1]) < LEASH_DEG


def test_a_lobe_is_broad_along_one_axis() -> None:
    lobes = lamps([(0, 0, 1)] * 3, [4000.0, 4000.0, 10.0], [1.0] * 3)
    lobes.sharpness[1, 0] = 8.0
    assert is_broad(lobes).tolist() == [False, True, True]


def test_across_a_cut_a_frame_starts_from_its_own_lobes() -> None:
    elsewhere = lamps([(0, -1, 0.1)] * 4, [1.0] * 4, [0.1] * 4)
    truth = _scene(0.0)
    found = _fit(truth, elsewhere, truth).lobes
    assert frame_errors(found, _map(truth)).values["r0.5"] < 1e-3
    assert float((found.axis_z * truth.axis_z).sum(-1).min()) > math.cos(math.radians(1.0))


def test_after_a_black_frame_a_frame_starts_from_its_own_lobes() -> None:
    truth = _scene(0.0)
    black = replace(truth, amplitude=torch.zeros_like(truth.amplitude))
    found = _fit(truth, black, truth)
    assert frame_errors(found.lobes, _map(truth)).values["r0.5"] < 1e-3
    assert bool(found.missed.isfinite().all())


def test_two_lobes_that_stand_in_for_each_other_are_both_missed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth = lamps([(0, 0, 1), (0, 0.02, 1), (0, 1, 0)], [60.0, 60.0, 0.6], [4.0, 4.0, 0.2])
    missed = _fit(truth, truth, truth).missed
    monkeypatch.setattr(free_fits, "ALONE_MAX", 0.0)
    less = _fit(truth, truth, truth).missed
    assert bool((missed[:2] > less[:2]).all())
    assert bool((missed - less <= 0.003 + 1e-9).all())
