# SPDX-License-Identifier: Apache-2.0
"""Rectangles that are lamps: the card found is the rectangle, wherever it is."""

from functools import cache

import numpy as np
import pytest
import torch
from key_cases import Rectangle, corner_error, with_lamps

from asglight.keys import cards, rectangles
from asglight.keys.cut import FrameCut, Wanted, frame_cut
from asglight.keys.rectangles import Card, Patch
from asglight.keys.sighting import sightings
from asglight.keys.spots import Grid
from asglight.sphere import latlong

ROWS = 128

PLACES = {
    "ahead": Rectangle(10, 5, 20, 16, 9),
    "on the seam": Rectangle(180, -10, 35, 18, 8),
    "beside the upper pole": Rectangle(40, 84, 10, 14, 9),
    "on the upper pole": Rectangle(0, 89.5, 30, 20, 10),
    "beside the lower pole": Rectangle(-70, -80, 60, 12, 12),
    "a tube": Rectangle(100, 30, 5, 24, 3),
    "a window": Rectangle(-120, 10, 0, 40, 30),
}


@cache
def lit_by(lamp: Rectangle) -> torch.Tensor:
    """Return the map of a lamp, which tests share."""
    return with_lamps(ROWS, lamp)


def cut_of(radiance: torch.Tensor) -> FrameCut:
    masks = []
    for one in sightings(radiance):
        mask = np.zeros(radiance.shape[:2], dtype=bool)
        mask.ravel()[one.place] = True
        masks.append(mask)
    return frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks], [])


@pytest.mark.parametrize("lamp", PLACES.values(), ids=PLACES.keys())
def test_the_card_of_a_rectangle_is_the_rectangle(lamp: Rectangle) -> None:
    found = cut_of(lit_by(lamp))
    assert len(found.keys) == 1
    key = found.keys[0]
    assert key is not None
    size = np.radians(min(lamp.width, lamp.height))
    texel = np.pi / ROWS
    # a tenth of its size; the sides of one of two texels are known to a fifth of a texel
    assert corner_error(key.card.corners(), lamp.corners()) < max(0.1 * size, 0.3 * texel)
    assert key.carried == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("lamp", PLACES.values(), ids=PLACES.keys())
def test_a_card_that_holds_a_lamp_has_its_turn_and_not_much_more_than_its_size(
    lamp: Rectangle,
) -> None:
    radiance = lit_by(lamp)
    [one] = sightings(radiance)
    mask = np.zeros(radiance.shape[:2], dtype=bool)
    mask.ravel()[one.place] = True
    key = frame_cut(radiance, [Wanted(mask, 1.0)], [], whole=True).keys[0]
    assert key is not None
    inside = np.abs(lamp.corners() @ key.card.axes.T)
    tangents = inside[:, :2] / inside[:, 2:]
    texel = np.pi / ROWS
    assert (tangents <= key.card.extent + 0.5 * texel).all()
    most = np.sort(lamp.extent) + 12 * texel  # the matte, which is soft
    assert (np.sort(key.card.extent) <= most * 1.2).all()


def test_covered_texels_sum_to_the_solid_angle_of_the_card() -> None:
    grid = Grid.of(64, 128)
    place = np.arange(64 * 128)
    for lamp in PLACES.values():
        card = Card.facing(lamp.axes, lamp.extent)
        patch = Patch.of(place, grid)
        p, q = lamp.extent
        nodes, weights = np.polynomial.legendre.leggauss(64)
        x, y = np.meshgrid(p * nodes, q * nodes)
        truth = ((1 + x * x + y * y) ** -1.5 * np.outer(weights, weights)).sum() * p * q
        assert card.solid_angle == pytest.approx(truth, rel=1e-9)
        # points a texel wide: their soft edges are right to a part of the outline
        assert patch.covered(card).sum() == pytest.approx(truth, rel=0.03)


@pytest.mark.parametrize("slant", [0.0, 0.4, 1.1])
def test_a_card_has_the_solid_angle_and_the_mean_direction_of_its_light(slant: float) -> None:
    middle = np.array([0.48, 0.6, 0.64])
    side = np.array([-0.8, 0.0, 0.6])
    normal = np.cos(slant) * middle + np.sin(slant) * np.cross(middle, side)
    card = Card(rectangles.frame(side + 0.3 * normal, normal), np.array([0.3, 0.15]), middle)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    u, v = np.meshgrid(0.3 * nodes, 0.15 * nodes, indexing="ij")
    points = middle + u[..., None] * card.axes[0] + v[..., None] * card.axes[1]
    distance = np.linalg.norm(points, axis=-1)
    seen = 0.3 * 0.15 * np.outer(weights, weights) * (normal @ middle) / distance**3
    assert card.solid_angle == pytest.approx(seen.sum(), rel=1e-9)
    mean = ((seen / distance)[..., None] * points).sum((0, 1))
    np.testing.assert_allclose(card.centre, mean / np.linalg.norm(mean), atol=1e-9)


