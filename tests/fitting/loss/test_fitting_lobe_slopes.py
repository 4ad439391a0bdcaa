# SPDX-License-Identifier: Apache-2.0
"""Slopes and columns of narrow lobes, the change of their scale included."""

import math
from dataclasses import replace

import pytest
import torch
from adaptive_cases import (
    CENTRES,
    PLACES,
    POLES,
    differences,
    lobes_at,
    plain_cells,
    refined_cells,
    single,
)
from lobe_cases import DOUBLE, random_lobes

from asglight.fitting.loss import coordinates, lobe_images
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.loss.footprints import footprint
from asglight.fitting.loss.lobe_images import COLUMNS
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack

OWN_IMAGES = [Form.ASG, Form.BINGHAM, Form.SG]
"""Forms that have a scale of their own; a flat lobe's terms have one each, and its slopes are held
to differences of J (test_fitting_newton.py)."""


def _is_free(scale: torch.Tensor) -> torch.Tensor:
    """Tell which scales are those of narrow lobes and at no bound."""
    bounds = (lobe_images.SCALE_MIN, 1.0, lobe_images.SCALE_MAX)
    return torch.stack([scale != bound for bound in bounds]).all(0)


def _plane_integral(lobes: Lobes) -> torch.Tensor:
    """Return the integral of lobes of amplitude 1 in a plane, a bingham one's to 1 / s.  [N]."""
    if lobes.form is Form.SG:
        return 2 * math.pi / lobes.sharpness[:, 0]
    plane = math.pi / lobes.sharpness.prod(-1).sqrt()
    if lobes.form is Form.ASG:
        return plane
    return 2 * plane * (1 + (1 / lobes.sharpness).sum(-1) / 4)


def _integral_slopes(lobes: Lobes) -> torch.Tensor:
    """Return differences of the log of the lobes' integral along each coordinate.  [N, 5]."""
    found = []
    for unknown in range(COLUMNS - 1):
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = 1e-6  # a turn or a shear changes the integral by its square times 1e3
        ways = [coordinates.advance(lobes, way) for way in (move, -move)]
        ahead, behind = ((moved.amplitude[:, 0] * _plane_integral(moved)).log() for moved in ways)
        found.append((ahead - behind) / 2e-6)
    return torch.stack(found, dim=-1)


