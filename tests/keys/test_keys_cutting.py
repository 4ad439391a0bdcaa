# SPDX-License-Identifier: Apache-2.0
"""Holes filled from their rims, and maps cut into keys and rest."""

import numpy as np
import pytest
import torch
from key_cases import Rectangle, sky, with_lamps

from asglight.keys import cutting, levels
from asglight.keys.cut import FrameCut, Wanted, enlarged, frame_cut, light_of, parts
from asglight.keys.report import rim_gradients
from asglight.keys.sighting import sightings
from asglight.keys.spots import Grid
from asglight.sphere import latlong

ROWS = 128
LAMPS = (Rectangle(20, 10, 15, 12, 8), Rectangle(178, 60, 40, 9, 6, (20.0, 30.0, 60.0)))


def masks(radiance: torch.Tensor) -> list[np.ndarray]:
    found = []
    for one in sightings(radiance):
        mask = np.zeros(radiance.shape[:2], dtype=bool)
        mask.ravel()[one.place] = True
        found.append(mask)
    return found


def flux(radiance: torch.Tensor) -> torch.Tensor:
    solid = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)
    return (radiance.double() * solid[..., None]).sum((0, 1))


def test_a_hole_is_filled_with_the_harmonic_function_of_its_rim_in_stops() -> None:
    # ln tan(theta / 2) and its like about another axis solve Laplace's equation on the sphere
    grid = Grid.of(128, 256)
    axis = np.array([0.6, 0.48, 0.64])
    cosine = grid.directions @ axis
    radiance = np.exp(np.log((1 - cosine) / (1 + cosine)) / 2)
    for place in ([1.0, 0.1, -0.3], [-0.2, 1.0, 0.1], [0.1, -0.3, -1.0]):
        direction = np.array(place) / np.linalg.norm(place)
        holes = grid.directions @ direction > np.cos(np.radians(12))
        filled = cutting.filled(
            np.repeat(radiance[..., None], 3, 2) * ~holes[..., None], holes, grid
        )
        # the mesh is of texels of 1.4 degrees; `DARK` bends the logarithm of dark places a little
        np.testing.assert_allclose(filled[holes][:, 0], radiance[holes], rtol=0.01)
        np.testing.assert_array_equal(filled[~holes][:, 0], radiance[~holes])


def test_a_glow_goes_on_into_its_hole_and_leaves_no_ring() -> None:
    grid = Grid.of(128, 256)
    angle = np.arccos(np.clip(grid.directions @ [0.0, 0.6, 0.8], -1, 1))
    glow = np.repeat((0.02 + np.exp(-angle / np.radians(6)))[..., None], 3, 2)
    holes = angle < np.radians(10)
    filled = cutting.filled(glow * ~holes[..., None], holes, grid)[..., 0]
    middle, edge = filled[angle < np.radians(4)], filled[holes & (angle > np.radians(8.5))]
    # brighter all the way in, though not as bright as the glow would be where the lamp is
    assert middle.min() > 1.1 * edge.mean()
    assert (filled[holes] <= glow[holes][:, 0] * 1.05).all()


def test_what_rises_away_from_a_hole_makes_no_dark_hole() -> None:
    grid = Grid.of(128, 256)
    angle = np.arccos(np.clip(grid.directions @ [0.0, 0.6, 0.8], -1, 1))
    valley = np.repeat((0.02 + angle**2)[..., None], 3, 2)
    holes = angle < np.radians(10)
    filled = cutting.filled(valley * ~holes[..., None], holes, grid)[..., 0]
    assert filled[holes].min() > 0.99 * valley[~holes].min()


def test_lamps_have_their_own_texels_and_what_lies_between_by_their_light() -> None:
    grid = Grid.of(64, 128)
    near, far = np.zeros((2, 64, 128), dtype=bool)
    near[30:32, 40:42] = far[30:32, 44:46] = True
    luminance = np.where(near, 100.0, np.where(far, 50.0, 1.0))
    mattes = [cutting.matte(mask, luminance, grid) for mask in (near, far)]
    first, second = cutting.shares([near, far], mattes, luminance, grid)
    assert first[near].min() > 1 - 1e-6
    assert second[far].min() > 1 - 1e-6
    assert first[far].max() < 1e-6
    assert second[near].max() < 1e-6
    # 1 and 2 texels away, then 2 and 1, and twice as bright
    np.testing.assert_allclose(first[30, 42:44], [8 / 9, 1 / 3], rtol=1e-3)
    assert (first + second).max() < 1 + 1e-9


