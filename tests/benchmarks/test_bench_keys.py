# SPDX-License-Identifier: Apache-2.0
"""Keys of maps and shots by chance keep to what is asked of them: `benchmarks/keyed/`."""

import argparse
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from bench_scripts import module

cases = module("keyed.cases")
seen = module("keyed.seen")
synthetic = module("keyed.synthetic")

ROWS = 64
MOST = {"env": 0.15, "irr": 0.003, "r0.5": 0.006, "r0.25": 0.02, "flux": 1e-4}
KINDS = list(cases.KINDS)[:10]


@pytest.fixture(autouse=True)
def few_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Judge along a tenth of the rays: irradiance is then off by 0.001 at most."""
    monkeypatch.setattr(seen, "RAYS_ACROSS", 40)
    monkeypatch.setattr(seen, "RAYS", (12, 60))


@lru_cache(maxsize=1)
def ten() -> list[Any]:
    """Return the cases; shots of two frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cases, "FRAMES", 2)
        return list(cases.cases(10, seed=7, rows=ROWS))


@pytest.mark.parametrize("index", range(10), ids=KINDS)
def test_keys_and_rest_of_cases_by_chance_are_the_map(index: int) -> None:
    options = argparse.Namespace(keys=None, texture=False)
    row, corners = synthetic.judged_case(ten()[index], options)
    assert row.keys >= 1
    for name, most in MOST.items():
        assert row.worst[name] <= most, name
    assert row.rim < 1.5  # bands of small mattes have a dozen texels
    assert corners is None or corners < 0.1


@pytest.mark.parametrize("index", [1, 4], ids=[KINDS[k] for k in (1, 4)])
def test_keys_with_their_pixels_are_the_map_more_nearly(index: int) -> None:
    options = argparse.Namespace(keys=None, texture=True)
    row, _ = synthetic.judged_case(ten()[index], options)
    assert row.worst["env"] <= 0.03
    assert row.worst["r0.25"] <= 0.002


def test_a_card_off_by_a_tenth_is_told() -> None:
    random = np.random.default_rng(1)
    quad = cases.rectangle(random, np.array([0.0, 0.0, 1.0]))
    x, y = quad.corners[0] - quad.corners[1], quad.corners[0] - quad.corners[3]
    half = np.linalg.norm(x) / 2, np.linalg.norm(y) / 2
    z = float(quad.corners[0, 2])
    to_world = np.eye(4)
    to_world[:2, :3] = x / np.linalg.norm(x), y / np.linalg.norm(y)
    to_world[2, :3] = np.cross(to_world[0, :3], to_world[1, :3])
    to_world[3, :3] = [0, 0, z]

    def off(scale: float) -> float:
        light = seen.Light(np.linalg.inv(to_world), (half[0] * scale, half[1]), np.ones(3), None)
        return synthetic.corners_off([light], [quad], 1e-4)

    assert off(1.0) < 1e-6
    longer = half[0] / min(half)
    assert off(1.1) == pytest.approx(0.1 * longer / 2, rel=0.1)
    assert synthetic.corners_off([], [quad], 1e-4) is None
