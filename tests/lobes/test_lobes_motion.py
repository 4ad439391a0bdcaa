# SPDX-License-Identifier: Apache-2.0
"""Lobes between frames, against scipy's rotations, its quadrature and closed forms."""

import math

import numpy as np
import pytest
import scipy.integrate
import torch
from lobe_samples import FORMS, double, lobes_of, random_axes, random_lobes
from scipy.spatial.transform import Rotation, Slerp

from asglight.lobes import Form, Lobes, LobeTracks, asg, motion
from asglight.lobes.data import stack

EXACT = 1e-12
"""Relative, of a few float64 operations."""


def tracks_of(frames: list[Lobes], numbers: tuple[int, ...]) -> LobeTracks:
    return LobeTracks(numbers, 24.0, stack(frames))


def round_flux(sharpness: float) -> float:
    """Return the integral of exp(-s sin^2 t) cos t over the hemisphere, by scipy."""
    return scipy.integrate.quad(
        lambda z: 2 * math.pi * z * math.exp(-sharpness * (1 - z * z)), 0, 1, epsrel=1e-13
    )[0]


def round_lobe(axes: torch.Tensor, sharpness: float, amplitude: tuple[float, ...]) -> Lobes:
    return lobes_of(axes, [sharpness, sharpness], Form.ASG, amplitude)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.9])
def test_flux_is_linear_and_the_logarithm_of_sharpness_too(part: float) -> None:
    axes = random_axes(1)
    first = round_lobe(axes, 3.0, (1.0, 2.0, 0.0))
    last = round_lobe(axes, 300.0, (40.0, 0.0, 5.0))
    found = motion.at(tracks_of([first, last], (10, 11)), [10 + part])
    sharpness = 3.0 ** (1 - part) * 300.0**part
    np.testing.assert_allclose(found.sharpness[0, 0], [sharpness] * 2, rtol=EXACT)
    flux = (1 - part) * round_flux(3.0) * np.array([1.0, 2, 0]) + part * round_flux(
        300.0
    ) * np.array([40.0, 0, 5])
    np.testing.assert_allclose(found.amplitude[0, 0], flux / round_flux(sharpness), rtol=1e-11)


@pytest.mark.parametrize("form", FORMS)
def test_directions_go_evenly_along_the_great_circle_whatever_the_frame_does(form: Form) -> None:
    count = 20
    start = Rotation.from_matrix(random_axes(count, seed=3).mT.numpy())
    # below 45 degrees the nearest of the equal frames is the frame itself
    turn = Rotation.from_rotvec(np.random.default_rng(4).uniform(-0.4, 0.4, (count, 3)))
    shots = [
        lobes_of(double(np.swapaxes(one.as_matrix(), 1, 2)), [30.0, 4.0], form)
        for one in (start, turn * start)
    ]
    found = motion.at(tracks_of(shots, (5, 8)), [6.0])
    for index in range(count):
        ends = [one[index].apply([0, 0, 1]) for one in (start, turn * start)]
        angle = math.acos(float(np.dot(*ends)))
        along = math.sin(angle * 2 / 3) * ends[0] + math.sin(angle / 3) * ends[1]
        np.testing.assert_allclose(found.axis_z[0, index], along / math.sin(angle), atol=EXACT * 10)


def test_a_nearly_round_lobe_that_turns_about_itself_goes_straight() -> None:
    """Slerp leaves the great circle by more than a degree."""
    start = Rotation.from_rotvec([0.3, -0.2, 0.1])
    end = Rotation.from_rotvec([0, math.radians(20), 0]) * start
    spun = end * Rotation.from_rotvec([0, 0, math.radians(44)])
    shots = [
        lobes_of(double(one.as_matrix().T)[None], [10.1, 10.0], Form.ASG) for one in (start, spun)
    ]
    found = motion.at(tracks_of(shots, (1, 2)), [1.5]).axis_z[0, 0]
    ends = [one.apply([0, 0, 1]) for one in (start, end)]
    middle = (ends[0] + ends[1]) / np.linalg.norm(ends[0] + ends[1])
    np.testing.assert_allclose(found, middle, atol=EXACT)
    slerp = Slerp([0, 1], Rotation.concatenate([start, spun]))([0.5])[0].apply([0, 0, 1])
    assert math.degrees(math.acos(float(np.dot(slerp, middle)))) > 1.5


def test_a_frame_that_was_swapped_for_an_equal_one_does_not_turn() -> None:
    lobes = lobes_of(random_axes(6), [50.0, 5.0], Form.ASG)
    axis_x, axis_y, axis_z = lobes.axes.unbind(-2)
    swapped = Lobes(
        torch.stack([axis_y, -axis_x, axis_z], dim=-2), lobes.sharpness.flip(-1), lobes.amplitude
    )
    found = motion.at(tracks_of([lobes, swapped], (1, 2)), [1.5])
    np.testing.assert_allclose(found.axes[0], lobes.axes, atol=EXACT)
    np.testing.assert_allclose(found.sharpness[0], lobes.sharpness, rtol=EXACT)


