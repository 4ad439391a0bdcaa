# SPDX-License-Identifier: Apache-2.0
"""Glossy to matte balls by sums over texels: against brute force of lobes, albedos, and turns."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, frames
from asglight.lobes.texels import texel_means
from asglight.shading import ball_tables, brute_force, ggx

VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
IDENTITY = np.eye(3)
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def lobe_at(direction: list[float], sharpness: float) -> Lobes:
    axis = torch.nn.functional.normalize(torch.tensor([direction], dtype=torch.float64), dim=-1)
    bandwidths = torch.full((1, 2), sharpness, dtype=torch.float64)
    return Lobes(frames.axes_around(axis), bandwidths, torch.ones(1, 3).double(), Form.ASG)


def grid_normals(size: ball_tables.Grid) -> tuple[Tensor, Tensor]:
    """Return the normals of a grid, and which are on the ball and not at its edge.  [N, C]."""
    angle = torch.linspace(0, math.pi / 2, size.normals, dtype=torch.float64)[:, None]
    turn = torch.arange(size.columns, dtype=torch.float64) * 2 * math.pi / size.columns
    x, y = torch.sin(angle) * torch.cos(turn), torch.sin(angle) * torch.sin(turn)
    z = torch.cos(angle).expand_as(x)
    return torch.stack([x, y, z], dim=-1), angle.expand_as(x) < 0.9 * math.pi / 2


def some_of(inside: Tensor, seed: int) -> Tensor:
    """Choose about 300 normals, even over the picture: columns meet in its middle.  [N, C]."""
    radius = torch.sin(torch.linspace(0, math.pi / 2, len(inside)))[:, None]
    drawn = torch.rand(inside.shape, generator=torch.manual_seed(seed))
    return inside & (drawn < 300 * radius / (radius.sum() * inside.shape[1]))


@pytest.mark.parametrize("roughness", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("direction", [[0.3, 0.5, 0.7], [-0.8, 0.1, 0.2], [0.2, -0.9, -0.1]])
def test_a_lobe_is_shown_as_by_brute_force(roughness: float, direction: list[float]) -> None:
    lobe = lobe_at(direction, 60.0)
    seen = ball_tables.CameraMap(texel_means(lobe, 128, 256).numpy().astype(np.float32), IDENTITY)
    normals, inside = grid_normals(ball_tables.grid(roughness))
    some = some_of(inside, 0)
    parts = brute_force.reflected(lobe, normals[some], VIEW, roughness, 1024)[0]
    for f0 in (1.0, 0.04):
        found = ball_tables.ball(seen, roughness, (f0,) * 3, BLACK)[..., 1]
        wanted = (f0 * parts[:, 0] + parts[:, 1]).numpy()
        error = np.abs(found[some.numpy()] - wanted).sum() / wanted.sum()
        assert error < 0.015  # a light is dealt out to four texels, of 1.4 and of 2.8 degrees


def test_the_matte_ball_shows_irradiance() -> None:
    lobe = lobe_at([0.4, 0.6, 0.5], 20.0)
    seen = ball_tables.CameraMap(texel_means(lobe, 128, 256).numpy().astype(np.float32), IDENTITY)
    found = ball_tables.ball(seen, None, WHITE, WHITE)[..., 0]
    normals, inside = grid_normals(ball_tables.COARSE)
    some = some_of(inside, 1)
    wanted = brute_force.irradiance_over_pi(lobe, normals[some], 1024)[0].numpy()
    assert np.abs(found[some.numpy()] - wanted).sum() / wanted.sum() < 0.005


def test_an_even_map_shows_the_directional_albedo() -> None:
    seen = ball_tables.CameraMap(np.full((7, 14, 3), 3.0, np.float32), IDENTITY)
    for roughness in (0.25, 0.5, 0.8, 1.0):
        normals, inside = grid_normals(ball_tables.grid(roughness))
        found = ball_tables.ball(seen, roughness, WHITE, BLACK)[..., 0]
        of_angles = 3 * ggx.albedo(normals[:, 0, 2], roughness**2)  # which azimuths share
        wanted = of_angles[:, None].expand_as(inside)[inside].numpy()
        # an even map is dealt out to fine lights less evenly than to coarse ones
        rtol = 8e-3 if roughness < ball_tables.COARSE_ROUGHNESS else 4e-3
        np.testing.assert_allclose(found[inside.numpy()], wanted, rtol=rtol)
    base = ball_tables.ball(seen, None, WHITE, (0.5, 0.25, 0.0))
    np.testing.assert_allclose(
        base[inside.numpy()], [[1.5, 0.75, 0.0]] * int(inside.sum()), rtol=3e-3
    )


def test_a_turned_camera_sees_the_turned_map() -> None:
    turn = torch.tensor([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]], dtype=torch.float64)  # about +Y
    lobe = lobe_at([0.5, 0.3, 0.6], 40.0)
    turned = lobe_at((turn @ lobe.axes[0, 2]).tolist(), 40.0)
    maps = [texel_means(each, 64, 128).numpy().astype(np.float32) for each in (lobe, turned)]
    by_camera = ball_tables.CameraMap(maps[0], turn.numpy())
    by_map = ball_tables.CameraMap(maps[1], IDENTITY)
    pair = [ball_tables.ball(each, 0.5, WHITE, BLACK) for each in (by_camera, by_map)]
    assert np.abs(pair[0] - pair[1]).sum() / pair[1].sum() < 5e-3
