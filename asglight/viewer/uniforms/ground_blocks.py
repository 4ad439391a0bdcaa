# SPDX-License-Identifier: Apache-2.0
"""The scene on the ground, and what shaders/ground.frag needs of lobes, laid out as its block.

Ground frame: +Y up, +Z level towards the camera, the ball on the ground under the origin.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from asglight.shading import occlusion, rectified
from asglight.shading.sheets import Sheets

BALL = (0.0, 1.0, 0.0)
"""Centre of the ball, whose radius is 1."""

POST_AWAY = 1.9
"""From the ball's axis to the post's: their shadows are apart."""

POST = (0.1, 2.4)
"""Radius and height of the post."""

POST_TURN_DEG = 25.0
"""How far behind the ball's right the post stands, when the camera is at rest."""

FOCUS = (0.45, 0.75, 0.0)
"""What the middle of the picture shows."""

UNITS_HIGH, UNITS_WIDE = 4.6, 6.5
"""Radii of the ball in the height of the picture at least, and in its width."""

BASE = (0.5, 0.5, 0.5)
"""Diffuse reflectance of ground and post: light concrete."""

PITCH_DEG = 22.0
"""How far above the horizon the camera is when it looks level at the row of balls."""

PITCH_MIN_DEG = 6.0
"""Lower, the ground would be seen from its edge."""

UNSEEN = 1e-4
"""Share of all irradiance below which a sheet is left out: it could not be seen in 8 bits."""

SHEET = np.dtype(
    [
        ("axis_x", "<f4", 3),
        ("disc_variance_x", "<f4"),
        ("axis_y", "<f4", 3),
        ("disc_variance_y", "<f4"),
        ("light", "<f4", 3),
        ("mean", "<f4"),
        ("variance", "<f4"),
        ("gaussian", "<f4"),
        ("inverse_lit", "<f4"),
        ("variance_y", "<f4"),
    ]
)


@dataclass(frozen=True)
class GroundView:
    """How the scene lies in a picture.

    Attributes:
        pitch: Of the camera above the ground, radians.
        unit: Pixels of the ball's radius.
        middle: Pixel that shows FOCUS.
        foot: Of the post, ground frame.  [3]
    """

    pitch: float
    unit: float
    middle: tuple[float, float]
    foot: tuple[float, float, float]

    @property
    def ball_cell(self) -> tuple[int, int, int]:
        """The square that holds the ball: left column, top row, size in pixels."""
        x, y, z = (b - f for b, f in zip(BALL, FOCUS, strict=True))
        up = y * math.cos(self.pitch) - z * math.sin(self.pitch)
        size = max(2, round(2 * self.unit))
        return (
            round(self.middle[0] + x * self.unit - size / 2),
            round(self.middle[1] - up * self.unit - size / 2),
            size,
        )


def ground_view(size: tuple[int, int], yaw_deg: float, pitch_deg: float) -> GroundView:
    """Place the scene in a picture.

    Args:
        size: Columns and rows.
        yaw_deg: Of the camera around +Y; the post goes round the other way.
        pitch_deg: Of the camera, as for the row of balls.
    """
    columns, rows = size
    pitch = math.radians(min(max(pitch_deg + PITCH_DEG, PITCH_MIN_DEG), 89.0))
    turn = math.radians(POST_TURN_DEG + yaw_deg)
    foot = (POST_AWAY * math.cos(turn), 0.0, -POST_AWAY * math.sin(turn))
    unit = min(rows / UNITS_HIGH, columns / UNITS_WIDE)
    return GroundView(pitch, unit, (columns / 2, rows / 2), foot)


def packed_ground(made: Sheets, light: Tensor, normal: Tensor | None) -> np.ndarray:
    """Lay sheets out as GroundBlock (std140).

    Args:
        made: M sheets in the ground frame.
        light: Their amplitudes.  [M, 3]
        normal: Of the surface, [3]; those that light it not at all are left out. None for a
            surface whose normal changes: light is then that of a sheet that it faces, and the
            moments are those of x, y and z.

    Returns:
        An array of SHEET of those that light.
    """
    facing = light * made.integral[:, None] / math.pi
    lit = torch.ones_like(made.integral)
    mean, variance = made.mean, made.variance[:, 2]
    if normal is not None:
        means, deviations = rectified.cosine(made.over_points(), normal[None])
        mean, variance = means[:, 0], deviations[:, 0].square()
        lit = rectified.rectified(mean, rectified.widened(deviations[:, 0])).mean
    block = np.zeros(len(lit), SHEET)
    block["axis_x"], block["axis_y"] = made.axes[:, 0], made.axes[:, 1]
    disc = occlusion.disc_variance(made)
    block["disc_variance_x"], block["disc_variance_y"] = disc.T
    block["light"] = facing * lit[:, None]
    block["mean"], block["variance"] = mean, variance
    block["gaussian"] = 2 * math.pi * disc.prod(-1).sqrt() / made.integral
    block["inverse_lit"] = 1 / lit.clamp(min=occlusion.LIGHT_MIN)
    if normal is None:
        block["inverse_lit"], block["variance_y"] = made.variance[:, 0], made.variance[:, 1]
    total = np.abs(block["light"]).sum()
    return block[np.abs(block["light"]).sum(-1) > UNSEEN * total]
