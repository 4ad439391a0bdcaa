# SPDX-License-Identifier: Apache-2.0
"""Flat lobes are chosen for lamps with edges, and only for them."""

import math
from dataclasses import replace

import pytest
import torch

from asglight.fitting.first_frame import flat_tops
from asglight.fitting.first_frame.fit import FAST, dark_lobes, fit_first_frame
from asglight.fitting.options import AUTO, FORM_NAMES, FitOptions, Preset, form_of
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import newton
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around, canonical
from asglight.sphere import latlong

ROWS = 32
PLACES = ((0.3, 0.4, 1.0), (-1.0, 0.3, 0.2), (0.9, -0.2, -0.8))


def directions_to() -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor(PLACES), dim=-1)


def boxes(rows: int = ROWS) -> torch.Tensor:
    """Return a map of three lamps with edges, each seen within 14 degrees of its middle."""
    directions = latlong.directions(rows, 2 * rows).reshape(-1, 3)
    inside = directions @ directions_to().mT > math.cos(math.radians(14))
    light = inside.float() @ torch.tensor([[9.0, 8.0, 7.0], [5.0, 5.0, 6.0], [3.0, 4.0, 4.0]])
    return (0.05 + light).reshape(rows, 2 * rows, 3)


def glows() -> torch.Tensor:
    """Return a map of asg lobes in the same places."""
    lobes = Lobes(axes_around(directions_to()), torch.full((3, 2), 20.0), torch.ones(3, 3))
    return 0.05 + texels.texel_means(lobes, ROWS, 2 * ROWS)


def test_lamps_with_edges_get_flat_lobes_and_smaller_errors() -> None:
    reference = boxes()
    plain = fit_frame(reference, FitOptions(5), None)
    chosen = fit_frame(reference, FitOptions(5, form=None), None)
    assert plain.lobes.form is Form.ASG
    assert chosen.lobes.form is Form.FLAT
    assert chosen.loss < (1 - flat_tops.GAIN) * plain.loss
    errors = [frame_errors(fit.lobes, reference).values for fit in (plain, chosen)]
    for metric in ("env", "r0.25"):
        assert errors[1][metric] < errors[0][metric]
    assert abs(chosen.flux_error) < 1e-6


def test_where_asg_lobes_are_right_the_choice_changes_no_bit() -> None:
    plain = fit_frame(glows(), FitOptions(4), None).lobes
    chosen = fit_frame(glows(), FitOptions(4, form=None), None).lobes
    assert chosen.form is Form.ASG
    for one, other in (
        (plain.axes, chosen.axes),
        (plain.sharpness, chosen.sharpness),
        (plain.amplitude, chosen.amplitude),
    ):
        assert torch.equal(one, other)


def test_live_and_paper_do_not_choose() -> None:
    live = fit_frame(boxes(), FitOptions(3, Preset.LIVE, form=None), None)
    assert live.lobes.form is Form.ASG
    paper = fit_frame(boxes(), FitOptions(3, Preset.PAPER, form=None, paper_steps=(1, 1)), None)
    assert paper.lobes.form is Form.ASG


def test_next_frames_keep_the_form() -> None:
    one_start = replace(FAST, spreads_deg=FAST.spreads_deg[:1])
    reference = boxes(64)
    first = canonical(fit_first_frame(reference, 4, Form.FLAT, one_start).lobes)
    before = frame_errors(first, reference).values
    for preset in (Preset.LIVE, Preset.FAST):
        following = fit_frame(1.1 * reference, FitOptions(4, preset, form=None), first)
        assert following.lobes.form is Form.FLAT
        # the same map, a tenth brighter: as good a fit, but for what the temporal term holds back
        errors = frame_errors(following.lobes, 1.1 * reference).values
        for metric in ("env", "irr", "r0.5", "r0.25"):
            assert errors[metric] < 1.1 * before[metric]


def test_a_black_frame_is_no_reason_for_flat_lobes() -> None:
    black = torch.zeros(16, 32, 3)
    assert fit_first_frame(black, 3, None).lobes.form is Form.ASG
    assert dark_lobes(3, Form.FLAT, black).form is Form.FLAT


@pytest.mark.parametrize(("value", "gained"), [(0.9, True), (0.98, False), (1.1, False)])
def test_a_gain_is_a_share_of_the_loss(value: float, gained: bool) -> None:
    lobes = dark_lobes(1, Form.ASG, torch.zeros(16, 32, 3))[None]
    one, other = (
        newton.Outcome(lobes, torch.tensor([j]), torch.tensor([1.0])) for j in (value, 1.0)
    )
    assert flat_tops.gains(one, other) == gained


def test_names_of_forms_are_the_forms_and_the_choice() -> None:
    assert FORM_NAMES == (AUTO, "asg", "bingham", "sg", "flat")
    assert [form_of(name) for name in FORM_NAMES] == [None, *Form]
