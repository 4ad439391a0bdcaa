# SPDX-License-Identifier: Apache-2.0
"""A ball and a post on the ground, lobes over them, and rays that tell what is in their shadow."""

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg, frames
from asglight.shading import brute_force, occlusion, rectified
from asglight.shading.sheets import sheets

UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
BALL = UP
"""Centre of the ball, of radius 1, on the ground."""

FOOT = torch.tensor([1.9, 0.0, -0.6], dtype=torch.float64)
POST = (0.12, 2.2)
"""Radius and height."""

POINTS = 2048
"""Of each sampler of the brute force."""


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


def errors(form: Form, count: int = 80) -> dict[str, np.ndarray]:
    """Return errors of shadows of ball and post, as shares of what a facing patch would get."""
    lobes = lobes_above(form, count)
    found: dict[str, list[Tensor]] = {"ball": [], "post": []}
    for index in range(lobes.count):
        lobe = lobes.select(torch.tensor([index]))
        made = sheets(lobe)
        facing = float(brute_force.irradiance_over_pi(lobe, UP[None], POINTS)[0, 0] * np.pi)
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
