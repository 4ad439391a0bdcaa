# SPDX-License-Identifier: Apache-2.0
"""First frames and following: recovery, flux, identity, extremes, determinism."""

import math
from dataclasses import replace

import pytest
import torch
from effort import is_thorough
from lobe_cases import angle_deg, follow, lamps, sky_and_sun
from places import SHARED
from torch import Tensor

from asglight.fitting.first_frame import seeding
from asglight.fitting.first_frame.fit import (
    BEST,
    FAST,
    LAST,
    FirstFrameSettings,
    FrameFit,
    Level,
    fit_first_frame,
    prepare,
)
from asglight.fitting.following import lost, next_frame
from asglight.fitting.following.next_frame import fit_next_frame
from asglight.fitting.following.slots import with_spare_tracks
from asglight.fitting.loss import probes
from asglight.fitting.loss.objective import Corners
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.images import read_latlong
from asglight.judging.metrics import frame_errors, irradiance_error
from asglight.lobes import Form, Lobes, asg, texels
from asglight.sphere import latlong

BRIEF = replace(
    FAST,
    spreads_deg=FAST.spreads_deg[:1],
    levels=(Level(6, Corners(1.0, 1.0)), Level(6, Corners(0.1, 0.02)), replace(LAST, rounds=1)),
)
"""One start, few levels, one round of splits, for what does not depend on how good a fit is."""

UNWEIGHTED = replace(BRIEF, left=(9.0,) * len(BRIEF.left))
"""None of whose errors lags behind: its steps end with the levels."""


def flux_of(radiance: Tensor) -> Tensor:
    height, width, _ = radiance.shape
    weight = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    return (weight * radiance).sum((0, 1))


def brightest(lobes: Lobes) -> int:
    return int((lobes.amplitude.sum(-1) * lobes.sharpness.amax(-1)).argmax())


@pytest.mark.parametrize("height", [128, 256])
def test_who_prepared_makes_no_table_of_probes_while_a_map_is_fitted(height: int) -> None:
    prepare()
    before = probes._tables.cache_info(), torch.get_num_threads()
    fit_first_frame(sky_and_sun(30.0, height), 2, Form.ASG, BRIEF)
    assert probes._tables.cache_info().misses == before[0].misses
    assert torch.get_num_threads() == before[1]


@pytest.mark.parametrize("form", list(Form))
def test_seeding_keeps_the_flux_of_every_channel(form: Form) -> None:
    radiance = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0)) ** 8
    lobes = seeding.seed_lobes(seeding.cells(radiance), 15, form, spread_deg=4.0)
    flux = asg.flux(lobes).double().sum(0)
    # flat lobes take the place of asg ones by the rule of narrow lobes: broad ones, as of this
    # noise, have up to a tenth more or less light, which the first steps mend
    bound = 0.1 if form is Form.FLAT else 1e-5
    torch.testing.assert_close(flux, flux_of(radiance), rtol=bound, atol=0)


