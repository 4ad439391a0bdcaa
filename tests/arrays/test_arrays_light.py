# SPDX-License-Identifier: Apache-2.0
"""The light of tracks at any time, against numpy's formulas, quadrature and brute force."""

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from lobe_samples import FORMS
from usd_tracks import moving

import asglight
from asglight.arrays.light import _albedo
from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg, motion
from asglight.shading import ggx
from asglight.shading.balls import coverage, render_balls
from asglight.sphere import latlong

SHOT = moving(range(1001, 1005))


def directions(count: int = 40) -> np.ndarray:
    found = np.random.default_rng(2).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def by_formula(lobes: Lobes, towards: np.ndarray) -> np.ndarray:
    """Return what the lobes send, by the formulas of docs/conventions.md.  [P, 3]."""
    axes, sharpness, amplitude = (
        one.double().numpy() for one in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )
    x, y, z = np.moveaxis(np.einsum("nij,pj->pni", axes, towards), -1, 0)
    gaussian = np.exp(-sharpness[:, 0] * x * x - sharpness[:, 1] * y * y)
    front = np.maximum(z, 0)
    value = {
        Form.ASG: front * gaussian,
        Form.BINGHAM: gaussian,
        Form.SG: np.exp(sharpness[:, 0] * (z - 1)),
        Form.FLAT: front * (1 - (1 - gaussian) ** 3),
    }[lobes.form]
    return value @ amplitude


@pytest.mark.parametrize("form", FORMS)
def test_radiance_is_the_formula_at_the_time(form: Form) -> None:
    shot = moving(range(1001, 1005), form=form)
    towards = directions()
    for time in (1001, 1002.25, 1004, 1010.0):
        (lobes,) = (motion.at(shot, [time])[place] for place in (0,))
        found = asglight.radiance(shot, towards, time)
        np.testing.assert_allclose(found, by_formula(lobes, towards), rtol=1e-10, atol=1e-14)


def test_a_light_between_two_frames_has_the_mean_of_their_fluxes() -> None:
    """Of lobes that keep their shape the radiance itself is linear."""
    lobes = replace(SHOT.lobes, axes=SHOT.lobes.axes[:1].expand(4, -1, -1, -1))
    lobes = replace(lobes, sharpness=SHOT.lobes.sharpness[:1].expand(4, -1, -1))
    shot = replace(SHOT, lobes=lobes)
    towards = directions()
    first, middle, last = asglight.radiance(shot, towards, [1002, 1002.5, 1003])
    np.testing.assert_allclose(middle, (first + last) / 2, rtol=1e-6)  # axes are float32


def test_directions_may_have_any_shape_and_length_and_times_come_first() -> None:
    towards = torch.from_numpy(directions(6)).reshape(2, 3, 3)
    found = asglight.radiance(SHOT, 5 * towards, [1001.0, 1003.5])
    assert found.shape == (2, 2, 3, 3)
    np.testing.assert_allclose(found[1], asglight.radiance(SHOT, towards, 1003.5), rtol=1e-12)
    one = asglight.irradiance(SHOT, [0.0, 2.0, 0.0], 1003.5)
    assert one.shape == (3,)
    every = asglight.irradiance(SHOT, np.array([[0, 1.0, 0]]), 1003.5)
    np.testing.assert_allclose(every[0], one, rtol=1e-12)


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e-13, 1e13, 1e300])
@pytest.mark.parametrize("exact", [True, False])
def test_a_direction_has_the_same_light_at_any_length(length: float, exact: bool) -> None:
    light = SHOT if exact else SHOT.at(1003)  # in float64, in float32
    time = 1003 if exact else None
    wanted = asglight.radiance(light, [[1.0, 0.0, -1.0]], time)
    found = asglight.radiance(light, [[length, 0.0, -length]], time)
    torch.testing.assert_close(found, wanted, rtol=1e-5, atol=0)


