# SPDX-License-Identifier: Apache-2.0
"""The built-in sun is one track, before, behind and after its cloud."""

import torch

from asglight.fitting.options import FitOptions, Preset
from asglight.judging.following import follow, refined
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.identity.main_tracks import kept_on_lamps
from asglight.sky import SkyConfig, radiance
from asglight.sky.environment import sun_map
from asglight.sphere import latlong

ROWS, LOBES = 64, 12
NEAR_DEG = 4.0
"""One and a half texels: a lobe of a sun of one texel, dimmed by a cloud, is no nearer for sure."""

FIRST = 2
"""The low sun turns by 5 degrees between the frames that are taken, every second one: tracks are
judged from the third on, eleven before the cloud."""

BARE_SUN = SkyConfig(frames=tuple(range(1001, 1049, 2)), cloud_depth=0.0, lamps=())


def one_track(shot: Lobes, sun: torch.Tensor) -> bool:
    """Tell whether one of the tracks is at the sun in every frame.  sun: [F, 3]."""
    cosine = (shot.axis_z * sun[:, None]).sum(-1).clamp(-1, 1)
    there = (torch.rad2deg(cosine.acos()) < NEAR_DEG) & (shot.amplitude > 0).any(-1)
    return bool(there.all(0).any())


def test_the_sun_is_one_track_before_behind_and_after_its_cloud() -> None:
    demo = SkyConfig(frames=BARE_SUN.frames)
    maps = [radiance(demo, frame, ROWS) for frame in demo.frames]
    brightest = [int(sun_map(BARE_SUN, frame, ROWS).sum(-1).argmax()) for frame in BARE_SUN.frames]
    sun = latlong.directions(ROWS, 2 * ROWS).view(-1, 3)[brightest]
    found, seconds = follow(maps, FitOptions(LOBES, Preset.FAST))
    fitted = stack(refined(maps, found, seconds, Preset.FAST)[0])
    after = slice(FIRST, None)
    assert one_track(kept_on_lamps(fitted)[after], sun[after])
