# SPDX-License-Identifier: Apache-2.0
"""What three.js is held against: the lights of a stage at a time, and the angles between them."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from benchmarks.stages import threejs


def opened(folder: Path, name: str) -> Usd.Stage:
    path = folder / f"{name}.usda"
    path.write_text(threejs.FAULTS[name])
    return Usd.Stage.Open(str(path))


def test_lights_are_where_usd_says_at_a_time(tmp_path: Path) -> None:
    (light,) = threejs.lights_of(opened(tmp_path, "moving"), 12).values()
    assert light.place == pytest.approx([5, 0, 5])
    assert light.direction == pytest.approx([0, 0, -1])
    assert light.light == pytest.approx([2, 2, 2])
    (sun,) = threejs.lights_of(opened(tmp_path, "sun"), 0).values()
    assert sun.direction == pytest.approx([-1, 0, 0])  # a quarter turn about +Y


def test_a_light_at_the_origin_is_as_far_away_as_can_be() -> None:
    assert threejs.angle(np.array([0.0, 0, 5]), np.zeros(3)) == 180
    assert threejs.angle(np.array([1.0, 0, 0]), np.array([0.0, 2, 0])) == pytest.approx(90)
