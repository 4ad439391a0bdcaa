# SPDX-License-Identifier: Apache-2.0
"""What the figures say: pictures with the right marks, captions with the right sentences."""

import textwrap
from dataclasses import replace

import numpy as np
import pytest
import torch
from lobe_cases import lamps
from matplotlib.figure import Figure

from asglight.fitting.paper.losses import Loss
from asglight.judging.metrics import METRIC_NAMES
from asglight.judging.paper_figures import captions
from asglight.judging.paper_figures import sheet as sheets
from asglight.judging.paper_figures.data import (
    OURS,
    PAPER,
    ROUGHNESS,
    Fit,
    Plan,
    Row,
    Still,
    by_label,
)
from asglight.judging.paper_figures.over_time import (
    INDEPENDENT,
    WITH,
    WITHOUT,
    Followed,
    Stacked,
)
from asglight.judging.paper_figures.stack import draw_stack, wrong_change
from asglight.judging.pictures.layout import DARK, LIGHT

ERRORS = dict.fromkeys(METRIC_NAMES, 0.2)


def row(method: str, label: str, errors: dict[str, float] | None = None, seed: int = 0) -> Row:
    count = int(label) if label.isdecimal() else 2
    lobes = lamps([(0.0, 0.0, 1.0)] * count, [9.0] * count, [1.0] * count)
    fit = Fit(method, label, lobes, 12 if method == PAPER else 0, 1.5, seed)
    balls = torch.full((len(ROUGHNESS), 8, 8, 3), 0.5)
    shown = (balls, (0.25,) * len(ROUGHNESS)) if seed == 0 else (None, ())
    return Row(fit, ERRORS | (errors or {}), torch.ones(8, 16, 3), *shown)


def still(*rows: Row) -> Still:
    balls = torch.full((len(ROUGHNESS), 8, 8, 3), 0.5)
    return Still(torch.ones(8, 16, 3), balls, rows)


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.26, "126"), (0.398, "39.8"), (0.0133, "1.33"), (0.0015, "0.15"), (0.00047, "0.047"),
     (0.0, "0"), (4e-6, "0"), (6e-6, "0.001"), (0.0994, "9.94"), (0.0996, "10.0")],
)  # fmt: skip
def test_percentages_have_the_decimals_that_they_deserve(value: float, text: str) -> None:
    assert sheets.percent(value) == text


def test_sheet_marks_the_best_of_those_compared_and_gives_the_spread() -> None:
    good, bad = {"env": 0.1, "irr": 0.3}, {"env": 0.3, "irr": 0.1}
    groups = [
        [row(PAPER, "L1", good), row(PAPER, "L1", {"env": 0.12}, seed=1)],
        [row(PAPER, "L2", bad), row(PAPER, "L2", bad, seed=1)],
        [row(OURS, "fast", {"env": 0.01, "irr": 0.01})],
    ]
    found = still(*(each for group in groups for each in group))
    lines = sheets.lines_of(found, groups, ["L1", "L2", "fast"], groups[:2])
    reference, first, second, ours = lines
    assert (reference.name, reference.numbers) == ("reference", {})
    assert first.numbers["env"] == "11.0"
    assert first.spreads["env"] == "10.0–12.0"
    assert first.bold == ["env", "flux", "r0.5", "r0.25"]  # where both are alike, both
    assert second.bold == ["flux", "irr", "r0.5", "r0.25"]
    assert (ours.numbers["env"], ours.bold, ours.spreads) == ("1.00", [], {})
    assert first.details == ["2 lobes, 16 floats", "12 steps, 1.5 s"]
    figure = sheets.draw_sheet("a map", lines, "one foot\nand another", LIGHT)
    bold = [text.get_text() for text in figure.texts if text.get_fontweight() == "bold"]
    assert bold == ["11.0", "20.0", "20.0", "20.0", "20.0", "10.0", "20.0", "20.0"]
    assert texts(figure).count("25.0 %") == 3 * len(ROUGHNESS)
    assert figure.get_facecolor()[:3] == pytest.approx((0xF7 / 255, 0xF7 / 255, 0xF5 / 255))


def test_sweep_draws_errors_in_percent_against_lobes() -> None:
    rows = [row(OURS, "1"), row(OURS, "8", {"env": 0.05}), row(PAPER, "8", {"env": 0.6})]
    found = still(*rows)
    groups = [group for _, group in by_label(found.rows, OURS)]
    lines = sheets.lines_of(found, groups, ["1 lobe", "8 lobes"])
    assert [line.bold for line in lines] == [(), [], []]
    figure = sheets.draw_sweep("a map", found, lines, "foot", DARK)
    panels = [axes for axes in figure.axes if axes.get_xlabel() == "lobes"]
    assert panels[0].get_title() == "env: the map"
    curves = {line.get_label(): line.get_xydata() for line in panels[0].lines}
    assert np.allclose(curves["fast"], [[1, 20], [8, 5]])
    assert np.allclose(curves["paper's recipe"], [[8, 60]])
    assert (
        {axes.get_yscale() for axes in panels} == {axes.get_xscale() for axes in panels} == {"log"}
    )