@pytest.mark.parametrize("height", [32, 50, 64, 128, 256])
def test_seeding_cells_keep_flux_and_moments_and_are_fewer_than_texels(height: int) -> None:
    radiance = torch.rand(height, 2 * height, 3, generator=torch.Generator().manual_seed(0)) ** 8
    radiance[height // 3, height] = 1e4
    cells = seeding.cells(radiance)
    torch.testing.assert_close(cells.flux.sum(0), flux_of(radiance), rtol=1e-9, atol=0)
    power = flux_of(radiance).sum()
    direction = latlong.directions(height, 2 * height, dtype=torch.float64)
    sent = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64)
    sent = (sent * radiance.double().sum(-1)) / power
    first = (sent[..., None] * direction).sum((0, 1))
    second = torch.einsum("hw,hwi,hwj->ij", sent, direction, direction)
    torch.testing.assert_close(cells.weight @ cells.mean, first, rtol=0, atol=1e-9)
    found = (cells.weight[:, None, None] * cells.second).sum(0)
    torch.testing.assert_close(found, second, rtol=0, atol=1e-9)
    # the lamp is a cell of its own
    brightest_cell = cells.mean[cells.weight.argmax()]
    assert angle_deg(brightest_cell, direction[height // 3, height]) < 1e-3
    assert height < 128 or len(cells.weight) < height * height


def test_seeding_gives_each_lamp_its_lobe_and_its_width() -> None:
    truth = lamps([(1, 0, 0), (0, 0.5, -1), (0, 1, 0.2)], [40.0, 200.0, 800.0], [1.0, 4.0, 9.0])
    lobes = seeding.seed_lobes(seeding.cells(texels.texel_means(truth, 128, 256)), 3, Form.ASG, 4.0)
    nearest = (lobes.axis_z @ truth.axis_z.mT).argmax(0)
    assert sorted(nearest.tolist()) == [0, 1, 2]
    for index, lobe in enumerate(nearest.tolist()):
        assert angle_deg(lobes.axis_z[lobe], truth.axis_z[index]) < 0.5
        assert float(lobes.sharpness[lobe].log().mean()) == pytest.approx(
            math.log(float(truth.sharpness[index, 0])), abs=0.15
        )


@pytest.mark.parametrize("s", [0.01, 0.3, 1.0, 3.0, 10.0, 100.0])
def test_sharpness_from_variance_inverts_the_exact_moments(s: float) -> None:
    eye = torch.eye(3, dtype=torch.float64)[None]
    sharpness = torch.full((1, 2), s, dtype=torch.float64)
    moments = asg.moments(Lobes(eye, sharpness, sharpness.new_ones(1, 3)))
    variance = moments.second[:, :2] / moments.zeroth[:, None]
    found = seeding.sharpness_from_variance(variance, Form.ASG)
    # s + 1/2 is what the width depends on
    assert float(found[0, 0]) + 0.5 == pytest.approx(s + 0.5, rel=0.06)


def test_fit_finds_known_lobes_again() -> None:
    truth = lamps(
        [(1, 0.1, 0), (0, 0.5, -1), (0, 1, 0.2), (-1, -0.4, 0.5)],
        [20.0, 200.0, 1.5, 60.0],
        [3.0, 20.0, 1.0, 6.0],
    )
    reference = texels.texel_means(truth, 64, 128)
    fit = fit_first_frame(reference, 4, Form.ASG)
    nearest = (fit.lobes.axis_z @ truth.axis_z.mT).argmax(0)
    assert sorted(nearest.tolist()) == [0, 1, 2, 3]
    for index, lobe in enumerate(nearest.tolist()):
        assert angle_deg(fit.lobes.axis_z[lobe], truth.axis_z[index]) < 1.0
    assert frame_errors(fit.lobes, reference).values["env"] < 0.02


@pytest.mark.parametrize("form", list(Form))
def test_fit_has_the_flux_of_the_map(form: Form) -> None:
    reference = sky_and_sun(20.0, 32)
    if form is Form.BINGHAM:  # antipodal: a map that it can hold
        reference = reference + reference.flip(0).roll(reference.shape[1] // 2, dims=1)
    fit = fit_first_frame(reference, 6, form, UNWEIGHTED)
    found = flux_of(texels.texel_means(fit.lobes, 64, 128))
    # texels sample the narrowest lobes
    torch.testing.assert_close(found, flux_of(reference), rtol=2e-4, atol=0)
    assert abs(fit.flux_error) < 1e-4


def test_fit_does_not_depend_on_exposure() -> None:
    reference = sky_and_sun(20.0, 32)
    plain = fit_first_frame(reference, 6, Form.ASG, BRIEF)
    for scale in (2.0**-30, 2.0**30):
        scaled = fit_first_frame(reference * scale, 6, Form.ASG, BRIEF)
        # a power of two is no reason to round: other factors turn steps aside, to another minimum
        assert scaled.loss == plain.loss
        torch.testing.assert_close(scaled.lobes.axes, plain.lobes.axes, rtol=0, atol=0)
        torch.testing.assert_close(scaled.lobes.amplitude / scale, plain.lobes.amplitude)


def test_black_map_gives_black_lobes_and_light_may_follow() -> None:
    black = fit_first_frame(torch.zeros(32, 64, 3), 5, Form.ASG)
    assert float(black.lobes.amplitude.abs().max()) == 0.0
    lit = fit_next_frame(sky_and_sun(0.0, height=32), with_spare_tracks(black.lobes))
    assert frame_errors(lit.lobes, sky_and_sun(0.0, height=32)).values["irr"] < 0.02
    dark = fit_next_frame(torch.zeros(32, 64, 3), lit.lobes)
    assert float(dark.lobes.amplitude.abs().max()) == 0.0
    torch.testing.assert_close(dark.lobes.axes, lit.lobes.axes)


@pytest.mark.parametrize(
    ("name", "reference"),
    [
        ("constant", torch.full((32, 64, 3), 0.7)),
        ("1 x 2", torch.tensor([[[1.0, 2.0, 3.0], [0.5, 0.1, 0.0]]])),
        ("2 x 4", torch.rand(2, 4, 3, generator=torch.Generator().manual_seed(0))),
        ("one channel", torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0))
         * torch.tensor([0.0, 0.0, 1.0])),
        ("odd size", torch.rand(50, 100, 3, generator=torch.Generator().manual_seed(0))),
    ],
)  # fmt: skip
def test_unusual_maps_are_fitted_with_their_flux(name: str, reference: Tensor) -> None:
    fit = fit_first_frame(reference, 15, Form.ASG, BRIEF)
    for tensor in (fit.lobes.axes, fit.lobes.sharpness, fit.lobes.amplitude):
        assert bool(torch.isfinite(tensor).all()), name
    found = asg.flux(fit.lobes).double().sum(0)
    torch.testing.assert_close(found, flux_of(reference), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("rows", [1, 2, 3, 5, 8])
def test_maps_of_few_rows_look_right_on_a_white_ball(rows: int) -> None:
    reference = sky_and_sun(40.0, rows)
    fit = fit_first_frame(reference, 15, Form.ASG, BRIEF)
    # texels of 22 to 180 degrees have edges, which 15 lobes soften; on own grids it was 2 to 14 %
    assert irradiance_error(fit.lobes, reference) < 0.02


@pytest.mark.parametrize(("peak", "settings"), [(1.0, BRIEF), (65504.0, BRIEF), (1e9, FAST)])
def test_all_light_in_one_texel_keeps_its_flux_and_place(
    peak: float, settings: FirstFrameSettings
) -> None:
    reference = torch.zeros(64, 128, 3)
    reference[20, 77] = peak
    fit = fit_first_frame(reference, 15, Form.ASG, settings)
    direction = latlong.directions(64, 128)[20, 77]
    assert angle_deg(fit.lobes.axis_z[brightest(fit.lobes)], direction) < 180 / 64 / 2
    torch.testing.assert_close(
        asg.flux(fit.lobes).double().sum(0), flux_of(reference), rtol=0.005, atol=0
    )


def test_moving_sun_keeps_its_lobes() -> None:
    references = [sky_and_sun(degrees) for degrees in range(0, 40, 5)]
    fits = follow(references, FitOptions(lobes=5))
    own = []
    for degrees, fit in zip(range(0, 40, 5), fits, strict=True):
        angle = math.radians(degrees)
        cos, sin = math.cos(math.radians(30)), math.sin(math.radians(30))
        direction = torch.tensor([cos * math.sin(angle), sin, cos * math.cos(angle)])
        flux = asg.flux(fit.lobes).sum(-1)
        narrow = fit.lobes.sharpness.amin(-1) > 100  # sigma of 4 degrees; the sky's are below 10
        share = torch.where(narrow, flux, 0.0) / flux[narrow].sum()
        for lobe in torch.nonzero(share > 0.1).flatten().tolist():
            assert angle_deg(fit.lobes.axis_z[lobe], direction) < 1.5  # of a texel of 2.8
        own.append(share)
    # several may share the sun and pass it to each other; one has a good part of it all the while
    assert float(torch.stack(own).amin(0).max()) > 0.2


def test_frozen_sequence_stays_still() -> None:
    # broad lobes go on to turn for some frames: by degrees with five, of which none is spare
    fits = follow([sky_and_sun(10.0, 32)] * 4, FitOptions(lobes=8))
    first, last = fits[1].lobes, fits[-1].lobes
    assert float((first.axis_z * last.axis_z).sum(-1).min()) > math.cos(math.radians(3))


@pytest.fixture(scope="module")
def one_lamp() -> tuple[Tensor, Lobes]:
    """Return the map of a broad lamp, and three lobes that lie on it."""
    off = texels.texel_means(lamps([(0, 1, 0)], [1.0], [1.0]), 64, 128)
    return off, fit_first_frame(off, 3, Form.ASG).lobes


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("lamp", [(1.0, -0.3, 0.0), (0.9, -0.3, 0.3), (0.5, -0.2, -1.0)])
def test_lamp_that_switches_on_gets_a_dark_lobe(
    one_lamp: tuple[Tensor, Lobes], lamp: tuple[float, ...], index: int
) -> None:
    off, first = one_lamp  # any of the three could hold the light
    on = off + texels.texel_means(lamps([lamp], [80.0], [10.0]), 64, 128)
    dark = first.amplitude.clone()
    dark[index] = 0
    start = with_spare_tracks(Lobes(first.axes, first.sharpness, dark))
    lit = fit_next_frame(on, start)
    direction = torch.nn.functional.normalize(torch.tensor(lamp), dim=0)
    new = [track for track in (index, 3, 4, 5) if float(lit.lobes.amplitude[track].max()) > 1.0]
    assert min(angle_deg(lit.lobes.axis_z[track], direction) for track in new) < 2.0
    assert frame_errors(lit.lobes, on).values["r0.5"] < 0.02


def test_hard_cut_starts_afresh() -> None:
    indoors = texels.texel_means(
        lamps([(1, 0.1, 0), (-0.3, 0.8, 0.5), (0, -1, 0)], [300.0, 40.0, 1.0], [40.0, 6.0, 0.5]),
        32,
        64,
    )
    outdoors = fit_first_frame(sky_and_sun(20.0, 32), 5, Form.ASG, BRIEF).lobes
    cut = fit_frame(indoors, FitOptions(lobes=5, moving=True), outdoors)
    fresh = fit_first_frame(indoors, 5, Form.ASG)
    assert cut.loss <= 1.5 * fresh.loss + 0.02


def test_exposure_jump_is_followed() -> None:
    reference, options = sky_and_sun(20.0, 32), FitOptions(lobes=5, moving=True)
    first = fit_frame(reference, options, None)
    for stops in (-40.0, -12.0, 12.0, 40.0):
        factor = 2.0**stops
        jumped = fit_frame(factor * reference, options, first.lobes)
        assert jumped.loss <= 1.1 * first.loss + 0.01, stops
        ratio = asg.flux(jumped.lobes).sum(0) / asg.flux(first.lobes).sum(0)
        torch.testing.assert_close(ratio / factor, torch.ones(3), rtol=1e-3, atol=0)


@pytest.mark.parametrize(("form", "seed"), [*zip(Form, range(4), strict=True)])
def test_maps_beyond_the_lobes_keep_their_flux(
    form: Form, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Far too few lobes for a map of patches: the L1 error alone would rather go dark."""
    generator = torch.Generator().manual_seed(seed)
    maps = []
    for _ in range(2):
        radiance = 0.1 * torch.rand(32, 64, 3, generator=generator)
        for _ in range(5):
            row, column = (int(v) for v in torch.randint(0, 28, (2,), generator=generator))
            light = 10 ** (4 * torch.rand(1, generator=generator)) * torch.rand(
                3, generator=generator
            )
            radiance[row : row + 3, 2 * column : 2 * column + 4] = light
        maps.append(radiance)
    first = fit_first_frame(maps[0], 2, form, UNWEIGHTED)
    # the second follows: from nothing it would be another first
    monkeypatch.setattr(lost, "LOST", math.inf)
    second = fit_next_frame(maps[1], with_spare_tracks(first.lobes))
    for fit, radiance in zip((first, second), maps, strict=True):
        found = flux_of(texels.texel_means(fit.lobes, 32, 64))
        torch.testing.assert_close(found, flux_of(radiance), rtol=1e-4, atol=0)


def _with_threads(count: int) -> list[Lobes]:
    """Return a first frame, which presets but the best have in common, and what follows of it."""
    maps = [sky_and_sun(angle, height=128) for angle in (0.0, 8.0)]
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        first = fit_frame(maps[0], FitOptions(lobes=8, moving=True), None).lobes
        nexts = [FitOptions(lobes=8, preset=each, moving=True) for each in FOLLOWING]
        return [first, *(fit_frame(maps[1], options, first).lobes for options in nexts)]
    finally:
        torch.set_num_threads(before)


FOLLOWING = (Preset.LIVE, Preset.FAST)


def test_same_input_gives_the_same_bits_on_any_number_of_threads() -> None:
    for one, other in zip(*(_with_threads(n) for n in (1, 2)), strict=True):
        for name in ("axes", "sharpness", "amplitude"):
            assert torch.equal(getattr(one, name), getattr(other, name))


VMF_EM = {  # 15 isotropic lobes, 40 EM iterations, 256 x 512: (env, irr, r0.5)
    "apartment": (0.286, 0.0129, 0.0285),
    "dawn": (0.379, 0.0234, 0.0468),
    "esplanade": (0.799, 0.0120, 0.0379),
    "forest": (0.867, 0.0165, 0.0319),
    "lobby": (0.710, 0.0144, 0.0466),
    "night": (0.410, 0.0251, 0.0466),
    "studio": (0.302, 0.0013, 0.0050),
    "sunset": (0.273, 0.0306, 0.0585),
    "venice": (0.228, 0.0251, 0.0447),
    "workshop": (1.020, 0.0094, 0.0349),
}


HARDEST = "forest"
"""On which EM is not better, and comes near; the two of ten on which it may be are others."""


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(not (SHARED / "hdri").is_dir(), reason="../shared/hdri is not there")
def test_fast_is_no_worse_than_em_on_eight_of_ten_real_maps() -> None:
    better = []
    names = tuple(VMF_EM) if is_thorough() else (HARDEST,)
    for name in names:
        reference = read_latlong(SHARED / "hdri" / f"{name}.exr").radiance
        errors = frame_errors(fit_first_frame(reference, 15, Form.ASG).lobes, reference).values
        ours = (errors["env"], errors["irr"], errors["r0.5"])
        better.append(all(a <= b for a, b in zip(ours, VMF_EM[name], strict=True)))
    assert sum(better) >= 0.8 * len(names), dict(zip(names, better, strict=True))


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
def test_a_map_whose_mean_is_below_the_smallest_number_is_black(preset: Preset) -> None:
    faint = torch.zeros(32, 64, 3)
    faint[10, 20] = 1e-42  # the mean over the sphere is 7e-46
    options = FitOptions(2, preset).settled(3)
    first = fit_frame(faint, options, None)
    assert float(first.lobes.amplitude.max()) == 0
    lit = fit_frame(torch.ones(32, 64, 3), options, first.lobes)
    assert float(lit.lobes.amplitude.max()) > 0
    assert float(fit_frame(faint, options, lit.lobes).lobes.amplitude.max()) == 0


@pytest.mark.parametrize("preset", [Preset.FAST, Preset.BEST])
def test_the_first_light_after_black_is_fitted_as_a_first_frame(preset: Preset) -> None:
    radiance, options = sky_and_sun(30.0, 32), FitOptions(3, preset).settled(2)
    black = fit_frame(torch.zeros_like(radiance), options, None)
    alone, lit = fit_frame(radiance, options, None), fit_frame(radiance, options, black.lobes)
    assert lit.loss == alone.loss
    assert torch.equal(*(fit.lobes.amplitude.sort(dim=0).values for fit in (alone, lit)))


@pytest.mark.parametrize(
    ("settings", "loss_max", "spent"),
    [(FAST, 2.0, [FAST]), (BEST, 2.0, [FAST, BEST]), (BEST, 0.5, [FAST])],
)
def test_a_cut_is_fitted_from_nothing_with_what_the_preset_spends(
    settings: FirstFrameSettings, loss_max: float, spent: list[FirstFrameSettings]
) -> None:
    asked, some = [], lamps([(0.0, 0.0, 1.0)], [20.0], [1.0])

    def fitted(given: FirstFrameSettings) -> FrameFit:
        asked.append(given)
        return FrameFit(some, loss=1.0, flux_error=0.0)

    found = next_frame._if_better(fitted, settings, loss_max)
    assert (found is not None, asked) == (loss_max > 1, spent)