@pytest.mark.parametrize("light", [0.0, 5.0])
def test_a_lamp_that_is_black_for_a_while_within_the_matte_of_another_has_no_light(
    light: float,
) -> None:
    # as where a lamp blinks on a black map beside a large one, which may be black too
    rows = 256  # at which all of its matte lies within the other one
    grid = Grid.of(rows, 2 * rows)
    large = grid.directions @ [0.0, 0.0, 1.0] > np.cos(np.radians(35))
    small = np.zeros_like(large)
    small[rows // 2, np.flatnonzero(large[rows // 2])[-1] + 5] = True
    radiance = torch.from_numpy(np.where(large, light, 0.0)).float()[..., None].repeat(1, 1, 3)
    cut = frame_cut(radiance, [Wanted(small, 1.0), Wanted(large, 1.0)], [])
    assert cut.keys[0] is None
    found = parts(cut, radiance)
    torch.testing.assert_close(found.flux.sum(0) + flux(found.rest), flux(radiance))


def test_a_lamp_that_stays_keeps_nothing_of_a_key_beside_it() -> None:
    radiance = with_lamps(ROWS, Rectangle(0, 0, 0, 12, 8), Rectangle(17, 0, 0, 10, 8))
    key, other = masks(radiance)
    cut = frame_cut(radiance, [Wanted(key, 1.0)], [other])
    rest = parts(cut, radiance).rest
    assert float(rest[torch.from_numpy(key)].max()) < 1  # the lamp has 50
    inner = torch.from_numpy(other & ~Grid.of(ROWS, 2 * ROWS).near(~other, 0.03))
    torch.testing.assert_close(rest[inner], radiance[inner], rtol=1e-5, atol=0)


def test_a_matte_is_whole_on_its_lamp_and_smooth_beyond() -> None:
    grid = Grid.of(64, 128)
    mask = np.zeros((64, 128), dtype=bool)
    mask[0:2, 5] = mask[20:26, 125:] = mask[20:26, :3] = True
    matte = cutting.matte(mask, np.where(mask, 50.0, 1.0), grid)
    assert (matte[mask] == 1).all()
    assert matte.min() == 0
    assert ((matte > 0) & (matte < 1)).any()
    steps = np.abs(np.diff(matte[30:, 0]))
    assert steps.max() < 0.7  # not from whole to nothing at once


@pytest.mark.parametrize("rows", [64, ROWS, 200])
def test_keys_and_rest_have_the_flux_of_the_map_in_each_channel(rows: int) -> None:
    radiance = with_lamps(rows, *LAMPS, rays=4)
    small = latlong.reduce(radiance, min(rows, ROWS), 2 * min(rows, ROWS))
    cut = frame_cut(small, [Wanted(mask, 1.0) for mask in masks(small)], [])
    found = parts(cut, radiance)
    assert len(found.flux) == 2
    torch.testing.assert_close(
        flux(found.rest) + found.flux.sum(0), flux(radiance), rtol=1e-6, atol=0
    )
    assert float(found.rest.min()) >= 0
    assert float(found.flux.min()) >= 0


def test_the_rest_is_the_sky_behind_the_lamps_and_the_map_elsewhere() -> None:
    radiance = with_lamps(ROWS, *LAMPS)
    cut = frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks(radiance)], [])
    found = parts(cut, radiance)
    outside = torch.from_numpy(~cut.holes)
    assert torch.equal(found.rest[outside], radiance[outside])
    torch.testing.assert_close(found.rest, sky(ROWS), rtol=0.03, atol=0)
    # no edge is seen at the rim
    assert max(rim_gradients(radiance, found.rest, cut)) < 1.2


def test_dark_rims_that_filters_leave_are_filled_and_the_flux_is_kept() -> None:
    radiance = with_lamps(ROWS, LAMPS[0])
    bright = radiance.mean(-1) > 5
    around = torch.from_numpy(Grid.of(ROWS, 2 * ROWS).near(bright.numpy(), 0.03))
    radiance[around & ~bright] = 0
    cut = frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks(radiance)], [])
    found = parts(cut, radiance)
    torch.testing.assert_close(
        flux(found.rest) + found.flux.sum(0), flux(radiance), rtol=1e-6, atol=0
    )
    torch.testing.assert_close(found.rest, sky(ROWS), rtol=0.05, atol=0)


def test_half_of_a_key_that_is_half_up_stays_in_the_rest() -> None:
    radiance = with_lamps(ROWS, LAMPS[0])
    [mask] = masks(radiance)
    whole = parts(frame_cut(radiance, [Wanted(mask, 1.0)], []), radiance)
    half = parts(frame_cut(radiance, [Wanted(mask, 0.5)], []), radiance)
    torch.testing.assert_close(half.flux, whole.flux / 2, rtol=1e-3, atol=0)


