# SPDX-License-Identifier: Apache-2.0
"""The shadow of a post: boards that are drawn by hand, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from dcc.keyed import board, cases, measure
from dcc.keyed.board import Shadow
from dcc.keyed.measure import Row, Shadows

ROWS, COLUMNS = 160, 240
ERRORS = {"matte": 0.003, "r0.5": 0.004, "r0.25": 0.01}
GOOD = Row("day", 1001, ERRORS, {"matte": 0.001}, 0.01, 0.1, 1.0)


def drawn(turn_deg: float, ramp: float, depth: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Return a board without and with a shadow whose edges are even ramps.

    Args:
        turn_deg: Of the shadow.
        ramp: Width of its edges, in metres.
        depth: Share of the light that it takes.
    """
    up = board.HEIGHT * (0.5 - (np.arange(ROWS) + 0.5) / ROWS)[:, None]
    right = board.WIDTH * ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) - board.FOOT
    turn = np.radians(turn_deg)
    across = up * np.cos(turn) - right * np.sin(turn)
    share = np.clip((board.POST / 2 - np.abs(across)) / ramp + 0.5, 0, 1)
    light = np.full((ROWS, COLUMNS, 3), 2.0)
    return light, light * (1 - depth * share)[..., None]


@pytest.mark.parametrize("turn_deg", [0.0, 1.5, -3.0])
def test_a_shadow_has_its_direction_and_its_depth(turn_deg: float) -> None:
    found = board.measured(*drawn(turn_deg, 0.03))
    assert found.direction_deg == pytest.approx(turn_deg, abs=0.02)
    # a turned shadow is a little off the place where its depth is measured
    assert found.depth == pytest.approx(0.6, rel=1e-6 if not turn_deg else 0.1)


@pytest.mark.parametrize("ramp", [0.02, 0.04])
def test_a_shadow_has_its_softness(ramp: float) -> None:
    found = board.measured(*drawn(0.0, ramp))
    seen = np.degrees(0.6 * ramp / (np.sqrt(2) * 0.4))  # three fifths of the ramp, at 0.57 m
    assert found.softness_deg == pytest.approx(seen, rel=0.02)


def test_what_the_post_takes_all_around_is_no_shadow() -> None:
    light, seen = drawn(0.0, 0.03)
    assert board.measured(light, seen - 0.1).depth == pytest.approx(0.6, rel=1e-6)


@pytest.mark.parametrize("key", [(0, 1, 0), (0.6, 0, 0.8), (-0.48, 0.6, 0.64)])
def test_a_key_meets_the_board_at_45_degrees_and_its_shadow_falls_to_the_right(key) -> None:
    direction = np.array(key, dtype=float)
    right, up, normal = board.frame(direction)
    np.testing.assert_allclose(
        np.stack([right, up, normal]) @ np.stack([right, up, normal]).T, np.eye(3), atol=1e-12
    )
    assert direction @ normal == pytest.approx(np.sqrt(0.5))
    assert direction @ right == pytest.approx(-np.sqrt(0.5))
    np.testing.assert_allclose(np.cross(right, up), normal, atol=1e-12)


def test_what_is_above_its_limit_is_said() -> None:
    assert measure.failures([GOOD], []) == []
    worse = replace(GOOD, errors={**ERRORS, "r0.5": 0.006})
    assert measure.failures([worse], []) == ["day 1001 r0.5: 0.60%, above 0.5%"]
    noisy = replace(worse, noise={"r0.5": 0.005})
    assert measure.failures([noisy], []) == []
    glossy = replace(GOOD, glossy=0.021)
    assert measure.failures([glossy], []) == ["day 1001 r0.25, mean: 2.10%, above 2.0%"]
    truth = Shadow(0.0, 1.0, 0.5)
    assert measure.failures([], [Shadows("a", 0.1, truth, Shadow(0.1, 1.05, 0.5))]) == []
    [line] = measure.failures([], [Shadows("a", 0.1, truth, Shadow(-1.0, 1.0, 0.5))])
    assert line == "a: shadow turned by 1.00 degrees"
    [line] = measure.failures([], [Shadows("a", 0.1, truth, Shadow(0.0, 1.2, 0.5))])
    assert line == "a: edges of the shadow 1.20, of the HDRI 1.00 degrees"
    assert "| a | keys and rest | +0.10° | 1.05° | 50.0 |" in measure.shadow_table(
        [Shadows("a", 0.1, truth, Shadow(0.1, 1.05, 0.5))]
    )


@pytest.mark.parametrize(("rows", "found"), [(128, 512), (300, 600), (512, 512), (2000, 2000)])
def test_texels_of_small_images_are_repeated(rows: int, found: int) -> None:
    radiance = torch.rand(rows, 2 * rows, 3)
    repeated = cases.repeated(radiance)
    assert repeated.shape == (found, 2 * found, 3)
    times = found // rows
    assert torch.equal(repeated[times - 1 :: times, ::times], radiance)
