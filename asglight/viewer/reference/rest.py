# SPDX-License-Identifier: Apache-2.0
"""The rest of a keyed stage at the frames of the timeline, and the lobes that keys stand in for."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from asglight.lobes import LobeTracks
from asglight.sphere import latlong
from asglight.usd.read.rest import Rest
from asglight.viewer.reference.images import BYTE_BUDGET, HEIGHT_MAX, Reference
from asglight.viewer.state.held import Held


@dataclass
class Keyed:
    """What a stage shows beside its keys.

    Attributes:
        rest: The images without the lamps, an image a frame.
        lobes: Those of the stage; they do not light, for keys and rest do.
    """

    rest: Reference
    lobes: LobeTracks

    def close(self) -> None:
        """End the decoding threads."""
        self.rest.close()


def open_rest(rest: Rest) -> Reference:
    """Open the images of a rest; they are read when they are wanted."""
    places = {frame: place for place, frame in enumerate(rest.times)}

    def read(frame: int) -> np.ndarray:
        radiance = rest.radiance(places[frame])
        if len(radiance) > HEIGHT_MAX:
            radiance = latlong.reduce(radiance, HEIGHT_MAX, 2 * HEIGHT_MAX)
        return radiance.contiguous().numpy()

    files = sorted({Path(image) for image in rest.images if image})
    return Reference("the rest", rest.times, read, files=files, byte_budget=BYTE_BUDGET // 2)


@lru_cache(maxsize=2)
def energy_of(radiance: Held[np.ndarray]) -> float:
    """Return the flux of a map, channels summed, as `picking.energies` counts that of keys."""
    return float(flux_of(radiance.value).to(torch.float64).sum())


def flux_of(radiance: np.ndarray) -> torch.Tensor:
    """Return radiance times solid angle of a map, a sum a channel.  [H, W, 3] -> [3]."""
    solid_angle = latlong.texel_solid_angles(*radiance.shape[:2])
    return torch.einsum("hwc,hw->c", torch.from_numpy(radiance), solid_angle)