def tipped(lobes: Lobes, degrees: float) -> torch.Tensor:
    """Return the axes of lobes that turn about their own axis_x."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = torch.tensor([[1, 0, 0], [0, cos, sin], [0, -sin, cos]], dtype=torch.float64)
    return turn @ lobes.axes


@pytest.mark.parametrize("is_last", [False, True], ids=["appears", "vanishes"])
def test_a_lobe_that_is_black_in_one_frame_fades_with_its_width_while_it_turns(
    is_last: bool,
) -> None:
    lit = random_lobes(3, Form.ASG, seed=1)
    away = tipped(lit, 20.0)
    black = Lobes(away, 7 * lit.sharpness, torch.zeros_like(lit.amplitude))
    frames = [lit, black] if is_last else [black, lit]
    tracks = tracks_of(frames, (1, 2))
    found = motion.at(tracks, [1.25])
    part = 0.25 if is_last else 0.75
    wanted = tipped(lit, 20.0 * part)[:, 2]
    np.testing.assert_allclose(found.axis_z[0], wanted, atol=EXACT)
    np.testing.assert_allclose(
        found.sharpness[0].sort(-1).values, lit.sharpness.sort(-1).values, rtol=EXACT
    )
    np.testing.assert_allclose(found.amplitude[0], (1 - part) * lit.amplitude, rtol=EXACT)
    at_black = motion.at(tracks, [2.0 if is_last else 1.0])
    np.testing.assert_allclose(at_black.axis_z[0], away[:, 2], atol=EXACT)
    assert not at_black.amplitude.any()


def test_two_black_frames_stay_black() -> None:
    black = [random_lobes(2, Form.ASG, seed=seed) for seed in (1, 2)]
    for lobes in black:
        lobes.amplitude[:] = 0
    found = motion.at(tracks_of(black, (1, 2)), [1.5])
    assert not found.amplitude.any()
    assert torch.isfinite(found.axes).all()


def test_frames_further_apart_are_interpolated_by_their_numbers() -> None:
    lobes = [random_lobes(2, Form.ASG, seed=7) for _ in range(3)]
    for index, scale in enumerate([1.0, 3.0, 4.0]):
        lobes[index].amplitude.mul_(scale)
    found = motion.at(tracks_of(lobes, (1, 5, 6)), [2.0, 4.5, 5.5]).amplitude
    wanted = torch.stack([lobes[0].amplitude * scale for scale in (1.5, 2.75, 3.5)])
    np.testing.assert_allclose(found, wanted, rtol=EXACT)


def test_at_a_frame_lobes_are_its_own_and_beyond_the_ends_those_of_the_ends() -> None:
    lobes = [random_lobes(4, Form.ASG, seed=seed) for seed in range(3)]
    found = motion.at(tracks_of(lobes, (1, 2, 3)), [0.0, 1.0, 2.0, 3.0, 9.5])
    for place, index in enumerate([0, 0, 1, 2, 2]):
        np.testing.assert_array_equal(found.amplitude[place], lobes[index].amplitude)
        np.testing.assert_allclose(found.axis_z[place], lobes[index].axis_z, atol=EXACT)


def test_a_still_is_the_same_at_all_times() -> None:
    still = random_lobes(2, Form.BINGHAM)
    found = motion.at(tracks_of([still], (7,)), [6.0, 7.0, 7.5])
    np.testing.assert_array_equal(found.amplitude, still.amplitude.expand(3, 2, 3))


def test_float32_tracks_are_evaluated_in_float64() -> None:
    lobes = [random_lobes(5, Form.ASG, seed=seed) for seed in (1, 2)]
    single = motion.at(tracks_of([one.to(torch.float32) for one in lobes], (1, 2)), [1.5])
    assert single.amplitude.dtype == torch.float64
    gram = single.axes @ single.axes.mT
    np.testing.assert_allclose(gram, torch.eye(3).double().expand_as(gram), atol=1e-14)


def test_black_frames_have_the_width_of_the_light_beside_them() -> None:
    lit = torch.tensor([0, 0, 1, 0, 0, 0, 1, 0], dtype=torch.bool)[:, None]
    wanted = [2, 2, 2, 2, 6, 6, 6, 6]
    assert motion.light_of(~lit)[:, 0].tolist() == wanted
    assert motion.light_of(torch.ones(3, 1, dtype=torch.bool))[:, 0].tolist() == [0, 1, 2]
    lobes = stack([random_lobes(1, Form.ASG, seed=seed) for seed in range(8)])
    lobes.amplitude[~lit] = 0
    found = motion.resting(lobes)
    assert torch.equal(found.sharpness, lobes.sharpness[wanted])
    assert torch.equal(found.axes, lobes.axes)
    assert torch.equal(found.amplitude, lobes.amplitude)
    for values, own in zip(motion.resting_moments(lobes), asg.moments(lobes), strict=True):
        assert torch.equal(values, own[wanted])