def test_sweep_caption_names_where_the_recipe_is_ahead() -> None:
    rows = [row(OURS, "15", {"irr": 0.02, "env": 0.4}), row(OURS, "30", {"irr": 0.01})]
    found = still(*rows, row(PAPER, "15", {"env": 0.3, "irr": 0.4}), row(PAPER, "30"))
    text = " ".join(captions.lobes_caption(found, Plan(15, steps=12, rows=8)).split())
    assert "irr by 2, r0.5 by 1, r0.25 by 1" in text
    assert text.endswith("The paper's recipe is ahead of `fast`, by lobes: 15 in env.")
    assert "12 of its 24,000 Adam steps on 8 x 16 texels (published: 256 rows)" in text
    assert "| 15 | paper | 1.5 | 30.0 | 20.0 | 40.0 |" in text
    alone = still(*rows)
    assert captions.lobes_caption(alone, Plan(15)).endswith("by lobes: nowhere here.")


def test_recipe_with_all_its_steps_says_so() -> None:
    found = captions.recipe(Plan(15, steps=24_000, rows=256))
    assert found == "all its 24,000 Adam steps on 256 x 512 texels"


def ablation(best: str) -> Still:
    """Return six losses of which one is best in everything."""
    rows = [
        row(PAPER, loss.value, dict.fromkeys(METRIC_NAMES, 0.1 if loss == best else 0.2))
        for loss in Loss
    ]
    return still(*rows, row(OURS, "fast, for comparison"))


def test_ablation_caption_says_whether_it_agrees_with_the_paper() -> None:
    plan = Plan(15, seeds=1)
    differs = " ".join(captions.losses_caption(ablation(Loss.L2), plan).split())
    assert f"Best of the six here: L2 in {', '.join(METRIC_NAMES)}." in differs
    assert "Place of L1 + L_D: env 2, flux 2" in differs
    assert differs.endswith("these numbers differ from its choice.")
    agrees = captions.losses_caption(ablation(Loss.L1_LD), plan)
    assert " ".join(agrees.split()).endswith("These numbers agree with its choice.")
    prose = [line for line in agrees.splitlines() if not line.startswith("|")]
    assert max(map(len, prose)) <= captions.COLUMNS


def test_forms_caption_names_where_isotropic_lobes_are_ahead() -> None:
    few, many = row(OURS, "few", {"env": 0.5}), row(OURS, "many", {"r0.5": 0.1})
    rows = (few, many, row(OURS, "asg"), row(OURS, "bingham", {"env": 0.1, "irr": 0.1}))
    text = " ".join(captions.forms_caption(still(*rows)).split())
    assert "isotropic lobes in r0.5 with as many floats, in nothing with as many lobes" in text
    assert text.endswith("`bingham` in env, irr.")


def shot() -> Stacked:
    frames, width = 4, 16
    line = torch.zeros(frames, width, 3)
    line[torch.arange(frames), torch.arange(frames)] = 1.0
    mean = ERRORS | {"flicker": 0.04}
    glossy = 0.5 * line[:, :8]
    held = Followed(WITH, line[:1].expand(frames, -1, -1), 0 * glossy, mean, 0, 24, 0.5)
    others = [
        replace(held, name=name, row=line, glossy=glossy, jumps=3, mean=mean | {"flicker": flicker})
        for name, flicker in ((WITHOUT, 0.08), (INDEPENDENT, 0.09), (OURS, 0.01))
    ]
    return Stacked((7, 8, 9, 10), 3, 22.5, line, glossy, 0.0, (held, *others))


def test_wrong_change_is_the_fit_s_less_the_map_s_over_the_mean() -> None:
    reference = torch.zeros(3, 2, 3)
    reference[1:, 0] = 3.0  # brightens by 3, then stays; the mean is 1
    fit = torch.zeros(3, 2, 3)
    fit[2, 0] = 3.0  # a frame late
    assert wrong_change(fit, reference) == pytest.approx(np.array([[-3, 0], [3, 0]]), rel=1e-6)
    assert (wrong_change(fit, 0 * reference)[1] == [3, 0]).all()  # black: the change itself


def test_stack_has_a_panel_a_way_with_its_numbers() -> None:
    figure = draw_stack("a shot", shot(), "foot", LIGHT)
    found = texts(figure)
    assert "flicker 4.00 %, 0 jumps\nirr 20.0 %, r0.25 20.0 %\n0.50 s a frame" in found
    assert "flicker 1.00 %, 3 jumps\nirr 20.0 %, r0.25 20.0 %\n0.50 s a frame" in found
    images = [axes.images[0] for axes in figure.axes if axes.images]
    rows = [image for image in images if image.get_array().ndim == 3]
    assert len(rows) == 1 + 4
    extents = {tuple(image.get_extent()) for image in rows}
    assert extents == {(180, -180, 3.5, -0.5)}  # left edge lon = pi, the first frame above
    changes = [image for image in images if image.get_array().shape == (3, 8)]
    extents = {tuple(image.get_extent()) for image in changes}
    assert extents == {(180, -180, 3.0, 0.0)}  # each between two frames
    assert len(changes) == 4
    assert np.abs(changes[0].get_array()).max() > 0
    assert np.abs(changes[1].get_array()).max() == 0  # changes as the map does
    reference, held = rows[0].get_array(), rows[1].get_array()
    assert [int(frame[:, 0].argmax()) for frame in reference] == [0, 1, 2, 3]
    assert [int(frame[:, 0].argmax()) for frame in held] == [0] * 4


def test_stack_caption_says_what_the_temporal_term_changes() -> None:
    text = captions.time_caption(shot(), Plan(15, steps=1200))
    words = " ".join(text.split())
    assert "flicker from 8.00 to 4.00 %" in words
    assert "Frames by themselves: flicker 9.00 %" in words
    assert "300 of 6,000 for each next one, gamma 0.5" in words
    assert "| paper, without L_T | 0.50 |" in text
    assert textwrap.dedent(text) == text
