# SPDX-License-Identifier: Apache-2.0
"""The built-in moving environment: sun, sky, a cloud and two lamps, in closed form."""

from asglight.sky.environment import Lamp, SkyConfig, radiance

__all__ = ["Lamp", "SkyConfig", "radiance"]
