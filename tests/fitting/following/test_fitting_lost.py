# SPDX-License-Identifier: Apache-2.0
"""Lobes that followed are lost after a cut; what they cannot show is no cut."""

import math

import pytest
import torch
from lobe_cases import lamps
from torch import Tensor

from asglight.fitting.following import lost, next_frame
from asglight.fitting.loss import objective
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Form, texels


def row_of_lamps(*on: int) -> Tensor:
    """Return the map of a dim sky and some lamps of a row, 20 degrees apart."""
    angles = [math.radians(20.0 * lamp) for lamp in on]
    places = [(0.0, 1.0, 0.0), *((math.sin(a), 0.36, math.cos(a)) for a in angles)]
    shown = lamps(places, [1.0] + [300.0] * len(on), [0.3] + [40.0] * len(on))
    return texels.texel_means(shown, 64, 128)


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
def test_lamps_that_change_places_all_at_once_are_all_found(preset: Preset) -> None:
    one, other = row_of_lamps(*range(0, 14, 2)), row_of_lamps(*range(1, 15, 2))
    options = FitOptions(12, preset, moving=True)
    changed = fit_frame(other, options, fit_frame(one, options, None).lobes)
    assert changed.loss <= 1.5 * fit_frame(other, options, None).loss + 0.02


def test_a_map_that_lobes_cannot_show_is_not_fitted_from_nothing_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Fits from nothing are no better there, and would take ten times as long in every frame."""
    noise = torch.rand(64, 128, 3, generator=torch.Generator().manual_seed(0)) ** 8
    options = FitOptions(6, Preset.LIVE, moving=True)
    first = fit_frame(noise, options, None)
    assert first.loss > lost.LOST
    begun: list[Tensor] = []
    monkeypatch.setattr(lost, "CUT", 0.0)
    monkeypatch.setattr(next_frame, "fit_first_frame", lambda map_, *_, **__: begun.append(map_))
    again = fit_frame(1.8 * noise.roll(5, 1), options, first.lobes)
    assert not begun
    assert again.loss < 1.1 * first.loss


@pytest.mark.parametrize(("loss", "unlike"), [(lost.LOST, 5.0), (0.7, lost.CUT)])
def test_of_small_errors_and_small_changes_no_yardstick_is_made(
    loss: float, unlike: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lost.seeding, "seed_lobes", lambda *_: pytest.fail("was made"))
    black = objective.target(torch.zeros(1, 3, 2 * 32**2))
    assert not lost.is_lost(loss, unlike, torch.ones(32, 64, 3), black, 1.0, 3, Form.ASG)


def test_one_lobe_that_shows_little_is_not_fitted_from_nothing_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A lobe of the form asg cannot show light from all around, wherever it begins."""
    places = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 0.2, 0.0)]
    frame = texels.texel_means(lamps(places, [0.1, 0.1, 60.0], [1.0, 1.0, 9.0]), 64, 128)
    options = FitOptions(1, Preset.LIVE, moving=True)
    first = fit_frame(frame, options, None)
    assert first.loss > 10 * lost.LOST
    begun: list[Tensor] = []
    monkeypatch.setattr(next_frame, "fit_first_frame", lambda map_, *_, **__: begun.append(map_))
    again = fit_frame(1.2 * frame.roll(3, 1), options, first.lobes)
    assert not begun
    assert again.loss < 1.1 * first.loss