def test_directions_may_be_an_array_of_any_layout() -> None:
    towards = directions(6)
    wanted = asglight.irradiance(SHOT, towards, 1003)
    fixed = towards.copy()
    fixed.flags.writeable = False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for same in (towards.astype(">f8"), towards[::-1].copy()[::-1], fixed, [*towards]):
            assert torch.equal(asglight.irradiance(SHOT, same, 1003), wanted)


@pytest.mark.parametrize("form", FORMS)
def test_irradiance_is_the_integral_over_the_hemisphere(form: Form) -> None:
    shot = moving(range(1001, 1005), form=form)
    normals = directions(12)
    height = 256
    towards = latlong.directions(height, 2 * height, dtype=torch.float64).reshape(-1, 3).numpy()
    area = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64).reshape(-1).numpy()
    light = by_formula(motion.at(shot, [1002.5])[0], towards) * area[:, None]
    wanted = np.maximum(normals @ towards.T, 0) @ light
    found = asglight.irradiance(shot, normals, 1002.5).numpy()
    # docs/method/shading.md: the closed form is a few percent of the brightest off where lobes are
    # cut
    assert np.abs(found - wanted).max() < 0.03 * wanted.max()
    assert np.abs(found - wanted).mean() < 0.01 * wanted.mean()


@pytest.mark.parametrize("height", [5, 32, 100])
def test_a_latlong_of_any_height_has_the_flux_of_the_lobes(height: int) -> None:
    found = asglight.latlong(SHOT, height, 1002.5)
    assert found.shape == (height, 2 * height, 3)
    area = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64)
    flux = (found * area[..., None]).sum((0, 1))
    wanted = asg.flux(motion.at(SHOT, [1002.5])[0]).sum(0)
    # a coarse grid's broad lobes are taken at the middle of their texels
    np.testing.assert_allclose(flux, wanted, rtol=0.03 if height == 5 else 3e-3)