@pytest.mark.parametrize("extent", [(0.01, 0.02), (0.2, 0.1), (0.9, 0.4)])
def test_half_extents_have_the_mean_squares_asked_for(extent: tuple[float, float]) -> None:
    p, q = extent
    nodes, weights = np.polynomial.legendre.leggauss(200)
    x, y = np.meshgrid(p * nodes, q * nodes)
    square = 1 + x * x + y * y
    light = square**-1.5 * np.outer(weights, weights)
    squares = np.array([(light * one / square).sum() for one in (x * x, y * y)]) / light.sum()
    np.testing.assert_allclose(rectangles.half_extent(squares), extent, rtol=1e-6)


def test_light_that_a_card_shows_beyond_its_patch_counts_as_off() -> None:
    grid = Grid.of(64, 128)
    card = Card.facing(PLACES["a window"].axes, PLACES["a window"].extent)
    whole = Patch.of(np.arange(64 * 128), grid)
    some = whole.place[whole.covered(card) > 0][::2]
    patch = Patch.of(some, grid)
    light = patch.covered(card)
    assert cards.apart(cards.off_by(card, whole, whole.covered(card))) < 1e-9
    # half of the card lies elsewhere: light lacks here, and what lacks is elsewhere
    assert cards.apart(cards.off_by(card, patch, light)) > 0.9 * light.sum()


@pytest.mark.parametrize("row", [0, 4, 8, 16, 24])
def test_the_card_of_a_texel_beside_a_pole_spans_the_texel(row: int) -> None:
    rows, column = 256, 100
    radiance = torch.full((rows, 2 * rows, 3), 0.1)
    radiance[row, column] = 500.0
    mask = np.zeros((rows, 2 * rows), dtype=bool)
    mask[row, column] = True
    [key] = frame_cut(radiance, [Wanted(mask, 1.0)], []).keys
    assert key is not None
    latitude = np.pi / 2 - np.pi * (row + np.array([0, 1, 1, 0])) / rows
    longitude = np.pi - np.pi * (column + np.array([0, 0, 1, 1])) / rows
    corners = np.stack(
        [
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
            np.cos(latitude) * np.cos(longitude),
        ],
        -1,
    )
    across = (corners @ key.card.axes[:2].T).std(0)  # half of the sides of a rectangle
    assert np.all(key.card.extent > 0.9 * across)


def test_frames_follow_the_frame_before_through_quarter_turns() -> None:
    lamp = PLACES["ahead"]
    before = Card.facing(lamp.axes, lamp.extent)
    x, y, z = lamp.axes
    for axes, extent in (
        (np.stack([y, -x, z]), lamp.extent[::-1]),
        (np.stack([-x, -y, z]), lamp.extent),
        (np.stack([-y, x, z]), lamp.extent[::-1]),
    ):
        same = rectangles.aligned(Card.facing(axes, extent), before)
        np.testing.assert_allclose(same.axes, before.axes, atol=1e-12)
        np.testing.assert_allclose(same.extent, before.extent)
    first = rectangles.aligned(before, None)
    assert first.extent[0] <= first.extent[1]


def test_balls_see_of_a_lamp_what_a_filter_of_the_whole_map_sees() -> None:
    from asglight.shading import kernels

    rows = 64
    grid = Grid.of(rows, 2 * rows)
    radiance = torch.zeros(rows, 2 * rows, 3, dtype=torch.float64)
    lamp = torch.from_numpy(PLACES["ahead"].covers(grid.directions))
    radiance[lamp] = 1.0
    place = np.flatnonzero(lamp.numpy())
    light = grid.solid_angle.ravel()[place]
    patch = Patch.of(place, grid)
    directions = torch.from_numpy(cards.DIRECTIONS)
    total = float((latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64)[lamp]).sum())
    for roughness, ball in zip(cards.BALLS, cards.balls(patch), strict=True):
        truth = kernels.filtered(radiance[None], roughness, directions)[0, :, 0].sum()
        mean = total / (4 * np.pi) * len(directions)
        assert (ball @ light).sum() / total == pytest.approx(float(truth) / mean, rel=0.02)
