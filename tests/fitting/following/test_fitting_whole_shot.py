# SPDX-License-Identifier: Apache-2.0
"""The pass over a whole shot: steadier and no worse; cuts, black frames, dark lobes."""

import functools
import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import follow, lamps, sky_and_sun
from torch import Tensor

from asglight.fitting.first_frame.fit import (
    FAST,
    Exposed,
    exposed,
    fit_first_frame,
    soft_to_sharp,
)
from asglight.fitting.following import whole_shot
from asglight.fitting.following.whole_shot import Refinement, refine_shot
from asglight.fitting.loss import objective, temporal
from asglight.fitting.loss.coordinates import UNKNOWNS, advance
from asglight.fitting.loss.lobe_images import images
from asglight.fitting.loss.objective import ENV_WEIGHT
from asglight.fitting.loss.probes import PROBES
from asglight.fitting.options import FitOptions, Preset
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import stack

LIVE = FitOptions(lobes=4, preset=Preset.LIVE)
SETTINGS = Refinement()
BRIEF = replace(
    FAST,
    spreads_deg=FAST.spreads_deg[:1],
    levels=soft_to_sharp(rounds=0)[::2],
    left=(9.0,) * len(FAST.left),
)

FIELDS = ("axes", "sharpness", "amplitude")


def _fitted(maps: list[Tensor]) -> Lobes:
    return stack([fit.lobes for fit in follow(maps, LIVE)])


def _refined(
    shot: Lobes, maps: list[Tensor], chunk: int = 16, *, threads: int = 1
) -> tuple[Lobes, list[float]]:
    frames = [exposed(radiance) for radiance in maps]
    chunks: list[list[Exposed]] = [frames[at : at + chunk] for at in range(0, len(frames), chunk)]
    done: list[tuple[int, int]] = []
    found = refine_shot(
        shot,
        lambda: chunks,
        SETTINGS,
        threads=threads,
        on_chunk=lambda *each: done.append(each),
    )
    counts = [min(at, len(maps)) for at in range(chunk, len(maps) + chunk, chunk)]
    assert done == [(count, len(maps)) for count in counts]
    return found


NOISY = 2 * whole_shot.GROUP + 3
"""Frames: two groups of even places."""


@functools.cache
def _noisy_maps() -> list[Tensor]:
    """Return a still scene under noise of a fifth of each texel."""
    generator = torch.Generator().manual_seed(0)
    still = sky_and_sun(20.0)
    return [still * (1 + 0.2 * torch.randn(still.shape, generator=generator)).clamp(min=0)
            for _ in range(NOISY)]  # fmt: skip


@functools.cache
def _noisy_fit() -> Lobes:
    return _fitted(_noisy_maps())


def _noisy(frames: int) -> tuple[list[Tensor], Lobes]:
    """Return the first frames of a noisy shot, and the lobes fitted to them."""
    return _noisy_maps()[:frames], _noisy_fit()[:frames].clone()


def test_a_frame_that_strayed_comes_back_to_its_neighbours() -> None:
    still = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 60.0], [1.0, 8.0, 5.0])
    maps = [texels.texel_means(still, 64, 128)] * 5
    still = stack([still])
    shot = Lobes(*(torch.cat([getattr(still, name)] * 5)
                   for name in ("axes", "sharpness", "amplitude")))  # fmt: skip
    generator = torch.Generator().manual_seed(2)
    step = 0.1 * torch.randn(1, 3, UNKNOWNS, generator=generator)
    step[..., :2] *= texels.lobe_width(still).clamp(max=0.5)[..., None]
    step[..., 5:] *= shot.amplitude[:1]
    strayed = advance(shot[2:3], step)
    for name in ("axes", "sharpness", "amplitude"):
        getattr(shot, name)[2:3] = getattr(strayed, name)
    found, _ = _refined(shot, maps)
    before, after = (
        float(temporal.value(lobes[2:3], temporal.prior(lobes[1:2], gamma=1.0)))
        for lobes in (shot, found)
    )
    assert before > 2 * temporal.CORNER
    assert after - temporal.CORNER < 0.5 * (before - temporal.CORNER)


def test_a_noisy_shot_becomes_no_worse() -> None:
    maps, shot = _noisy(6)
    found, losses = _refined(shot, maps)
    before, after = (
        [frame_errors(lobes[k], radiance).values for k, radiance in enumerate(maps)]
        for lobes in (shot, found)
    )
    # over the shot: a frame gives up by chance a tenth of what the noise let it have
    materials = (each.weight for each in PROBES[1:])
    weights = {"env": ENV_WEIGHT} | dict(zip(("irr", "r0.5", "r0.25"), materials, strict=True))
    sums = [
        {name: sum(errors[name] for errors in part) for name in weights} for part in (before, after)
    ]
    first, last = (sum(w * part[name] for name, w in weights.items()) for part in sums)
    assert last < first
    for name in weights:  # one part of J may pay for another, as in a frame
        assert sums[1][name] < (1 + SETTINGS.rise) * sums[0][name], name
    # judged on texel centres: (pi / 64)^2 / 24
    assert max(errors["flux"] for errors in after) < 2e-4
    assert all(0 < loss < 1 for loss in losses)


def test_a_shot_comes_to_the_same_on_any_number_of_threads() -> None:
    maps, shot = _noisy(NOISY)
    alone, losses = _refined(shot, maps)
    found, same_losses = _refined(shot, maps, threads=3)
    assert same_losses == losses
    assert all(torch.equal(getattr(found, name), getattr(alone, name)) for name in FIELDS)
    assert not torch.equal(alone.amplitude, shot.amplitude)