def test_balls_are_those_of_brute_force() -> None:
    size = 64
    found = asglight.balls(SHOT, 1002.5, roughness=(0.25, 1.0, None), size=size)
    assert found.shape == (3, size, size, 3)
    wide = asglight.latlong(SHOT, 128, 1002.5).float()
    (wanted,) = render_balls(wide[None], (0.25, 1.0), size=size)
    inside = coverage(size) > 0.99
    for ball, truth in zip(found, wanted, strict=False):
        error = (ball - truth)[inside].square().mean().sqrt() / truth[inside].square().mean().sqrt()
        assert float(error) < 0.05  # docs/method/shading.md: a few percent
    assert not bool(found[:, coverage(size) == 0].any())
    middle = found[2, size // 2 - 1 : size // 2 + 1, size // 2 - 1 : size // 2 + 1].mean((0, 1))
    facing = asglight.irradiance(SHOT, [0.0, 0.0, 1.0], 1002.5)
    np.testing.assert_allclose(middle, facing / math.pi, rtol=5e-3)  # of the four middle pixels


@pytest.mark.parametrize("roughness", [0.05, 0.5, 1.0])
def test_the_albedo_between_its_nodes_is_that_of_the_quadrature(roughness: float) -> None:
    cos_view = torch.linspace(0.06, 1, 50, dtype=torch.float64)
    wanted = ggx.albedo_parts(cos_view, roughness**2)
    assert float((_albedo(cos_view, roughness) - wanted).abs().max()) < 5e-4


def test_lobes_themselves_need_no_time() -> None:
    lobes = SHOT.at(1003)
    towards = directions()
    found = asglight.radiance(lobes, towards)
    assert found.dtype == torch.float32
    np.testing.assert_allclose(found, asglight.radiance(SHOT, towards, 1003), rtol=1e-3, atol=1e-5)
    assert asglight.balls(lobes, size=8).shape == (6, 8, 8, 3)
    still = LobeTracks((7,), 24.0, SHOT.lobes[:1])
    np.testing.assert_allclose(
        asglight.latlong(still, 8), asglight.latlong(SHOT.at(1001), 8), rtol=1e-3
    )


def gradients(function, form: Form = Form.ASG, lobes: int = 2) -> bool:
    """Tell whether torch's slopes are those of finite differences, at a time between frames."""
    shot = moving(range(1001, 1003), lobes=lobes, form=form)
    sharpness = shot.lobes.sharpness.double().log().requires_grad_()
    amplitude = shot.lobes.amplitude.double().requires_grad_()
    turn = torch.zeros(2, lobes, 3, dtype=torch.float64, requires_grad=True)

    def of(sharpness, amplitude, turn):
        x, y, z = turn.unbind(-1)
        spin = torch.stack(
            [
                torch.stack([torch.zeros_like(x), -z, y], -1),
                torch.stack([z, torch.zeros_like(x), -x], -1),
                torch.stack([-y, x, torch.zeros_like(x)], -1),
            ],
            -2,
        )
        axes = motion.exact(shot.lobes).axes @ torch.linalg.matrix_exp(spin)
        lobes = Lobes(axes, sharpness.exp(), amplitude, form)
        return function(LobeTracks(shot.frames, 24.0, lobes))

    return torch.autograd.gradcheck(
        of, (sharpness, amplitude, turn), eps=1e-6, atol=1e-5, rtol=1e-3
    )


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_radiance_and_irradiance_are_differentiable(form: Form) -> None:
    towards = torch.from_numpy(directions(3))
    assert gradients(lambda shot: asglight.radiance(shot, towards, 1001.25), form)
    assert gradients(lambda shot: asglight.irradiance(shot, towards, 1001.25), form)


def test_maps_and_balls_are_differentiable() -> None:
    assert gradients(lambda shot: asglight.latlong(shot, 2, 1001.5), lobes=1)
    balls = {"roughness": (0.5, None), "size": 2}
    assert gradients(lambda shot: asglight.balls(shot, 1001.5, **balls))


def test_radiance_is_differentiable_to_the_directions() -> None:
    towards = torch.from_numpy(directions(3)).requires_grad_()
    assert torch.autograd.gradcheck(lambda one: asglight.radiance(SHOT, one, 1001.5), towards)
    assert torch.autograd.gradcheck(lambda one: asglight.irradiance(SHOT, one, 1001.5), towards)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda: asglight.radiance(SHOT, [[0.0, 1.0]], 1001), r"directions: shape \[1, 2\]"),
        (
            lambda: asglight.radiance(SHOT, [[0, 1, 0]], 1001),
            "of int64; expected .* floating",
        ),
        (lambda: asglight.latlong(SHOT, 4, "1001"), "time: 1001; expected numbers"),
        (
            lambda: asglight.latlong(SHOT, 4, np.ones((2, 2))),
            r"time: \[\[1.0, 1.0\], .* expected num",
        ),
        (lambda: asglight.latlong(SHOT, 4, 10**400), "time: 10+; expected numbers"),
        (lambda: asglight.balls(SHOT, 1001, roughness=()), "roughness: none; expected one or more"),
        (lambda: asglight.irradiance(SHOT, [0.0, 0.0, 0.0], 1001), "directions: one is of length"),
        (lambda: asglight.irradiance(SHOT, [0.0, math.inf, 0.0], 1001), "directions: one is of le"),
        (lambda: asglight.radiance(SHOT, [0.0, math.nan, 1.0], 1001), "directions: one is of len"),
        (
            lambda: asglight.radiance(SHOT, [[0.0, 1.0], [1.0]], 1001),
            r"directions: no array \(sett",
        ),
        (
            lambda: asglight.radiance(SHOT, None, 1001),
            r"directions: shape \[\] of object; expected",
        ),
        (lambda: asglight.radiance(SHOT, [0.0, 1.0, float("nan")], 1001), "one is of length 0, or"),
        (lambda: asglight.latlong(SHOT, 8), "time: none; expected one, in the frame numbers 1001 "),
        (lambda: asglight.latlong(SHOT, 8, float("nan")), "time: nan; expected numbers"),
        (lambda: asglight.latlong(SHOT, 8, []), r"time: \[\]; expected numbers"),
        (lambda: asglight.latlong(SHOT, 0, 1001), "height: 0 rows; expected 1 or more"),
        (
            lambda: asglight.latlong(SHOT, 10**12, 1001),
            "height: 1000000000000 rows; .* at most 16384",
        ),
        (lambda: asglight.balls(SHOT, 1001, size=10**12), "size: 1000000000000; .* at most 16384"),
        (lambda: asglight.latlong(SHOT.lobes, 8), r"time: None of lobes of shape \[4\.*"),
        (lambda: asglight.latlong(SHOT.at(1001), 8, 1001), "time: 1001 of lobes of shape"),
        (lambda: asglight.balls(SHOT, 1001, size=0), "size: 0; expected 1 pixel or more"),
        (lambda: asglight.balls(SHOT, 1001, roughness=[0.01]), "roughness: 0.01; expected 0.05"),
        (lambda: asglight.plot(SHOT, [1001, 1002]), r"time: \[1001, 1002\]; expected one time"),
    ],
)
def test_what_cannot_be_answered_is_one_line(ask, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ask()


@pytest.mark.parametrize("kind", [np.array, torch.tensor])
def test_times_may_be_an_array(kind: type) -> None:
    tracks = moving([1, 2, 3])
    wanted = asglight.latlong(tracks, 4, [1.0, 2.5])
    assert torch.equal(asglight.latlong(tracks, 4, kind([1.0, 2.5])), wanted)
    assert torch.equal(asglight.latlong(tracks, 4, kind(2.5)), wanted[1])


@pytest.mark.parametrize("function", [asglight.radiance, asglight.irradiance])
def test_directions_and_times_that_are_masked_or_sparse_are_refused(
    function: Callable[..., torch.Tensor],
) -> None:
    up = torch.tensor([0.0, 1.0, 0.0])
    masked = np.ma.masked_array([0.0, 1.0, 0.0], [0, 1, 0])
    for given, found in ((masked, "1 values are masked"), (up.to_sparse(), "a sparse tensor")):
        with pytest.raises(InputError, match=f"^directions: {found}; expected"):
            function(SHOT, given, 1001)
    times = torch.tensor([1001.0, 1002.0]).to_sparse()
    with pytest.raises(InputError, match=r"^time: a sparse tensor; expected"):
        function(SHOT, up, times)


@pytest.mark.parametrize("value", [2.5, 4.0, True, "4", None, math.nan])
def test_a_size_that_is_no_whole_number_is_refused(value: Any) -> None:
    with pytest.raises(InputError, match=r"^height: .*; expected a whole number"):
        asglight.latlong(SHOT, value, 1001)
    with pytest.raises(InputError, match=r"^size: .*; expected a whole number"):
        asglight.balls(SHOT, 1001, size=value)


@pytest.mark.parametrize("value", [0.5, "a", None, ["a"], [True], [0.5 + 0j]])
def test_a_roughness_that_is_no_number_is_refused(value: Any) -> None:
    with pytest.raises(InputError, match=r"^roughness: .*; expected"):
        asglight.balls(SHOT, 1001, roughness=value)


@pytest.mark.parametrize("value", [True, ["1001"], [True], np.array(["1001"]), torch.tensor(True)])
def test_a_time_that_is_no_number_is_refused(value: Any) -> None:
    with pytest.raises(InputError, match=r"^time: .*; expected numbers"):
        asglight.latlong(SHOT, 4, value)


@pytest.mark.parametrize("light", [None, "day.usda", np.zeros((4, 8, 3))])
def test_what_is_no_light_is_refused(light: Any) -> None:
    with pytest.raises(InputError, match=r"^light: of type \w+; expected tracks, or lobes\."):
        asglight.latlong(light, 4)
