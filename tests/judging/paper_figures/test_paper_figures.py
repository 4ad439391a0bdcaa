# SPDX-License-Identifier: Apache-2.0
"""What the paper's figures measure, on maps whose answer is known."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import pytest
import torch
from lobe_cases import lamps, sky_and_sun
from torch import Tensor

from asglight.fitting import sequence
from asglight.fitting.first_frame.fit import FAST, LAST
from asglight.fitting.options import Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper.losses import Loss
from asglight.judging.following import JUMP_DEG
from asglight.judging.metrics import map_errors
from asglight.judging.paper_figures import data as paper_figures
from asglight.judging.paper_figures import over_time as paper_figures_time
from asglight.judging.paper_figures.data import OURS, PAPER, Plan, by_label
from asglight.judging.paper_figures.over_time import (
    INDEPENDENT,
    WITH,
    WITHOUT,
    liveliest_row,
    stacked,
)
from asglight.lobes import Form, Lobes, texels
from asglight.peers.approximation import LOBE_FLOATS

HEIGHT = 16
PLAN = Plan(2, counts=(1, 3), steps=12, rows=8, seeds=2, ball_size=4)


def quiet(items: Iterable[Any], label: str, count: int) -> Iterator[Any]:
    yield from items


@pytest.fixture
def plain_balls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let balls show the mean of their map, and fits be brief: stand-ins for a minute of work."""
    brief = replace(FAST, spreads_deg=FAST.spreads_deg[:1], levels=(replace(LAST, steps=4),))
    settings = replace(sequence._SETTINGS[Preset.FAST], afresh=brief)
    monkeypatch.setitem(sequence._SETTINGS, Preset.FAST, settings)

    def render(maps: Tensor, roughness: tuple[float, ...], *, size: int) -> Tensor:
        mean = maps.mean((1, 2))[:, None, None, None]
        return mean.expand(-1, len(roughness), size, size, 3)

    monkeypatch.setattr(paper_figures, "render_balls", render)


@pytest.mark.usefixtures("plain_balls")
def test_sweep_has_every_count_twice_and_judges_on_the_map_as_it_is() -> None:
    reference = sky_and_sun(30.0, HEIGHT)
    still = paper_figures.lobe_sweep(reference, PLAN, quiet)
    found = [(row.fit.method, row.fit.lobes.count, row.fit.steps) for row in still.rows]
    assert found == [(OURS, 1, 0), (OURS, 3, 0), (PAPER, 1, 12), (PAPER, 3, 12)]
    for row in still.rows:
        shown = texels.texel_means(row.fit.lobes, HEIGHT, 2 * HEIGHT).float()
        assert row.errors == pytest.approx(map_errors(shown, reference).values, rel=1e-5)
        # only those in the picture; the stand-in's balls are means of maps
        means = shown.mean((0, 1)), reference.mean((0, 1))
        expected = float((means[0] - means[1]).abs().sum() / means[1].sum())
        balls = (expected,) * len(paper_figures.ROUGHNESS) if row.fit.method == OURS else ()
        assert row.ball_errors == pytest.approx(balls, rel=1e-4)


@pytest.mark.usefixtures("plain_balls")
def test_ablation_differs_in_nothing_but_the_loss() -> None:
    reference = sky_and_sun(30.0, HEIGHT)
    still = paper_figures.loss_ablation(reference, PLAN, quiet)
    groups = dict(by_label(still.rows, PAPER))
    assert list(groups) == [loss.value for loss in Loss]
    coarse = paper_figures.coarsened(reference, 8)
    for loss in Loss:
        for seed, row in enumerate(groups[loss.value]):
            begin = paper.start(coarse, 2, Form.ASG, seed)
            again = paper.fit_frame(coarse, begin, steps=12, loss=loss)
            assert torch.equal(row.fit.lobes.amplitude, again.amplitude)
            assert (row.balls is None) == (seed > 0)
    assert [row.fit.method for row in still.rows].count(OURS) == 1


@pytest.mark.usefixtures("plain_balls")
def test_forms_have_as_many_lobes_or_as_many_floats() -> None:
    still = paper_figures.form_comparison(sky_and_sun(30.0, HEIGHT), Plan(3, ball_size=4), quiet)
    found = [(row.fit.lobes.form, row.fit.lobes.count, row.fit.floats) for row in still.rows]
    assert found == [
        (Form.SG, 3, 18), (Form.SG, 4, 24), (Form.ASG, 3, 24), (Form.BINGHAM, 3, 24)
    ]  # fmt: skip
    assert LOBE_FLOATS[Form.ASG] * 3 == 24


def test_ball_errors_are_sums_over_the_reference() -> None:
    reference = torch.full((2, 4, 4, 3), 2.0)
    balls = reference.clone()
    balls[0, :, :, 0] += 3.0  # a channel of three
    balls[1, 0] -= 1.0  # a row of four
    assert paper_figures.ball_errors(balls, reference) == pytest.approx((0.5, 0.125))


def test_a_map_is_averaged_down_and_never_up() -> None:
    fine = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0))
    assert paper_figures.coarsened(fine, 8).shape == (8, 16, 3)
    assert paper_figures.coarsened(fine, 64) is fine


