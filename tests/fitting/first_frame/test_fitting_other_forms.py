# SPDX-License-Identifier: Apache-2.0
"""Flat lobes are chosen for lamps with edges, sg lobes where there are too few asg lobes."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from asglight.fitting.first_frame import other_forms
from asglight.fitting.first_frame.fit import FAST, dark_lobes, fit_first_frame
from asglight.fitting.first_frame.reweighting import Measured
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.options import AUTO, FORM_NAMES, FitOptions, Preset, form_of
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import newton
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around, canonical
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

ROWS = 32
PLACES = ((0.3, 0.4, 1.0), (-1.0, 0.3, 0.2), (0.9, -0.2, -0.8))


def directions_to() -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor(PLACES), dim=-1)


def boxes(rows: int = ROWS) -> torch.Tensor:
    """Return a map of three lamps with edges, each seen within 14 degrees of its middle."""
    directions = latlong.directions(rows, 2 * rows).reshape(-1, 3)
    inside = directions @ directions_to().mT > math.cos(math.radians(14))
    light = inside.float() @ torch.tensor([[9.0, 8.0, 7.0], [5.0, 5.0, 6.0], [3.0, 4.0, 4.0]])
    return light.reshape(rows, 2 * rows, 3)


def glows() -> torch.Tensor:
    """Return a map of asg lobes in the same places."""
    lobes = Lobes(axes_around(directions_to()), torch.full((3, 2), 20.0), torch.ones(3, 3))
    return texels.texel_means(lobes, ROWS, 2 * ROWS)


def test_lamps_with_edges_get_flat_lobes_and_smaller_errors() -> None:
    reference = boxes()
    plain = fit_frame(reference, FitOptions(5), None)
    chosen = fit_frame(reference, FitOptions(5, form=None), None)
    assert plain.lobes.form is Form.ASG
    assert chosen.lobes.form is Form.FLAT
    assert chosen.loss < (1 - other_forms.GAIN) * plain.loss
    errors = [frame_errors(fit.lobes, reference).values for fit in (plain, chosen)]
    for metric in ("env", "r0.25"):
        assert errors[1][metric] < errors[0][metric]
    assert abs(chosen.flux_error) < 1e-6


def lamp_in_a_room(rows: int = ROWS) -> torch.Tensor:
    """Return a map of radiance 1, and 30 within 12 degrees of +X."""
    towards = latlong.directions(rows, 2 * rows)[..., 0]
    inside = (towards > math.cos(math.radians(12)))[..., None]
    return torch.where(inside, torch.tensor([30.0, 24.0, 18.0]), torch.ones(3))


def irradiance(lobes: Lobes, normal: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return E of asg or sg lobes by a sum over 100,000 directions.  [3]."""
    directions = fibonacci_directions(100_000, dtype=torch.float64).numpy()
    x, y, z = np.moveaxis(lobes.axes.double().numpy() @ directions.T, 1, 0)  # [N, P] each
    sx, sy = lobes.sharpness.double().numpy().T[..., None]
    asg = np.maximum(z, 0) * np.exp(-sx * x**2 - sy * y**2)
    value = np.exp(sx * (z - 1)) if lobes.form is Form.SG else asg
    cosine = np.maximum(directions @ np.array(normal), 0)
    return (
        4 * math.pi / len(directions) * (value * cosine).sum(-1) @ lobes.amplitude.double().numpy()
    )


@pytest.mark.parametrize("preset", [Preset.FAST, Preset.BEST])
def test_a_lamp_in_a_lit_room_takes_two_sg_lobes(preset: Preset) -> None:
    """Two asg lobes leave half of the room dark where one of them stands for the lamp."""
    reference = lamp_in_a_room()
    chosen = fit_frame(reference, FitOptions(2, preset, form=None), None).lobes
    assert chosen.form is Form.SG
    room = math.pi  # of radiance 1 all around
    for normal in ([-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]):
        lamp = irradiance_of_texels(reference - 1, normal)
        assert irradiance(chosen, normal) == pytest.approx(room + lamp, rel=0.01)
    plain = fit_frame(reference, FitOptions(2, preset), None).lobes
    off = [np.abs(irradiance(each, [-1.0, 0.0, 0.0]) - room).max() for each in (plain, chosen)]
    assert off[1] < 0.1 * off[0]