def test_a_lamp_that_a_card_cannot_show_keeps_its_top_in_the_rest_within_the_goals() -> None:
    from asglight.judging.metrics import map_errors
    from asglight.keys.rectangles import Patch

    grid = Grid.of(ROWS, 2 * ROWS)
    angle = np.arccos(np.clip(grid.directions @ [0.0, 0.0, 1.0], -1, 1))
    glow = torch.from_numpy(400 * np.exp(-((angle / 0.05) ** 2)) + 20.0 * (angle < 0.25)).float()
    radiance = sky(ROWS) + glow[..., None] * torch.tensor([1.0, 0.9, 0.8])
    cut = frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks(radiance)], [])
    found = parts(cut, radiance)
    [key] = cut.keys
    assert key is not None
    assert 0.3 < key.carried < 1
    patch = Patch.of(np.arange(ROWS * 2 * ROWS), grid)
    cover = torch.from_numpy(patch.covered(key.card)).view(ROWS, -1, 1)
    solid = torch.from_numpy(grid.solid_angle)[..., None]
    shown = found.rest + (found.flux[0] * cover / cover.sum() / solid).float()
    errors = map_errors(shown, radiance).values
    assert errors["env"] < 0.15
    assert errors["r0.25"] < 0.02
    assert errors["r0.5"] < 0.006
    assert errors["irr"] < 0.003


def test_a_dim_lamp_is_cut_at_levels_of_its_own_and_not_of_a_bright_one_beside_it() -> None:
    # a disc that no card shows well; else it would be whole, and nothing left to the bright one
    grid = Grid.of(ROWS, 2 * ROWS)
    disc = grid.directions @ [0.0, 0.0, 1.0] > np.cos(np.radians(30))
    values = np.where(disc, 5.0, 0.0)
    values[ROWS // 2, np.flatnonzero(disc[ROWS // 2])[-1] + 5] = 8000.0
    radiance = torch.from_numpy(values).float()[..., None].repeat(1, 1, 3)
    wanted = [Wanted(mask, 1.0) for mask in masks(radiance)]
    assert len(wanted) == 2
    cut = frame_cut(radiance, wanted, [])
    light = parts(cut, radiance).flux[:, 0]
    off = sum(key.apart * float(one) for key, one in zip(cut.keys, light, strict=True) if key)
    assert off <= 1.01 * levels.GOALS[0] * float(flux(radiance)[0])
    assert all(key is not None and key.carried > 0.1 for key in cut.keys)


def test_enlarging_keeps_texels_that_are_there_and_meets_at_the_seam() -> None:
    image = torch.rand(8, 16, 2)
    assert enlarged(image, 8) is image
    large = enlarged(image, 24)
    torch.testing.assert_close(large[1::3, 1::3], image)
    torch.testing.assert_close(large[1::3, 0], image[:, 0].lerp(image[:, -1], 1 / 3))
    torch.testing.assert_close(large[0], large[1])  # beyond the outermost centres it is theirs


def test_what_a_key_takes_is_what_the_rest_lacks() -> None:
    radiance = with_lamps(ROWS, LAMPS[0])
    cut = frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks(radiance)], [])
    rows, light = light_of(cut, 0, radiance)
    rest = radiance.clone()
    rest[rows] -= light
    torch.testing.assert_close(parts(cut, radiance).rest, rest.clamp(min=0))


def test_a_lamp_beside_a_hole_does_not_light_it() -> None:
    grid = Grid.of(64, 128)
    radiance = np.ones((64, 128, 3))
    holes = np.zeros((64, 128), dtype=bool)
    holes[30:34, 60:66] = True
    radiance[30:34, 66] = 1000.0
    filled = cutting.filled(radiance, holes, grid)
    assert filled[holes].max() <= cutting.RIM_MOST
    np.testing.assert_allclose(filled[30:34, 60], 1, rtol=0.2)
    np.testing.assert_array_equal(filled[~holes], radiance[~holes])


def test_a_small_light_on_the_rim_of_a_matte_stays_whole() -> None:
    radiance = with_lamps(ROWS, LAMPS[0])
    [mask] = masks(radiance)
    matte = cutting.matte(mask, radiance.double().mean(-1).numpy(), Grid.of(ROWS, 2 * ROWS))
    rim = np.argwhere((matte > 0.3) & (matte < 0.7))
    inner = np.argwhere((matte == 1) & ~Grid.of(ROWS, 2 * ROWS).near(mask, 0.04))
    spots = [tuple(rim[0]), tuple(inner[-1])]
    for spot in spots:
        radiance[spot] = 5.0
    found = parts(frame_cut(radiance, [Wanted(mask, 1.0)], []), radiance)
    assert torch.equal(found.rest[spots[0]], radiance[spots[0]])
    assert float(found.rest[spots[1]].max()) < 1


def test_a_rim_without_a_seam_is_told_from_one_with_a_seam() -> None:
    radiance = with_lamps(ROWS, LAMPS[0])
    cut = frame_cut(radiance, [Wanted(mask, 1.0) for mask in masks(radiance)], [])
    [key] = cut.keys
    assert key is not None
    assert rim_gradients(radiance, parts(cut, radiance).rest, cut)[0] < 1.2
    bad = torch.where(torch.from_numpy(cut.holes)[..., None], 1.3 * cut.background, radiance)
    seam = FrameCut(bad, cut.keys, cut.holes)
    assert rim_gradients(radiance, parts(seam, radiance).rest, seam)[0] > 3
