# SPDX-License-Identifier: Apache-2.0
"""Images of keys and rest as files.

Symbols: H, W rows and columns.
"""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from asglight.images import ocio, write_exr
from asglight.images.exr_writer import HALF_MAX
from asglight.sphere import latlong
from asglight.usd.spaces import Space

HALF_FLUX_ERROR = 2e-5
"""Of a channel, by rounding to half floats, up to which a rest is written in them: a fifth of what
keys and rest together may be off."""


@dataclass(frozen=True)
class Target:
    """Where images go, and in which colours.

    Attributes:
        folder: Where.
        stem: Of the names: `<stem>.rest.<frame>.exr` and `<stem>.<key>.<frame>.exr`.
        space: Of the stage's colours.
    """

    folder: Path
    stem: str
    space: Space

    def path(self, name: str) -> Path:
        """Return where the image of a name goes."""
        return self.folder / f"{self.stem}.{name}.exr"

    def write(self, name: str, radiance: Tensor, *, latlong: bool) -> Path:
        """Write an image, in half floats where they hold its light.

        Args:
            name: What follows the stem, without the extension.
            radiance: In Rec.709; a texture has no colours of its own.  [H, W, 3]
            latlong: Whether it is a map.
        """
        path = self.path(name)
        values = self._in_space(radiance) if latlong else radiance
        write_exr(
            path,
            values,
            half=_half_holds(values) if latlong else _half_means(values),
            chromaticities=ocio.chromaticities(self.space.colorspace) if latlong else None,
            latlong=latlong,
        )
        return path

    def _in_space(self, radiance: Tensor) -> Tensor:
        if self.space.colorspace == ocio.REC709:
            return radiance
        matrix = torch.from_numpy(ocio.matrix(ocio.REC709, self.space.colorspace)).float()
        return (radiance @ matrix.T).clamp(min=0)


def _half_holds(radiance: Tensor) -> bool:
    """Tell whether half floats keep the flux of every channel of a map."""
    if float(radiance.max()) > HALF_MAX:
        return False
    solid = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)[..., None]
    flux = (radiance.double() * solid).sum((0, 1))
    rounded = (radiance.half().double() * solid).sum((0, 1))
    return bool(((rounded - flux).abs() <= HALF_FLUX_ERROR * flux).all())


def _half_means(image: Tensor) -> bool:
    """Tell whether half floats keep the mean of every channel of a texture."""
    if float(image.max()) > HALF_MAX:
        return False
    mean, rounded = (one.double().mean((0, 1)) for one in (image, image.half()))
    return bool(((rounded - mean).abs() <= HALF_FLUX_ERROR * mean).all())