def moving_lamp(frame: int) -> Lobes:
    """Return a lamp that goes 15 degrees to the left a frame, 15 degrees above the horizon."""
    angle = torch.tensor(15.0 * frame).deg2rad()
    level = torch.tensor(15.0).deg2rad()
    towards = (
        float(level.cos() * angle.sin()), float(level.sin()), float(level.cos() * angle.cos())
    )  # fmt: skip
    return lamps([towards, (0.0, 1.0, 0.0)], [200.0, 1.0], [10.0, 0.1])


def test_the_row_that_is_shown_is_the_one_in_which_a_lamp_moves() -> None:
    shot = torch.stack([texels.texel_means(moving_lamp(k), 18, 36).float() for k in range(3)])
    index = liveliest_row(shot)
    assert index == 7  # of rows of 10 degrees the one from +20 to +10, where the lamp is
    shot[:, 5] = torch.tensor([0.0, 5.0, 0.0])[:, None, None]  # blinks all over
    assert liveliest_row(shot) == 5
    shot[:, 0] = torch.tensor([0.0, 8.0, 0.0])[:, None, None]  # more so, but it is one direction
    assert liveliest_row(shot) == 5


def test_a_row_is_found_by_its_latitude() -> None:
    assert [paper_figures_time.row_at(latitude, 18) for latitude in (90, 81, 79, 0.1, -0.1)] == [
        0, 0, 1, 8, 9
    ]  # fmt: skip
    assert paper_figures_time.row_at(-90, 18) == 17


def test_stacked_row_of_a_moving_lamp_is_a_line_that_goes_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Replace the fits: every way but one returns the truth, that one the first frame for ever."""
    frames = range(5)
    shot = [texels.texel_means(moving_lamp(k), HEIGHT, 2 * HEIGHT).float() for k in frames]

    def truth(references: Iterable[Tensor], plan: Plan, name: str) -> tuple:
        truths = [moving_lamp(0 if name == WITH else k) for k, _ in enumerate(references)]
        return truths, 7, 0.5

    monkeypatch.setattr(paper_figures_time, "_paper_way", truth)
    monkeypatch.setattr(
        paper_figures_time, "_our_way", lambda items, plan, shot: truth(items, plan, OURS)
    )
    found = stacked(shot, [10, 11, 12, 13, 14], PLAN, quiet)
    assert found.frames == (10, 11, 12, 13, 14)
    ways = {way.name: way for way in found.ways}
    assert list(ways) == [WITH, WITHOUT, INDEPENDENT, OURS]
    # the brightest column: lon = pi - 2 pi u, so 15 degrees a frame is 32 / 24 columns to the left
    columns = found.row.sum(-1).argmax(1).float()
    expected = 15.5 - (32 / 24) * torch.arange(5)
    assert (columns - expected).abs().max() <= 1
    torch.testing.assert_close(ways[OURS].row, found.row)
    torch.testing.assert_close(ways[WITH].row, found.row[:1].expand_as(found.row))
    # What a glossy ball shows is brightest where its normal meets the lamp, of 128 columns.
    peaks = found.glossy.sum(-1).argmax(1).float()
    # A texel of 32 columns is four of these wide.
    assert (peaks - (63.5 - (128 / 24) * torch.arange(5))).abs().max() <= 2.5
    torch.testing.assert_close(ways[OURS].glossy, found.glossy)
    # Judged as a whole: what does not move has all of the map's change as its flicker.
    assert ways[OURS].mean["flicker"] < 1e-6
    assert ways[WITH].mean["flicker"] > 0.1
    assert JUMP_DEG < 15.0
    assert (ways[OURS].jumps, ways[WITH].jumps) == (4, 0)
    assert (ways[OURS].steps, ways[OURS].seconds) == (7, 0.5)


def test_the_ways_of_the_recipe_differ_in_start_and_temporal_term(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[int, bool, bool]] = []
    fitted: list[Lobes] = []

    def fit(reference: Tensor, begin: Lobes, *, steps: int, previous: Lobes | None) -> Lobes:
        goes_on = bool(fitted) and begin is fitted[-1]
        asked.append((steps, goes_on, previous is not None and previous is fitted[-1]))
        fitted.append(lamps([(0.0, 0.0, 1.0)], [10.0], [1.0]))
        return fitted[-1]

    monkeypatch.setattr(paper, "fit_frame", fit)
    maps = [sky_and_sun(k, 8) for k in (0.0, 1.0, 2.0)]
    plan = Plan(1, steps=8)
    _, total, _ = paper_figures_time._paper_way(maps, plan, WITH)
    assert asked == [(8, False, False), (2, True, True), (2, True, True)]
    assert total == 12
    asked.clear()
    fitted.clear()
    paper_figures_time._paper_way(maps, plan, WITHOUT)
    assert asked == [(8, False, False), (2, True, False), (2, True, False)]
    asked.clear()
    fitted.clear()
    paper_figures_time._paper_way(maps, plan, INDEPENDENT)
    assert asked == [(8, False, False)] * 3
