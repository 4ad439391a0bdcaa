# SPDX-License-Identifier: Apache-2.0
"""Plans: the best of all that there are, found by trying every one."""

import itertools
import math

import pytest
import torch
from torch import Tensor

from asglight.fitting.plans import DARK, Places, Plan, best_plan

COSINE = math.cos(math.radians(30))
FRAMES, LOBES, CHOICES = 5, 2, 2
ALL = torch.ones(FRAMES, LOBES, dtype=torch.bool)


def _on_equator(degrees: Tensor) -> Tensor:
    angle = torch.deg2rad(degrees)
    return torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], dim=-1)


def _random(seed: int) -> Places:
    """Return places a few leashes apart, with gains that are sometimes worth the costs."""
    generator = torch.Generator().manual_seed(seed)

    def numbers(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    return Places(
        _on_equator(120 * numbers(FRAMES, CHOICES)),
        numbers(FRAMES, CHOICES),
        0.4 * numbers(FRAMES, LOBES),
        _on_equator(360 * numbers(FRAMES, LOBES)),
        _on_equator(360 * numbers(FRAMES, LOBES)),
        numbers(FRAMES) < 0.9,
        starts=bool(seed % 2),
        ends=bool(seed % 3),
    )


def _worth(places: Places, lobe: int, first: int, way: tuple[int, ...]) -> float:
    """Return what a plan is worth, frame by frame; minus infinity if it breaks a rule."""
    frames = range(first, first + len(way))
    at = [places.axis_z[frame, place] for frame, place in zip(frames, way, strict=True)]
    if any(float(a @ b) <= COSINE for a, b in itertools.pairwise(at)):
        return -math.inf
    worth, changed = 0.0, set(frames)
    for frame, place in zip(frames, way, strict=True):
        worth += float(places.gain[frame, place] - places.cost[frame, lobe])
    beside = (
        (at[0], places.before[first], first, -1),
        (at[-1], places.after[frames[-1]], frames[-1], 1),
    )
    for here, there, frame, step in beside:
        if float(there[lobe] @ here) > COSINE:
            continue
        for other in range(frame + step, frame + step * (DARK + 1), step):
            if 0 <= other < FRAMES:
                worth -= float(places.cost[other, lobe])
                changed.add(other)
            elif not (places.starts if step < 0 else places.ends):
                return -math.inf
    return worth if all(bool(places.open[frame]) for frame in changed) else -math.inf


@pytest.mark.parametrize("seed", range(12))
def test_no_plan_is_worth_more(seed: int) -> None:
    places = _random(seed)
    every = {
        (lobe, first, way): _worth(places, lobe, first, way)
        for lobe in range(LOBES)
        for first in range(FRAMES)
        for length in range(1, FRAMES - first + 1)
        for way in itertools.product(range(CHOICES), repeat=length)
    }
    most = max(every.values())
    found = best_plan(places, COSINE, ALL)
    if found is None:
        assert most == -math.inf
        return
    assert found.worth == pytest.approx(most, abs=1e-5)
    assert every[found.lobe, found.first, found.places] == pytest.approx(most, abs=1e-5)


def _plain(gain: list[float]) -> Places:
    """Return one place that stands, far from one lobe that nobody misses."""
    count = len(gain)
    there, far = (_on_equator(torch.full((count, 1), angle)) for angle in (0.0, 180.0))
    return Places(
        there, torch.tensor(gain)[:, None], torch.zeros(count, 1), far, far,
        torch.ones(count, dtype=torch.bool),
    )  # fmt: skip


def test_a_plan_leaves_out_frames_that_lose() -> None:
    allowed = torch.ones(6, 1, dtype=torch.bool)
    found = best_plan(_plain([0.1, -0.5, 0.3, 0.2, -0.1, -0.1]), COSINE, allowed)
    assert found == Plan(0, 2, (0, 0), pytest.approx(0.5))
    assert found.last == 3
    allowed[3] = False
    assert best_plan(_plain([0.1, -0.5, 0.3, 0.2, -0.1, -0.1]), COSINE, allowed) == Plan(
        0, 2, (0,), pytest.approx(0.3)
    )


def test_there_is_no_plan_where_no_frame_may_be_changed() -> None:
    assert best_plan(_plain([0.1, 0.2]), COSINE, torch.zeros(2, 1, dtype=torch.bool)) is None
