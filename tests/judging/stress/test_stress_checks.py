# SPDX-License-Identifier: Apache-2.0
"""Every check of the stress table passes what is right and finds what is wrong, by how much."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from asglight.judging.stress import checks
from asglight.judging.stress.maps import constant, lobe, render, together, toward
from asglight.lobes import Form, Lobes, LobeTracks
from asglight.usd.read.tracks import Reading

LAMPS = together(
    lobe(toward(30, 20), (40.0, 10.0), (3.0, 2.0, 1.0)), lobe(toward(-100, -40), 200.0, 5.0)
)


def brighter(lobes: Lobes, factor: float) -> Lobes:
    return replace(lobes, amplitude=lobes.amplitude * factor)


def tracks_of(lobes: Lobes) -> LobeTracks:
    return LobeTracks((1,), 24.0, lobes.to(torch.float32)[None])


class PlainShader:
    """The lobe function in numpy, off by a factor; balls of the library, off by the same."""

    name = "numpy"
    lobes_max = 128

    def __init__(self, factor: float = 1.0) -> None:
        self.factor = factor

    def radiance(self, lobes: Lobes, directions: Tensor) -> Tensor:
        axes, sharpness = lobes.axes.double().numpy(), lobes.sharpness.double().numpy()
        x, y, z = np.einsum("nij,pj->inp", axes, directions.double().numpy())
        unit = np.exp(-sharpness[:, :1] * x**2 - sharpness[:, 1:] * y**2) * np.maximum(z, 0)
        found = unit.T @ lobes.amplitude.double().numpy()
        return torch.from_numpy(self.factor * found).float()

    def ball(self, lobes: Lobes, roughness: float | None, size: int) -> Tensor:
        normals, inside = checks.ball_normals(size)
        if roughness is None:
            made = checks.rectified.irradiance_over_pi(checks.sheets(lobes), normals)
            values = torch.einsum("mp,mc->pc", made, lobes.amplitude)
        else:
            white = torch.ones(3, dtype=torch.float64)
            values = checks.ggx_lobes.radiance(lobes, normals, checks.VIEW, roughness, white)
        picture = torch.zeros(size, size, 3, dtype=torch.float64)
        picture[inside] = self.factor * values
        return picture


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1.0])
@pytest.mark.parametrize("name", ["sharpness", "amplitude"])
def test_numbers_that_no_lobe_may_have_are_counted(name: str, wrong: float) -> None:
    assert checks.not_finite(LAMPS) == 0
    values = getattr(LAMPS, name).clone()
    values[1, 0] = wrong
    assert checks.not_finite(replace(LAMPS, **{name: values})) > 0


@pytest.mark.parametrize("factor", [1.0, 1.02, 0.5])
def test_flux_and_irradiance_of_a_fit_with_too_much_light_are_off_by_that(factor: float) -> None:
    radiance = render(LAMPS, 64)
    found = brighter(LAMPS, factor)
    # texels of float32, sampled at centres: 64 rows hold the flux of such lobes to 1e-4
    assert checks.flux_error(found, radiance) == pytest.approx(abs(factor - 1), abs=2e-4)
    assert checks.irradiance_error(found, radiance) == pytest.approx(abs(factor - 1), abs=2e-4)


def test_light_in_the_wrong_place_has_its_flux_and_no_irradiance() -> None:
    radiance = render(lobe(toward(0, 0), 200.0), 64)
    behind = lobe(toward(180, 0), 200.0)
    assert checks.flux_error(behind, radiance) < 2e-4
    # all that is lacking, and all that is too much; beside the lamps' horizons a little of both
    assert checks.irradiance_error(behind, radiance) == pytest.approx(2, rel=0.02)


def test_what_is_no_number_passes_no_bound() -> None:
    broken = brighter(LAMPS, math.nan)
    assert checks.flux_error(broken, render(LAMPS, 16)) == math.inf
    assert checks.irradiance_error(broken, render(LAMPS, 16)) == math.inf
    assert checks.largest(torch.tensor([1.0, math.nan])) == math.inf


def test_a_black_map_forgives_only_black_lobes() -> None:
    assert checks.flux_error(brighter(LAMPS, 0.0), constant(0.0, 16)) == 0
    assert checks.flux_error(LAMPS, constant(0.0, 16)) == math.inf


def test_a_stage_gives_back_its_lobes_to_float32() -> None:
    assert checks.stage_error(tracks_of(LAMPS)) < 5e-7


def test_a_stage_that_reads_otherwise_is_off_by_that(monkeypatch: pytest.MonkeyPatch) -> None:
    tracks = tracks_of(LAMPS)

    def reads(lobes: Lobes, *changes: str, names: tuple[str, ...] = ()) -> float:
        held = replace(tracks, lobes=lobes[None], names=names)
        reading = Reading(held, changes, (), held, frozenset())
        monkeypatch.setattr(checks, "read_stage", lambda path: reading)
        return checks.stage_error(tracks)

    same = LAMPS.to(torch.float32)
    assert reads(brighter(same, 1.03)) == pytest.approx(0.03, rel=1e-4)
    assert reads(replace(same, sharpness=same.sharpness * 0.9)) == pytest.approx(0.1, rel=1e-4)
    turned = replace(same, axes=torch.stack([same.axes[0], lobe(toward(-101, -40), 1.0).axes[0]]))
    assert reads(turned.to(torch.float32)) > 0.01
    assert reads(same, "/AsgRig/Lobes/lobe_00: switched off") == math.inf
    assert reads(same, names=("a", "b")) == math.inf
    assert reads(same.select(torch.tensor([0]))) == math.inf


@pytest.mark.parametrize("factor", [1.0, 1.02])
def test_a_shader_that_is_too_bright_is_off_by_that(factor: float) -> None:
    shader = PlainShader(factor)
    # float32 of lobes and values
    assert checks.shader_error(shader, LAMPS) == pytest.approx(factor - 1, abs=1e-5)
    assert checks.balls_error(shader, LAMPS) == pytest.approx(factor - 1, abs=1e-5)


def test_a_shader_without_a_number_passes_no_bound() -> None:
    assert checks.shader_error(PlainShader(math.nan), LAMPS) == math.inf
    assert checks.balls_error(PlainShader(math.nan), LAMPS) == math.inf


def test_numbers_that_a_gpu_takes_as_none_are_no_difference() -> None:
    dim = brighter(LAMPS, 1e-40)
    assert checks.shader_error(PlainShader(0.0), dim) == 0
    assert checks.shader_error(PlainShader(0.0), LAMPS) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("sharpness", [1e-3, 30.0, 1e7])
def test_directions_lie_where_a_lobe_is_bright(sharpness: float) -> None:
    lamp = lobe(toward(50, 10), sharpness)
    directions = checks.directions_around(lamp).double()
    assert float((directions.norm(dim=-1) - 1).abs().max()) < 1e-6
    off = torch.acos((directions @ lamp.axis_z[0]).clamp(-1, 1))
    # with a deviation of 1 / sqrt(2 s), e^-1 of the peak is 1.4 deviations off
    assert int((off < 1.5 / max(1.0, 2 * sharpness) ** 0.5).sum()) >= checks.NEAR / 3


def test_lobes_in_another_order_are_found() -> None:
    found = checks.recovery_errors(LAMPS.select(torch.tensor([1, 0])), LAMPS)
    assert max(found.direction, found.sharpness, found.amplitude) < 1e-12


def test_a_lobe_that_was_missed_is_told_by_how_much() -> None:
    known = lobe(toward(30, 20), (200.0, 50.0), (1.0, 2.0, 4.0))
    moved = lobe(toward(30, 21), (200.0, 50.0), (1.0, 2.0, 4.0))
    found = checks.recovery_errors(moved, known)
    width = (2 * 200.0) ** -0.5
    assert found.direction == pytest.approx(math.radians(1) / width, rel=1e-4)
    other = replace(known, sharpness=known.sharpness * 1.1, amplitude=known.amplitude - 0.2)
    found = checks.recovery_errors(other, known)
    assert found.sharpness == pytest.approx(0.1)
    assert found.amplitude == pytest.approx(0.05)
    assert checks.recovery_errors(known, LAMPS).direction == math.inf  # one of two is missing


def test_a_bingham_lobe_is_the_same_from_behind_and_another_is_not() -> None:
    for form, expected in ((Form.BINGHAM, 0.0), (Form.ASG, 2.0)):
        known = lobe((0.0, 0.0, 1.0), 0.5, form=form)  # a deviation of a radian
        behind = lobe((0.0, 0.0, -1.0), 0.5, form=form)
        found = checks.recovery_errors(behind, known)
        assert found.direction == pytest.approx(expected, abs=1e-12)
