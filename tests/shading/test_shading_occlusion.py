# SPDX-License-Identifier: Apache-2.0
"""Soft shadows in closed form against rays, and against the distribution they approximate."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from torch import Tensor

from asglight.lobes import Form, Lobes, asg, frames
from asglight.shading import brute_force, occlusion, rectified
from asglight.shading.sheets import sheets

UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
BALL = UP  # of radius 1, on the ground
FOOT = torch.tensor([1.9, 0.0, -0.6], dtype=torch.float64)
POST = (0.12, 2.2)

POINTS = 2048


def ball_hits(places: Tensor, directions: Tensor) -> Tensor:
    """Tell which rays meet the ball.  [P, S]."""
    away = places - BALL
    along = away @ directions.mT
    return (along**2 - (away * away).sum(-1, keepdim=True) + 1 > 0) & (along < 0)


def post_hits(places: Tensor, directions: Tensor) -> Tensor:
    """Tell which rays meet the post.  [P, S]."""
    away = (places - FOOT)[:, None, [0, 2]]
    level = directions[None][..., [0, 2]]
    square = (level * level).sum(-1)
    mixed = (away * level).sum(-1)
    root2 = mixed**2 - square * ((away * away).sum(-1) - POST[0] ** 2)
    at = (-mixed - root2.clamp(min=0).sqrt()) / square.clamp(min=1e-12)
    return (root2 > 0) & (at > 0) & (at * directions[None, :, 1] < POST[1])


def lobes_above(form: Form, count: int) -> Lobes:
    """Return lobes of every width and many ratios whose axes are above the horizon.  [N, .]."""
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    mean = 10 ** (5 * draw(count, 1) - 0.5)
    ratio = 10 ** (1.5 * draw(count, 1) * (draw(count, 1) < 0.6))
    sharpness = mean.expand(-1, 2) if form is Form.SG else mean * ratio ** torch.tensor([0.5, -0.5])
    axes = frames.axes_from_quaternion(torch.randn(count, 4, generator=generator).double())
    below = axes[:, 2, 1] < 0
    axes[below, 2] *= -1
    axes[below, 0] *= -1
    return Lobes(axes, sharpness, torch.ones(count, 3, dtype=torch.float64), form)


def places_near(lobe: Lobes, base: Tensor, count: int) -> Tensor:
    """Return points of the ground around the shadow of what stands at a point.  [P, 3]."""
    generator = torch.Generator().manual_seed(1)
    x, y, z = lobe.axes[0, 2].tolist()
    along = -torch.tensor([x, 0.0, z], dtype=torch.float64) / max(y, 0.15)
    far = 1.6 * torch.rand(count, 1, generator=generator).double()
    aside = 3 * (torch.rand(count, 3, generator=generator).double() - 0.5)
    aside[:, 1] = 0
    found = base + along * far + aside
    return found[(found - base).norm(dim=-1) > 0.2]


def errors(form: Form) -> dict[str, np.ndarray]:
    """Return errors of shadows of ball and post, as shares of what a facing patch would get."""
    lobes = lobes_above(form, 80)
    found: dict[str, list[Tensor]] = {"ball": [], "post": []}
    for index in range(lobes.count):
        lobe = lobes.select(torch.tensor([index]))
        made = sheets(lobe)
        facing = float(brute_force.irradiance_over_pi(lobe, UP[None], POINTS)[0, 0] * math.pi)
        weight = min(facing / float(asg.integral(lobe)[0]), 1.0)
        for name, base in (("ball", torch.zeros(3, dtype=torch.float64)), ("post", FOOT)):
            places = places_near(lobe, base, 30)
            hits = ball_hits if name == "ball" else post_hits
            wanted = brute_force.visible(
                lobe, UP, lambda d, hits=hits, places=places: hits(places, d), POINTS
            )
            patch = occlusion.ball_patch(places, BALL, 1.0)
            if name == "post":
                patch = occlusion.post_patch(places, FOOT, *POST)
            light = rectified.irradiance_over_pi(made, UP[None])  # of both halves of a bingham
            shown = (occlusion.visible(made, UP, [patch]) * light).sum(0) / light.sum()
            found[name].append((shown - wanted).abs() * weight)
    return {name: torch.cat(parts).numpy() for name, parts in found.items()}


@pytest.mark.parametrize(
    ("form", "ball", "post"),
    [
        (Form.ASG, (0.007, 0.033), (0.003, 0.01)),
        (Form.SG, (0.007, 0.035), (0.003, 0.01)),
        (Form.BINGHAM, (0.015, 0.08), (0.003, 0.01)),
    ],
)
def test_shadows_are_those_of_rays(
    form: Form, ball: tuple[float, float], post: tuple[float, float]
) -> None:
    """The mean and 95 % of the errors that docs/method/shading.md states."""
    found = errors(form)
    for name, (mean, most) in (("ball", ball), ("post", post)):
        assert found[name].mean() < mean
        assert np.quantile(found[name], 0.95) < most


@pytest.mark.parametrize("deviation", [0.02, 0.1, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("away", [0.0, 0.5, 0.9, 1.1, 2.0])
def test_a_round_light_is_blocked_as_a_noncentral_chi_square_is_below_one(
    deviation: float, away: float
) -> None:
    def row(*values: float) -> Tensor:
        return torch.tensor([[values]], dtype=torch.float64)

    variance = torch.tensor([[deviation**2]], dtype=torch.float64)
    found = occlusion._probability(row(away, 0, 0), row(1, 0, 0), row(0, 1, 0), variance, variance)
    wanted = stats.ncx2.cdf(deviation**-2, 2, (away / deviation) ** 2)
    assert float(found) == pytest.approx(wanted, abs=0.015)


def test_a_far_point_is_in_the_light_and_one_under_the_ball_in_the_dark() -> None:
    lobes = lobes_above(Form.ASG, 20)
    made = sheets(lobes)
    places = torch.tensor([[0.01, 0.0, 0.0], [400.0, 0.0, 300.0]], dtype=torch.float64)
    left = occlusion.visible(made, UP, [occlusion.ball_patch(places, BALL, 1.0)])
    sharp = lobes.sharpness.amin(-1) > 30
    high = lobes.axes[:, 2, 1] > 0.3
    assert left[sharp & high, 0].max() < 1e-3
    assert left[:, 1].min() > 0.98


def test_what_two_stand_in_the_way_of_is_darker_than_of_either() -> None:
    made = sheets(lobes_above(Form.ASG, 20))
    places = torch.tensor([[0.9, 0.0, -0.3]], dtype=torch.float64)
    patches = [
        occlusion.ball_patch(places, BALL, 1.0),
        occlusion.post_patch(places, FOOT, *POST),
    ]
    both = occlusion.visible(made, UP, patches)
    either = torch.stack([occlusion.visible(made, UP, [patch]) for patch in patches])
    torch.testing.assert_close(both, either.prod(0))
