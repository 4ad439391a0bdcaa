# SPDX-License-Identifier: Apache-2.0
"""Rectangles in space and slants: against rays, integrals, and the same card said otherwise."""

import numpy as np
import pytest
import torch
from key_cases import Rectangle, corner_error

from asglight.lobes import Lobes, frames, motion
from asglight.lobes.rectangles import (
    Rectangles,
    mirrored_slant,
    rectangles,
    seen_as,
    slant_of,
    turned_slant,
    turns,
    vectors,
)
from asglight.sphere import latlong

LAMPS = (
    Rectangle(10, 5, 20, 16, 9),
    Rectangle(180, -10, 35, 30, 18, slant=50),
    Rectangle(40, 84, 10, 24, 14, slant=-35, about=60),
    Rectangle(-120, 10, 0, 60, 40, slant=65, about=45),
)
SLANT = (0.1, -0.2, 0.5, -0.4, 0.3, 0.2, -0.1)


def standing(lamp: Rectangle) -> Rectangles:
    return Rectangles(*(torch.from_numpy(one) for one in (lamp.axes[2], lamp.sides, lamp.extent)))


@pytest.mark.parametrize("lamp", LAMPS)
def test_what_is_seen_of_a_rectangle_is_what_rays_meet(lamp: Rectangle) -> None:
    rows = 1024
    directions = latlong.directions(rows, 2 * rows, dtype=torch.float64).numpy()
    solid = latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64).numpy()
    met = lamp.covers(directions)
    seen, weight = directions[met], solid[met]
    found = standing(lamp)
    # some thousands of rays: edges are right to a part of a texel of 0.2 degrees
    assert float(found.solid_angle()) == pytest.approx(weight.sum(), rel=0.01)
    cosine = (seen @ lamp.axes[2] * weight).sum()
    assert float(found.irradiance()) == pytest.approx(cosine, rel=0.01)
    second = np.einsum("p,pi,pj->ij", weight, seen, seen) / weight.sum()
    np.testing.assert_allclose(found.second_moments(), second, atol=2e-3)
    assert corner_error(found.corners().numpy(), lamp.corners()) < 1e-7


@pytest.mark.parametrize("lamp", LAMPS)
def test_the_lobe_of_a_rectangle_points_where_its_light_comes_from(lamp: Rectangle) -> None:
    axes, squares = seen_as(standing(lamp))
    torch.testing.assert_close(axes @ axes.mT, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(axes)) == pytest.approx(1)
    second = axes @ standing(lamp).second_moments() @ axes.mT
    assert second[2, :2].abs().max() < 1e-12
    torch.testing.assert_close(torch.diagonal(second)[:2], squares)


def cards(axes: torch.Tensor, extent: torch.Tensor, slant: torch.Tensor | None) -> np.ndarray:
    assert slant is not None
    return rectangles(axes, extent, slant).corners().numpy()


def test_a_slant_says_the_same_card_in_every_equal_frame() -> None:
    axes = frames.axes_from_quaternion(torch.tensor([0.3, -0.5, 0.7, 0.2], dtype=torch.float64))
    extent, slant = torch.tensor([0.2, 0.4]).double(), torch.tensor(SLANT).double()
    here = torch.tensor(True)
    wanted = cards(axes, extent, slant)
    again = slant_of(rectangles(axes, extent, slant), axes, extent)
    torch.testing.assert_close(again, slant)
    quarter = torch.stack([axes[1], -axes[0], axes[2]])
    found = cards(quarter, extent.flip(0), turned_slant(slant, here, quarters=1))
    assert corner_error(found, wanted) < 1e-7
    half = axes * torch.tensor([-1.0, -1.0, 1.0])[:, None]
    assert corner_error(cards(half, extent, turned_slant(slant, here, quarters=2)), wanted) < 1e-7
    mirror = torch.tensor([1.0, 1.0, -1.0]).double()
    mirrored = axes * mirror * torch.tensor([1.0, -1.0, 1.0])[:, None]
    found = cards(mirrored, extent, mirrored_slant(slant, torch.tensor(-1.0)))
    assert corner_error(found, wanted * mirror.numpy()) < 1e-7


def test_vectors_are_those_of_turns() -> None:
    random = torch.Generator().manual_seed(1)
    vector = torch.randn(50, 3, generator=random, dtype=torch.float64)
    vector = 3 * torch.tanh(vector / 3) / 3**0.5  # by less than half a turn
    torch.testing.assert_close(vectors(turns(vector)), vector)
    torch.testing.assert_close(torch.linalg.det(turns(vector)), torch.ones(50).double())
    still = torch.zeros(1, 3, dtype=torch.float64)
    torch.testing.assert_close(vectors(turns(still)), still)


def test_frames_made_continuous_leave_cards_as_they_are() -> None:
    random = torch.Generator().manual_seed(2)
    quaternions = torch.randn(6, 3, 4, generator=random, dtype=torch.float64)
    lobes = Lobes(
        frames.axes_from_quaternion(quaternions),
        1 + 30 * torch.rand(6, 3, 2, generator=random, dtype=torch.float64),
        torch.ones(6, 3, 3, dtype=torch.float64),
        slant=0.3 * torch.randn(6, 3, 7, generator=random, dtype=torch.float64),
    )
    extent = 1 / lobes.sharpness
    found = frames.continuous(lobes)
    assert not torch.equal(found.axes, lobes.axes)
    before = cards(lobes.axes, extent, lobes.slant).reshape(-1, 4, 3)
    after = cards(found.axes, 1 / found.sharpness, found.slant).reshape(-1, 4, 3)
    for one, other in zip(after, before, strict=True):
        assert corner_error(one, other) < 1e-7


def test_slants_between_frames_are_between_and_those_of_a_dark_frame_are_the_next_ones() -> None:
    axes = torch.eye(3, dtype=torch.float64).expand(2, 1, 3, 3)
    slant = torch.stack([torch.zeros(1, 7), torch.tensor([SLANT])]).double()
    sharpness = torch.full((2, 1, 2), 5.0, dtype=torch.float64)
    light = torch.tensor([[[1.0, 1.0, 1.0]], [[2.0, 1.0, 0.5]]]).double()
    lit = Lobes(axes, sharpness, light, slant=slant)
    half = torch.tensor(0.5)
    found = motion.between(lit[0], lit[1], half).slant
    assert found is not None
    torch.testing.assert_close(found, slant[1] / 2)
    dark = Lobes(axes, sharpness, light * torch.tensor([0.0, 1.0]).view(2, 1, 1), slant=slant)
    found = motion.between(dark[0], dark[1], half).slant
    assert found is not None
    torch.testing.assert_close(found, slant[1])