def irradiance_of_texels(
    radiance: torch.Tensor, normal: Sequence[float] | np.ndarray
) -> np.ndarray:
    """Return E of a map whose texels shine from their middles.  [3]."""
    rows = len(radiance)
    edges = np.cos(np.linspace(0, math.pi, rows + 1))
    solid_angle = (edges[:-1] - edges[1:])[:, None] * math.pi / rows
    cosine = np.maximum(latlong.directions(rows, 2 * rows).double().numpy() @ np.array(normal), 0)
    return np.einsum("hw,hwc->c", solid_angle * cosine, radiance.double().numpy())


def test_a_sun_and_its_sky_take_sg_lobes_where_asg_lobes_shared_out_the_sky() -> None:
    """The four asg lobes as sg ones gain nothing in the steps of a trial."""
    reference = torch.tensor([0.2, 0.3, 0.5]).repeat(64, 128, 1)
    reference[20, 70] = torch.tensor([20000.0, 18000.0, 15000.0])
    chosen = fit_frame(reference, FitOptions(4, form=None), None).lobes
    assert chosen.form is Form.SG
    sun = latlong.directions(64, 128)[20, 70].double().numpy()
    for normal in (sun, -sun):
        expected = irradiance_of_texels(reference, normal)
        assert irradiance(chosen, normal) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("count", [1, 2])
def test_few_lobes_all_around_are_sg(count: int) -> None:
    even = torch.tensor([0.5, 0.4, 0.3]).expand(ROWS, 2 * ROWS, 3)
    chosen = fit_frame(even, FitOptions(count, form=None), None).lobes
    assert chosen.form is Form.SG
    for normal in ([0.0, 1.0, 0.0], [0.6, 0.0, -0.8]):
        expected = math.pi * even[0, 0].double().numpy()
        assert irradiance(chosen, normal) == pytest.approx(expected, rel=2e-3)


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


@pytest.mark.parametrize(
    ("form", "count", "reference"),
    [
        (Form.FLAT, 4, 0.05 + boxes(64)),
        (Form.SG, 2, lamp_in_a_room(64)),
        (Form.SG, 1, lamp_in_a_room(64)),
    ],
)
def test_next_frames_keep_the_form(form: Form, count: int, reference: torch.Tensor) -> None:
    one_start = replace(FAST, spreads_deg=FAST.spreads_deg[:1])
    first = canonical(fit_first_frame(reference, count, form, one_start).lobes)
    before = frame_errors(first, reference).values
    for preset in (Preset.LIVE, Preset.FAST):
        following = fit_frame(1.1 * reference, FitOptions(count, preset, form=None), first)
        assert following.lobes.form is form
        # the same map, a tenth brighter: as good a fit, but for what the temporal term holds back
        errors = frame_errors(following.lobes, 1.1 * reference).values
        for metric in ("env", "irr", "r0.5", "r0.25"):
            assert errors[metric] < 1.1 * before[metric]


def test_a_black_frame_is_no_reason_for_another_form() -> None:
    black = torch.zeros(16, 32, 3)
    assert fit_first_frame(black, 3, None).lobes.form is Form.ASG
    assert dark_lobes(3, Form.FLAT, black).form is Form.FLAT


@pytest.mark.parametrize(("value", "gained"), [(0.9, True), (0.98, False), (1.1, False)])
def test_a_gain_is_a_share_of_the_loss(value: float, gained: bool) -> None:
    lobes = dark_lobes(1, Form.ASG, torch.zeros(16, 32, 3))[None]
    one, other = (
        newton.Outcome(lobes, torch.tensor([j]), torch.tensor([1.0])) for j in (value, 1.0)
    )
    assert other_forms.gains(one, other) == gained


def test_the_lowest_loss_of_several_forms_is_kept_if_it_gains() -> None:
    black = dark_lobes(1, Form.ASG, torch.zeros(16, 32, 3))[None]

    def ending_at(j: float) -> Measured:
        found = newton.Outcome(black, torch.tensor([j]), torch.tensor([1.0]))
        nothing = torch.empty(0)
        return Measured(found, Images(black, nothing, nothing, nothing), nothing)

    plain, little, more, most = (ending_at(j) for j in (1.0, 0.98, 0.9, 0.5))
    assert other_forms.best_of(plain, []) is plain
    assert other_forms.best_of(plain, [little]) is plain
    assert other_forms.best_of(plain, [most, more]) is most
    assert other_forms.best_of(plain, [little, most]) is most


def test_names_of_forms_are_the_forms_and_the_choice() -> None:
    assert FORM_NAMES == (AUTO, "asg", "bingham", "sg", "flat")
    assert [form_of(name) for name in FORM_NAMES] == [None, *Form]