def test_frames_read_in_chunks_are_all_refined() -> None:
    maps, shot = _noisy(5)
    found, losses = _refined(shot, maps, chunk=2)
    assert len(losses) == 5
    moved = (found.amplitude - shot.amplitude).abs().flatten(1).amax(-1)
    assert bool((moved > 0).all())


def test_a_cut_parts_the_shot() -> None:
    indoors = texels.texel_means(
        lamps([(1, 0.1, 0), (-0.3, 0.8, 0.5), (0, -1, 0)], [300.0, 40.0, 1.0], [40.0, 6.0, 0.5]),
        64,
        128,
    )
    (before, first), after = _noisy(2), [indoors] * 2
    shots = [first, _fitted(after)]
    shots[1] = shots[1].select(torch.arange(8).roll(4))  # a cut has other lights
    whole = Lobes(*(torch.cat([getattr(shot, name) for shot in shots])
                    for name in ("axes", "sharpness", "amplitude")))  # fmt: skip
    together, _ = _refined(whole, before + after)
    alone, _ = _refined(shots[0], before)
    # frame 1 is at an odd place in both, and its neighbour beyond the cut holds it by nothing
    torch.testing.assert_close(together.axis_z[1], alone.axis_z[1], rtol=0, atol=1e-3)
    # not axis x: how a lobe that is nearly round is turned shows in nothing
    shown = [texels.texel_means(shot[1], 64, 128) for shot in (together, alone)]
    assert float((shown[0] - shown[1]).abs().sum() / shown[1].sum()) < 0.01


def test_dark_tracks_stay_dark_and_as_they_were() -> None:
    """Where a track fades out and in is not the business of the frames between."""
    maps, shot = _noisy(3)
    dark = shot.amplitude.amax(-1) == 0
    found, _ = _refined(shot, maps)
    assert int(dark.sum()) >= 3 * 4  # the spare tracks
    assert float(found.amplitude[dark].max()) == 0.0
    assert torch.equal(found.axes[dark], shot.axes[dark])
    assert int((found.amplitude.amax(-1) > 0).sum(-1).max()) <= 4


def test_black_frames_stay_as_they_are() -> None:
    maps, _ = _noisy(3)
    maps[1] = torch.zeros_like(maps[1])
    shot = _fitted(maps)
    found, losses = _refined(shot, maps)
    assert losses[1] == 0.0
    assert torch.equal(found.amplitude[1], torch.zeros_like(found.amplitude[1]))
    assert torch.equal(found.axes[1], shot.axes[1])
    assert bool(found.amplitude.isfinite().all())


def test_frames_of_different_sizes_stay_as_they_are() -> None:
    maps = [sky_and_sun(0.0, height=32), sky_and_sun(0.0, height=64)]
    shot = _fitted([maps[0], maps[0]])
    found, losses = _refined(shot, maps)
    assert losses == [0.0, 0.0]
    assert torch.equal(found.axes, shot.axes)


@pytest.mark.parametrize("form", list(Form))
def test_every_form_is_refined(form: Form) -> None:
    maps, _ = _noisy(3)
    shot = stack([fit_first_frame(maps[0], 4, form, BRIEF).lobes] * 3)
    found, _ = _refined(shot, maps)
    assert found.form is form
    assert not torch.equal(found.axes[1:], shot.axes[1:])
    assert all(bool(t.isfinite().all()) for t in (found.axes, found.sharpness, found.amplitude))


def test_a_lamp_that_rushes_past_is_not_dragged_back() -> None:
    """Neighbours that hold other light are no guide: a frame's J rises by a tenth at most."""
    dim = 0.02 * torch.ones(64, 128, 3)
    maps = [
        dim + texels.texel_means(lamps([(math.sin(a), 0.2, math.cos(a))], [30.0], [b]), 64, 128)
        for a, b in zip((0.0, 0.15, 0.3, 0.45, 0.6), (0.5, 2.0, 40.0, 2.0, 0.5), strict=True)
    ]
    shot = _fitted(maps)
    found, _ = _refined(shot, maps)

    def loss(lobes: Lobes, radiance: Tensor) -> float:
        frame = exposed(radiance)
        target = objective.target(frame.radiance, SETTINGS.corners)
        own = replace(lobes, amplitude=lobes.amplitude / frame.exposure)[None]
        return float(objective.value(images(own, target.places).radiance, target))

    for index, radiance in enumerate(maps):
        # judged with sharper corners, which weigh small errors a little more
        assert loss(found[index], radiance) <= 1.12 * loss(shot[index], radiance)


def test_materials_are_not_traded_for_the_map() -> None:
    """A step that pays for light with detail is not kept, though J as a whole hardly grows."""
    checks = (torch.arange(64)[:, None] + torch.arange(128)) % 2  # no material sees them
    frame = exposed((0.5 + checks)[..., None].repeat(1, 1, 3))
    target = objective.target(frame.radiance, SETTINGS.corners)
    even = torch.full_like(target.radiance, float(target.radiance.mean()))
    brighter = even * 1.001
    values = [float(objective.value(each, target)) for each in (even, brighter)]
    assert values[1] < (1 + SETTINGS.rise) * values[0]
    assert bool(whole_shot._risen(brighter, even, target, SETTINGS.rise))
    assert not bool(whole_shot._risen(even, brighter, target, SETTINGS.rise))
    assert not bool(whole_shot._risen(even, even, target, SETTINGS.rise))
