# SPDX-License-Identifier: Apache-2.0
"""The pass over a whole shot: steadier and no worse; cuts, black frames, leashes, dark lobes."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import follow, lamps, sky_and_sun
from torch import Tensor

from asglight.fitting import between, objective, temporal, whole_shot
from asglight.fitting.between import RISE
from asglight.fitting.coordinates import UNKNOWNS, advance
from asglight.fitting.first_frame import Exposed, exposed
from asglight.fitting.following import LEASH_DEG
from asglight.fitting.lobe_images import images
from asglight.fitting.objective import ENV_WEIGHT
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.probes import PROBES
from asglight.fitting.whole_shot import refine_shot
from asglight.judging.following import jumps
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import joined, stack
from asglight.lobes.frames import parallel_transport
from asglight.lobes.matching import flux_shares

LIVE = FitOptions(lobes=4, preset=Preset.LIVE)

FIELDS = ("axes", "sharpness", "amplitude")


def _fitted(maps: list[Tensor]) -> Lobes:
    return stack([fit.lobes for fit in follow(maps, LIVE)])


def _refined(
    shot: Lobes, maps: list[Tensor], chunk: int = 16, *, links: bool = False, threads: int = 1
) -> tuple[Lobes, list[float]]:
    frames = [exposed(radiance) for radiance in maps]
    chunks: list[list[Exposed]] = [frames[at : at + chunk] for at in range(0, len(frames), chunk)]
    done: list[tuple[int, int]] = []
    found = refine_shot(
        shot,
        lambda: chunks,
        links=links,
        threads=threads,
        on_chunk=lambda *each: done.append(each),
    )
    counts = [min(at, len(maps)) for at in range(chunk, len(maps) + chunk, chunk)]
    readings = 2 if links else 1
    assert done == [
        (reading * len(maps) + count, readings * len(maps))
        for reading in range(readings)
        for count in counts
    ]
    return found


def _noisy(frames: int) -> list[Tensor]:
    """Return a still scene under noise of a fifth of each texel."""
    generator = torch.Generator().manual_seed(0)
    still = sky_and_sun(20.0)
    return [still * (1 + 0.2 * torch.randn(still.shape, generator=generator)).clamp(min=0)
            for _ in range(frames)]  # fmt: skip


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
    maps = _noisy(6)
    shot = _fitted(maps)
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
        assert sums[1][name] < (1 + RISE) * sums[0][name], name
    # judged on texel centres: (pi / 64)^2 / 24
    assert max(errors["flux"] for errors in after) < 2e-4
    assert all(0 < loss < 1 for loss in losses)


@pytest.mark.parametrize("links", [False, True])
def test_a_shot_comes_to_the_same_on_any_number_of_threads(links: bool) -> None:
    maps = _noisy(2 * between.GROUP + 3)  # two groups of even places
    shot = _fitted(maps)
    alone, losses = _refined(shot, maps, links=links)
    found, same_losses = _refined(shot, maps, links=links, threads=3)
    assert same_losses == losses
    assert all(torch.equal(getattr(found, name), getattr(alone, name)) for name in FIELDS)
    assert not torch.equal(alone.amplitude, shot.amplitude)


def test_frames_read_in_chunks_are_all_refined() -> None:
    maps = _noisy(5)
    shot = _fitted(maps)
    found, losses = _refined(shot, maps, chunk=2)
    assert len(losses) == 5
    moved = (found.amplitude - shot.amplitude).abs().flatten(1).amax(-1)
    assert bool((moved > 0).all())


def test_no_lit_lobe_turns_beyond_the_leash() -> None:
    maps = [sky_and_sun(9.0 * step) for step in range(5)]
    shot = _fitted(maps)
    found, _ = _refined(shot, maps)
    for k in range(4):
        cosine = (found.axis_z[k] * found.axis_z[k + 1]).sum(-1)
        turned = torch.rad2deg(torch.acos(cosine.clamp(-1, 1)))
        before = (shot.axis_z[k] * shot.axis_z[k + 1]).sum(-1)
        near = before > math.cos(math.radians(LEASH_DEG))
        assert float(turned[near].max()) < LEASH_DEG + 0.05  # arccos of float32 near 1


def test_a_cut_parts_the_shot() -> None:
    indoors = texels.texel_means(
        lamps([(1, 0.1, 0), (-0.3, 0.8, 0.5), (0, -1, 0)], [300.0, 40.0, 1.0], [40.0, 6.0, 0.5]),
        64,
        128,
    )
    before, after = _noisy(2), [indoors] * 2
    shots = [_fitted(maps) for maps in (before, after)]
    whole = Lobes(*(torch.cat([getattr(shot, name) for shot in shots])
                    for name in ("axes", "sharpness", "amplitude")))  # fmt: skip
    together, _ = _refined(whole, before + after)
    alone, _ = _refined(shots[0], before)
    # frame 1 is at an odd place in both, and its neighbour beyond the cut holds it by nothing
    torch.testing.assert_close(together.axis_z[1], alone.axis_z[1], rtol=0, atol=1e-3)
    # not axis x: how a lobe that is nearly round is turned shows in nothing
    shown = [texels.texel_means(shot[1], 64, 128) for shot in (together, alone)]
    assert float((shown[0] - shown[1]).abs().sum() / shown[1].sum()) < 0.01


def test_black_frames_stay_as_they_are() -> None:
    maps = _noisy(3)
    maps[1] = torch.zeros_like(maps[1])
    shot = _fitted(maps)
    found, losses = _refined(shot, maps)
    assert losses[1] == 0.0
    assert torch.equal(found.amplitude[1], torch.zeros_like(found.amplitude[1]))
    assert torch.equal(found.axes[1], shot.axes[1])
    assert bool(found.amplitude.isfinite().all())


def _three_lamps(light: list[float]) -> Lobes:
    return lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 60.0], light)


def test_a_lobe_that_turns_stays_dark_and_one_that_does_not_is_lit() -> None:
    """Between two lit places it is dark for two frames, and turns between these."""
    lit, dark = _three_lamps([1.0, 8.0, 5.0]), _three_lamps([1.0, 8.0, 0.0])
    elsewhere = lamps([(0, 1, 0.2), (1, 0.2, 0), (0.3, 0.1, 1)], [2.0, 30.0, 60.0], [1.0, 8.0, 0.0])
    shot = stack([lit, dark, elsewhere, elsewhere])
    maps = [texels.texel_means(_three_lamps([1.0, 8.0, 5.0]), 64, 128)] * 4
    maps[3] = maps[3] + texels.texel_means(replace(elsewhere, amplitude=lit.amplitude), 64, 128)
    found, _ = _refined(shot, maps)
    shares = torch.stack([flux_shares(found[k])[2] for k in range(4)])
    assert float(shares[1]) == 0.0
    assert float(shares[2]) == 0.0
    assert float(shares[0]) > 0.01
    assert float(shares[3]) > 0.01  # it was dark in this frame, where nothing holds it
    assert jumps([found[k] for k in range(4)]) == 0


def _overhead(degrees: float) -> Tensor:
    """Return a map of a lamp that passes the zenith, longer than wide, over a room of lamps."""
    angle = math.radians(degrees)
    ways = [angle + math.radians(offset) for offset in (-12.0, 0.0, 12.0)]
    lamp = [(0.05, math.cos(way), math.sin(way)) for way in ways]
    others = [(1.0, 0.3, 0.2), (-1.0, 0.2, 0.4), (0.3, -0.4, -1.0), (0.0, -1.0, 0.1)]
    scene = lamps(
        [*lamp, *others],
        [90.0, 90.0, 90.0, 60.0, 40.0, 90.0, 0.6],
        [12.0, 14.0, 10.0, 4.0, 3.0, 3.0, 0.1],
    )
    return texels.texel_means(scene, 64, 128)


def _passing() -> list[Tensor]:
    """Return frames between which it moves by twice as far as a lit lobe may turn."""
    return [_overhead(-70.0 + 20.0 * frame) for frame in range(8)]


def _wrong(shot: Lobes, maps: list[Tensor]) -> float:
    return sum(frame_errors(shot[k], each).values["r0.5"] for k, each in enumerate(maps))


def _left_behind(maps: list[Tensor]) -> Lobes:
    """Return the lobes of the first frame for every frame, as if none had been followed."""
    first = follow(maps[:1], FitOptions(lobes=8, preset=Preset.FAST))[0].lobes
    return stack([first] * len(maps))


def test_links_follow_a_lamp_that_outruns_the_leash() -> None:
    maps = _passing()
    shot = _left_behind(maps)
    followed, _ = _refined(shot, maps)
    linked, losses = _refined(shot, maps, links=True)
    assert _wrong(linked, maps) < 0.5 * _wrong(followed, maps)
    assert jumps([linked[k] for k in range(len(maps))]) == 0
    assert all(0 < loss < 0.5 for loss in losses)


def test_links_that_show_more_wrong_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    maps = _passing()
    shot = _left_behind(maps)
    followed, losses = _refined(shot, maps)
    spoilt = replace(shot, axes=shot.axes.roll(4, dims=1), amplitude=shot.amplitude * 0.1)
    monkeypatch.setattr(whole_shot, "linked", lambda *_: spoilt)
    monkeypatch.setattr(whole_shot, "LINKED_SWEEPS", 1)
    found, found_losses = _refined(shot, maps, links=True)
    assert found_losses == losses
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(found, name), getattr(followed, name))


def test_nothing_is_linked_where_lobes_keep_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> Lobes:
        raise AssertionError

    monkeypatch.setattr(whole_shot, "linked", forbidden)
    maps = _noisy(5)
    shot = _fitted(maps)
    linked, losses = _refined(shot, maps, links=True)
    followed, expected = _refined(shot, maps)
    assert losses == expected
    assert torch.equal(linked.axes, followed.axes)


def test_a_black_frame_among_those_that_are_linked() -> None:
    maps, options = _passing(), FitOptions(lobes=8, preset=Preset.LIVE)
    maps[4] = torch.zeros_like(maps[4])
    shot = stack([fit.lobes for fit in follow(maps, options)])
    found, losses = _refined(shot, maps, links=True)
    assert losses[4] == 0.0
    assert float(found.amplitude[4].abs().max()) == 0.0
    assert all(bool(t.isfinite().all()) for t in (found.axes, found.sharpness, found.amplitude))


def test_frames_between_free_ones_are_free() -> None:
    wanted = torch.zeros(30, dtype=torch.bool)
    wanted[[3, 5, 5 + whole_shot.GAP + 1, 29]] = True
    found = torch.nonzero(whole_shot._stretches(wanted)).flatten().tolist()
    assert found == [*range(3, 5 + whole_shot.GAP + 2), 29]


def test_frames_of_different_sizes_stay_as_they_are() -> None:
    maps = [sky_and_sun(0.0, height=32), sky_and_sun(0.0, height=64)]
    shot = _fitted([maps[0], maps[0]])
    found, losses = _refined(shot, maps)
    assert losses == [0.0, 0.0]
    assert torch.equal(found.axes, shot.axes)


@pytest.mark.parametrize("form", list(Form))
def test_every_form_is_refined(form: Form) -> None:
    maps = _noisy(3)
    fits = follow(maps, replace(LIVE, form=form))
    found, _ = _refined(stack([fit.lobes for fit in fits]), maps)
    assert found.form is form
    assert all(bool(t.isfinite().all()) for t in (found.axes, found.sharpness, found.amplitude))


def test_a_lobe_at_the_end_of_its_leash_is_no_cut() -> None:
    """Rounded, some are beyond it, and their frames then held each other no more."""
    lobes = lamps([(0, 0, 1), (1, 0, 0)], [30.0, 60.0], [5.0, 1.0])
    angle = torch.deg2rad(torch.tensor(9.90001, dtype=torch.float64))
    after = lobes.to(torch.float64)
    axis = torch.stack([angle.sin(), angle * 0, angle.cos()])
    after.axes[0] = parallel_transport(after.axes[0], axis)
    before, after = stack([lobes.to(torch.float64)]), stack([after])
    turned = between._turned_deg(before, after)
    assert float(turned.max()) > LEASH_DEG
    assert bool(between._same_shot(before, after, turned).all())
    lit_elsewhere = torch.tensor([[50.0, 0.0]], dtype=torch.float64)
    sent = replace(after, amplitude=after.amplitude * torch.tensor([0.0, 1.0])[None, :, None])
    assert bool(between._same_shot(before, sent, lit_elsewhere).all())  # it has no light to jump
    assert not bool(between._same_shot(before, after, lit_elsewhere).any())


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
        target = objective.target(frame.radiance, between.CORNERS)
        own = replace(lobes, amplitude=lobes.amplitude / frame.exposure)[None]
        return float(objective.value(images(own, target.places).radiance, target))

    for index, radiance in enumerate(maps):
        # judged with sharper corners, which weigh small errors a little more
        assert loss(found[index], radiance) <= 1.12 * loss(shot[index], radiance)


def test_materials_are_not_traded_for_the_map() -> None:
    """A step that pays for light with detail is not kept, though J as a whole hardly grows."""
    checks = (torch.arange(64)[:, None] + torch.arange(128)) % 2  # no material sees them
    frame = exposed((0.5 + checks)[..., None].repeat(1, 1, 3))
    target = objective.target(frame.radiance, between.CORNERS)
    even = torch.full_like(target.radiance, float(target.radiance.mean()))
    brighter = even * 1.001
    values = [float(objective.value(each, target)) for each in (even, brighter)]
    assert values[1] < (1 + between.RISE) * values[0]
    assert bool(between._risen(brighter, even, target))
    assert not bool(between._risen(even, brighter, target))
    assert not bool(between._risen(even, even, target))


def test_a_shot_is_linked_on_either_side_of_a_cut() -> None:
    """No lobe is dark for the cut's sake, nor turned towards what is beyond it."""
    passing, still = _passing(), _noisy(3)
    shot = joined(_left_behind(passing), _left_behind(still))
    assert between.cuts(temporal.waiting(shot)) == [len(passing)]
    found, _ = _refined(shot, passing + still, links=True)
    followed, _ = _refined(shot, passing + still)
    assert _wrong(found, passing) < 0.5 * _wrong(followed, passing)
    after = slice(len(passing), None)
    assert _wrong(found[after], still) < 1.05 * _wrong(followed[after], still)
