# SPDX-License-Identifier: Apache-2.0
"""A camera that turns: one rotation for all lobes, and what a lamp that moves by itself does."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import lamps, target
from scipy.spatial.transform import Rotation
from torch import Tensor

from asglight.fitting.first_frame.fit import exposed, narrowest
from asglight.fitting.following import camera, initial_guess, pull_in, whole_shot
from asglight.fitting.loss import lobe_images, objective
from asglight.lobes import Lobes, texels
from asglight.lobes.data import stack

HEIGHT = 64
PLACES = ((0.0, 20.0), (70.0, -10.0), (150.0, 35.0), (-60.0, 5.0), (-130.0, -30.0))
"""Longitude and latitude of five lamps, in degrees."""


def _scene(moved: float = 0.0) -> Lobes:
    """Return five lamps of 5 by 11 degrees, the first moved along the horizon by degrees."""
    places = [(PLACES[0][0] + moved, PLACES[0][1]), *PLACES[1:]]
    directions = []
    for longitude, latitude in ((math.radians(one), math.radians(other)) for one, other in places):
        across = math.cos(latitude)
        directions.append(
            (across * math.sin(longitude), math.sin(latitude), across * math.cos(longitude))
        )
    found = lamps(directions, [60.0] * len(places), [1.0] * len(places))
    sharpness = found.sharpness * torch.tensor([1.0, 0.2], dtype=found.sharpness.dtype)
    return replace(found, sharpness=sharpness).to(torch.float32)


def _turned(lobes: Lobes, rotation: Rotation) -> Lobes:
    matrix = torch.from_numpy(rotation.as_matrix())
    return replace(lobes, axes=(lobes.axes.double() @ matrix.T).to(lobes.axes))


def _frame(scene: Lobes) -> objective.Target:
    means = texels.texel_means(scene, HEIGHT, 2 * HEIGHT).float()
    return target(means.flatten(0, 1).mT[None].contiguous())


def _together(lobes: Lobes, frame: objective.Target) -> Lobes:
    shown = lobe_images.images(lobes[None], frame.places)
    seen = pull_in.seen(lobes[None], pull_in.responsibilities(shown), frame)
    return camera.turned_with_it(lobes[None], *seen)[0]


def _angles(first: Tensor, second: Tensor) -> Tensor:
    """Return the angles between directions in degrees: 1e-3 apart are told in float32."""
    return 2 * torch.rad2deg(torch.asin(((first - second).norm(dim=-1) / 2).clamp(max=1)))


@pytest.mark.parametrize("degrees", [0.5, 3.0, 8.0])
def test_a_camera_that_turns_takes_all_lobes_along(degrees: float) -> None:
    lobes = _scene()
    turn = Rotation.from_rotvec([0.3, 0.9, -0.3], degrees=False)
    turn = Rotation.from_rotvec(turn.as_rotvec() / turn.magnitude() * math.radians(degrees))
    frame = _frame(_turned(lobes, turn))
    guess, _ = initial_guess.initial_guess(lobes, None, frame, narrowest(HEIGHT))
    wanted = _turned(lobes, turn).axes
    assert float(_angles(guess.lobes[0].axes, wanted).max()) < 0.03 * degrees
    assert torch.equal(guess.lobes[0].sharpness, lobes.sharpness)


def test_the_rotation_is_that_of_scipy() -> None:
    lobes = _scene()
    frame = _frame(_turned(lobes, Rotation.from_euler("yxz", [4, -3, 2], degrees=True)))
    shown = lobe_images.images(lobes[None], frame.places)
    seen, flux = pull_in.seen(lobes[None], pull_in.responsibilities(shown), frame)
    variance = (1 / (2 * lobes.sharpness.double())).mean(-1)  # exp(-s x^2) is exp(-x^2 / (2 v))
    weights = flux[0].double() / (variance + pull_in.REACH**2)
    turn, _ = Rotation.align_vectors(
        seen[0].double().numpy(), lobes.axis_z.double().numpy(), weights=weights.numpy()
    )
    found = camera.turned_with_it(lobes[None], seen, flux)[0]
    torch.testing.assert_close(found.axes, _turned(lobes, turn).axes, rtol=0, atol=1e-5)


@pytest.mark.parametrize("which", range(5))
def test_one_lobe_turns_as_little_as_it_can(which: int) -> None:
    lobe = _scene()[which : which + 1]
    frame = _frame(_turned(lobe, Rotation.from_rotvec([math.radians(4), math.radians(3), 0.0])))
    found = _together(lobe, frame)
    before, seen = lobe.axis_z[0].double(), found.axis_z[0].double()
    across = torch.linalg.cross(before, seen)
    angle = torch.asin(across.norm())
    assert float(torch.rad2deg(angle)) > 1
    least = Rotation.from_rotvec((across / across.norm() * angle).numpy())
    torch.testing.assert_close(found.axes, _turned(lobe, least).axes, rtol=0, atol=1e-4)


def test_they_turn_together_only_if_that_gains_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    lobes = _scene()
    frame = _frame(_turned(lobes, Rotation.from_rotvec([0.0, math.radians(3), 0.0])))
    width_min = narrowest(HEIGHT)
    together, before = initial_guess.initial_guess(lobes, None, frame, width_min)
    monkeypatch.setattr(initial_guess, "TOGETHER_GAIN", 1.0)
    apart, _ = initial_guess.initial_guess(lobes, None, frame, width_min)
    assert torch.equal(together.lobes.sharpness[0], lobes.sharpness)
    assert not torch.equal(apart.lobes.sharpness[0], lobes.sharpness)
    assert float(together.value) < 0.5 * float(apart.value) < 0.5 * before


def test_lobes_stay_where_one_lamp_moves_by_itself() -> None:
    lobes = _scene()
    frame = _frame(_scene(moved=6.0))
    guess, _ = initial_guess.initial_guess(lobes, None, frame, narrowest(HEIGHT))
    assert float(_angles(guess.lobes[0].axis_z[1:], lobes.axis_z[1:]).max()) < 0.3
    assert float(_angles(guess.lobes[0].axis_z[:1], _scene(moved=6.0).axis_z[:1]).max()) < 3


def test_black_lobes_turn_nowhere() -> None:
    lobes = _scene()
    frame = _frame(_scene(moved=6.0))
    black = replace(lobes, amplitude=torch.zeros_like(lobes.amplitude))
    torch.testing.assert_close(_together(black, frame).axes, lobes.axes, rtol=0, atol=1e-6)


def test_refinement_sees_neighbours_through_the_camera_of_the_frame() -> None:
    lobes = _scene()
    away = _turned(lobes, Rotation.from_rotvec([0.0, math.radians(5), 0.0]))
    found = whole_shot._as_seen_from(lobes[None], away[None])[0]
    torch.testing.assert_close(found.axes, lobes.axes, rtol=0, atol=1e-5)
    moved = _scene(moved=6.0)
    found = whole_shot._as_seen_from(lobes[None], moved[None])[0]
    assert torch.equal(found.axes, moved.axes)


def test_a_camera_that_shakes_is_followed_when_refined() -> None:
    lobes = _scene()
    shaken = _turned(lobes, Rotation.from_rotvec([0.0, math.radians(4), 0.0]))
    scenes = [lobes, shaken, lobes]
    maps = [texels.texel_means(each, HEIGHT, 2 * HEIGHT).float() for each in scenes]
    frames = [exposed(each) for each in maps]
    held = whole_shot.Refinement(gamma=1.0, rise=math.inf)  # more than ever, whatever it costs
    refined, _ = whole_shot.refine_shot(stack(scenes), lambda: [frames], held)
    assert float(_angles(refined.axes[1], shaken.axes).max()) < 0.01
