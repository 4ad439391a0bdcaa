# SPDX-License-Identifier: Apache-2.0
"""The orbit camera, and how the environment is turned against it."""

import math
from dataclasses import dataclass

import numpy as np

PITCH_MAX_DEG = 89.0
"""The camera stops short of the poles, where "up" has no meaning."""

ORBIT_DEG_PER_POINT = 0.4
"""Degrees for one point of a drag: a turn takes a drag over a usual window's width."""


@dataclass
class Camera:
    """A camera far away that looks at the balls, and the environment around both.

    Attributes:
        yaw_deg: Degrees around +Y; 0 looks from +Z, 90 from +X.
        pitch_deg: Degrees above the horizon, within +-PITCH_MAX_DEG.
        environment_deg: How far the environment is turned around +Y.
    """

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    environment_deg: float = 0.0

    def orbit(self, right: float, down: float) -> None:
        """Turn with a drag of so many points: the balls' surface follows the pointer."""
        self.yaw_deg = _wrapped(self.yaw_deg - ORBIT_DEG_PER_POINT * right)
        wanted = self.pitch_deg + ORBIT_DEG_PER_POINT * down
        self.pitch_deg = max(-PITCH_MAX_DEG, min(PITCH_MAX_DEG, wanted))

    def turn_environment(self, degrees: float) -> None:
        """Turn the environment around +Y."""
        self.environment_deg = _wrapped(self.environment_deg + degrees)

    def reset(self) -> None:
        """Look from +Z at the environment as it is."""
        self.yaw_deg = self.pitch_deg = self.environment_deg = 0.0

    def from_environment(self) -> np.ndarray:
        """Return the rotation from the environment's coordinates to the camera's.

        Returns:
            Rows right, up, towards the camera.  [3, 3]
        """
        yaw, pitch = math.radians(self.yaw_deg), math.radians(self.pitch_deg)
        towards = np.array(
            [math.cos(pitch) * math.sin(yaw), math.sin(pitch), math.cos(pitch) * math.cos(yaw)]
        )
        right = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
        return np.stack([right, np.cross(towards, right), towards]) @ _turn(self.environment_deg)


def _turn(degrees: float) -> np.ndarray:
    """Return the rotation around +Y that takes +Z towards +X.  [3, 3]."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


def _wrapped(degrees: float) -> float:
    """Return the same angle in [-180, 180)."""
    return (degrees + 180.0) % 360.0 - 180.0
