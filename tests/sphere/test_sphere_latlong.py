# SPDX-License-Identifier: Apache-2.0
"""The latlong grid against literal directions, closed forms and its own inverse."""

import math

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st

from asglight.sphere import latlong

EXACT = 1e-15
"""Components of a direction in float64: a sine or a cosine is good to about 1e-16."""

SIZES = [(1, 2), (2, 4), (3, 5), (8, 16), (37, 74), (256, 512)]


def _double(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.mark.parametrize(
    ("u", "v", "direction"),
    [
        (0.5, 0.5, (0, 0, 1)),
        (0.25, 0.5, (1, 0, 0)),
        (0.75, 0.5, (-1, 0, 0)),
        (0.0, 0.5, (0, 0, -1)),
        (1.0, 0.5, (0, 0, -1)),
        (0.5, 0.0, (0, 1, 0)),
        (0.1, 0.0, (0, 1, 0)),
        (0.5, 1.0, (0, -1, 0)),
        (0.5, 0.25, (0, math.sqrt(0.5), math.sqrt(0.5))),
        (0.125, 0.5, (math.sqrt(0.5), 0, -math.sqrt(0.5))),
        (0.375, 0.75, (0.5, -math.sqrt(0.5), 0.5)),
    ],
)
def test_uv_gives_the_literal_direction(
    u: float, v: float, direction: tuple[float, float, float]
) -> None:
    found = latlong.direction_from_uv(_double(u), _double(v))[0]
    assert found.tolist() == pytest.approx(direction, abs=EXACT)


@pytest.mark.parametrize(
    ("direction", "uv"),
    [
        ((0, 0, 1), (0.5, 0.5)),
        ((3, 0, 0), (0.25, 0.5)),
        ((-1e-3, 0, 0), (0.75, 0.5)),
        ((0, 1, 0), (0.5, 0.0)),
        ((0, -7, 0), (0.5, 1.0)),
        ((1, 0, -1), (0.125, 0.5)),
        ((0, 1, 1), (0.5, 0.25)),
    ],
)
def test_direction_of_any_length_gives_the_literal_uv(
    direction: tuple[float, float, float], uv: tuple[float, float]
) -> None:
    u, v = latlong.uv_from_direction(_double(*direction))
    assert (u.item(), v.item()) == pytest.approx(uv, abs=EXACT)


@pytest.mark.thorough
@settings(deadline=None, max_examples=tries(300))
@given(u=st.floats(0, 1), v=st.floats(0, 1))
def test_uv_of_the_direction_of_uv_is_uv(u: float, v: float) -> None:
    direction = latlong.direction_from_uv(_double(u), _double(v))
    u_back, v_back = (t.item() for t in latlong.uv_from_direction(direction))
    # acos-free inverse: v to rounding everywhere; u loses the digits that cos(latitude) has lost
    assert v_back == pytest.approx(v, abs=1e-15)
    distance = abs(u_back - u) * math.sin(math.pi * v)
    assert min(distance, math.sin(math.pi * v) - distance) == pytest.approx(0, abs=1e-15)


@pytest.mark.thorough
@settings(deadline=None, max_examples=tries(300))
@given(xyz=st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 3))
def test_direction_of_the_uv_of_a_direction_is_the_direction(
    xyz: tuple[float, float, float],
) -> None:
    length = math.hypot(*xyz)
    if length < 1e-100:
        return  # no direction; shorter ones underflow in hypot
    u, v = latlong.uv_from_direction(_double(*xyz))
    assert 0 <= u.item() <= 1
    assert 0 <= v.item() <= 1
    back = latlong.direction_from_uv(u, v)
    unit = [c / length for c in xyz]
    assert back.tolist() == pytest.approx(unit, abs=2e-15)


def test_uv_stays_in_the_unit_square_in_float32() -> None:
    angle = torch.linspace(-math.pi, math.pi, 100001)
    u, v = latlong.uv_from_direction(
        torch.stack([torch.sin(angle), torch.cos(angle), torch.cos(angle)], dim=-1)
    )
    assert 0 <= u.min() <= u.max() <= 1
    assert 0 <= v.min() <= v.max() <= 1


def test_neighbours_across_the_seam_are_one_texel_apart() -> None:
    height, width = 8, 16
    grid = latlong.directions(height, width, dtype=torch.float64)
    across = (grid[:, 0] * grid[:, -1]).sum(-1)
    inside = (grid[:, 5] * grid[:, 6]).sum(-1)
    torch.testing.assert_close(across, inside, rtol=0, atol=EXACT)
    assert (grid[:, 0, 0] > 0).all(), "the left edge is the +X side of -Z"
    assert (grid[:, -1, 0] < 0).all()


def test_no_texel_centre_lies_on_a_pole_and_the_first_row_is_up() -> None:
    grid = latlong.directions(4, 8, dtype=torch.float64)
    rows = [math.sin(math.radians(a)) for a in (67.5, 22.5, -22.5, -67.5)]
    np.testing.assert_allclose(grid[:, 3, 1].numpy(), rows, atol=EXACT)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_texel_centres_are_half_a_texel_from_the_edges(height: int, width: int) -> None:
    u, v = latlong.uv_from_direction(latlong.directions(height, width, dtype=torch.float64))
    column, row = u * width, v * height
    if width % 2 == 0:
        # a ramp whose value is its column and row: any shift would show as a difference
        np.testing.assert_allclose(column.numpy(), np.tile(np.arange(width) + 0.5, (height, 1)))
    np.testing.assert_allclose(row.numpy(), np.tile(np.arange(height)[:, None] + 0.5, (1, width)))


def test_grid_is_unit_length_and_rounded_once_to_float32() -> None:
    fine = latlong.directions(64, 128, dtype=torch.float64)
    np.testing.assert_allclose(fine.norm(dim=-1).numpy(), 1, atol=4e-16)
    assert torch.equal(latlong.directions(64, 128), fine.float())
    assert latlong.directions(64, 128).shape == (64, 128, 3)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_solid_angles_sum_to_the_sphere(height: int, width: int) -> None:
    total = latlong.texel_solid_angles(height, width, dtype=torch.float64).sum().item()
    assert total == pytest.approx(4 * math.pi, rel=1e-14)


def test_solid_angles_are_the_literal_bands() -> None:
    # edges at 90, 30, -30, -90 degrees: areas 2 pi (1 - 1/2), 2 pi, 2 pi (1 - 1/2) over 4 columns
    found = latlong.texel_solid_angles(3, 4, dtype=torch.float64)
    expected = np.tile(np.array([[math.pi / 4], [math.pi / 2], [math.pi / 4]]), (1, 4))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-15)
    assert found.shape == (3, 4)


def test_solid_angle_of_a_polar_texel_of_a_large_map_keeps_its_digits() -> None:
    height, width = 4096, 8192
    found = latlong.texel_solid_angles(height, width, dtype=torch.float64)[0, 0].item()
    half = math.pi / height / 2
    # 1 - cos a = 2 sin^2(a / 2) has no cancellation; the code's difference has 3e-7 of 1 left
    assert found == pytest.approx(2 * math.pi / width * 2 * math.sin(half) ** 2, rel=1e-9)