def _slopes(
    lobes: Lobes, places: AdaptiveCells
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return slopes of frames of lobes as the fit takes them, with what they should be.

    Returns:
        The slopes, the sums, the sums' size if terms had random signs, each [F, N, 8], and
        the scales [F, N].
    """
    generator = torch.Generator().manual_seed(8)
    slope = torch.randn(len(lobes.axes), 3, places.share.shape[-1], generator=generator)
    single = lobes.to(torch.float32)
    shown = lobe_images.images(single, places)
    seen = footprint(single, [rows for rows, _, _ in places.levels])
    of_scale = lobe_images.scale_slopes(shown, seen, places)
    found = lobe_images.slopes(shown, seen, of_scale, slope, places)
    sums, sizes = [], []
    for frame in range(len(slope)):
        own = lobes[frame]
        directions = places.directions[frame].double().mT
        parts = [differences(own, rows, directions[place]) for rows, _, place in places.levels]
        columns = torch.cat(parts, dim=-1)
        scale = shown.scale[frame, :, None].double()
        mean = columns @ places.share[frame].double()
        of_scale = _integral_slopes(own) - mean[:, 1:] / mean[:, :1]
        columns[:, 1:] += torch.where(_is_free(scale), of_scale, 0.0)[..., None] * columns[:, :1]
        columns *= scale[..., None]
        for power, kept in ((1, sums), (2, sizes)):
            pulled = columns**power @ slope[frame].double().mT ** power
            shape = (pulled[:, 1:] * own.amplitude[:, None] ** power).sum(-1)
            kept.append(torch.cat([shape, pulled[:, 0]], dim=-1))
    return found, torch.stack(sums), torch.stack(sizes).sqrt(), shown.scale


@pytest.mark.parametrize("form", OWN_IMAGES)
@pytest.mark.parametrize("rows", [16, 50])
def test_slopes_are_the_columns_times_the_slope(form: Form, rows: int) -> None:
    frames = stack([random_lobes(form, count=8, seed=seed) for seed in (0, 1)])
    found, expected, size, _ = _slopes(frames, plain_cells(rows, 2))
    # moments are differences: sums in float32, times a sharpness of up to 100
    difference = (found - expected).abs()
    assert bool((difference <= 2e-4 * size + 1e-6).all())
    assert bool((expected.abs().amax((0, 1)) > 0.1)[[0, 1, 2, 5, 6, 7]].all())
    if form is Form.SG:
        assert not found[..., 3:5].any()


@pytest.mark.parametrize("form", OWN_IMAGES)
@pytest.mark.parametrize("sharpness", [(300.0, 300.0), (3e3, 200.0), (3e4, 2e4), (1e5, 1e3)])
def test_slopes_of_narrow_lobes_count_texels_and_the_change_of_the_scale(
    form: Form, sharpness: tuple[float, float]
) -> None:
    lobes = lobes_at(form, [*CENTRES[:5], *PLACES], list(sharpness))
    found, expected, size, scale = _slopes(stack([lobes]), refined_cells())
    # a moment along a lobe's width cancels to 1 / s' of the lobe, and again with the light that
    # comes with the width and with the change of the scale, in float32
    seen = min(sharpness[0], 6 / (math.pi / 256) ** 2)
    difference = (found - expected).abs()
    assert bool((difference <= (2e-4 + 16 * 2**-24 * seen) * size + 1e-6).all())
    assert sharpness[0] < 1e4 or float((scale - 1).abs().max()) > 0.05


@pytest.mark.parametrize("form", list(Form))
def test_everything_is_finite_from_the_broadest_to_the_narrowest_lobe(form: Form) -> None:
    places = refined_cells()
    for first in (1e-3, 1.0, 49.0, 51.0, 1e4, 1e7):
        for second in (1e-3, 1.0, 49.0, 51.0, 1e4, 1e7):
            lobes = single(lobes_at(form, PLACES + POLES + CENTRES[:2], [first, second]))
            shown = lobe_images.images(lobes, places)
            seen = footprint(lobes, (64, 256, 32))
            of_adaptive = replace(
                seen, exponent=seen.exponent[:2], derivatives=seen.derivatives[:2]
            )
            slope = torch.ones(1, 3, places.share.shape[-1])
            of_scale = lobe_images.scale_slopes(shown, of_adaptive, places)
            slopes = lobe_images.slopes(shown, of_adaptive, of_scale, slope, places)
            columns = lobe_images.grid_columns(lobes, seen, 2, plain_cells(32).cells)
            for found in (shown.values, shown.scale, shown.radiance, slopes, columns):
                assert bool(found.isfinite().all())
            # 1 at the peak of a lobe that an adaptive cell resolves; exponents of up to 6 / T in
            # float32
            assert float(shown.values.min()) >= 0
            assert float(shown.values.max()) <= 1.05


@pytest.mark.usefixtures("torch_steps")
@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sharpness", [(3e3, 200.0), (2e4, 2e4)])
def test_columns_of_narrow_lobes_keep_their_integral(
    form: Form, sharpness: tuple[float, float]
) -> None:
    places = refined_cells()
    lobes = lobes_at(form, [*CENTRES[:5], *PLACES], list(sharpness))
    frame = single(lobes)
    sizes = [rows for rows, _, _ in places.levels]
    seen = footprint(frame, [*sizes, 32])
    of_adaptive = replace(seen, exponent=seen.exponent[:-1], derivatives=seen.derivatives[:-1])
    shown = lobe_images.images(frame, places)
    of_scale = lobe_images.scale_slopes(shown, of_adaptive, places)
    parts = [
        lobe_images.adaptive_columns(shown, of_adaptive, of_scale, level, monomials)
        for level, (_, monomials, _) in enumerate(places.levels)
    ]
    on_adaptive_cells = 4 * math.pi * (torch.cat(parts, dim=-1) @ places.share[0])
    cells = plain_cells(32).cells
    on_cells = 4 * math.pi * (lobe_images.grid_columns(frame, seen, -1, cells) @ cells.share)
    exact = asg.integral(lobes)
    for found in (on_adaptive_cells, on_cells):
        means = found[0].unflatten(0, (lobes.count, COLUMNS)).double() / exact[:, None]
        # the bingham form's integral is Dawson's series; sums in float32, times the adaptive cells'
        # 6 / T
        torch.testing.assert_close(means[:, 0], torch.ones(lobes.count).double(), rtol=0, atol=1e-4)
        torch.testing.assert_close(means[:, 1:], _integral_slopes(lobes), rtol=0, atol=0.02)
