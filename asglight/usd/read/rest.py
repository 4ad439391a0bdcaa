# SPDX-License-Identifier: Apache-2.0
"""Reading the rest of a keyed stage: the images of a dome, with what another program did to it.

Symbols: F frames; H, W rows and columns of an image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from pxr import Usd
from torch import Tensor

from asglight.errors import InputError
from asglight.images import ocio, read_latlong
from asglight.sphere import latlong
from asglight.usd import schema
from asglight.usd.check.references import may_open
from asglight.usd.read.edited_lights import dome_edits, upright
from asglight.usd.read.placement import Array, turn_words
from asglight.usd.read.view import View
from asglight.usd.stage import child_of, image_file, name_of

DARK = "switched off"


@dataclass(frozen=True)
class Rest:
    """The images of a rest.

    Attributes:
        stage: What to call the stage.
        times: Frame numbers.  F
        images: As USD resolves them, one a frame, "" where there is none to open; none at all where
            the rest is switched off.
        light: What their colours are multiplied by, matrices in Rec.709.  [F, 3, 3]
        turns: From their directions to asglight's, orthogonal, for row vectors.  [F, 3, 3]
        changes: What another program changed, one line each.
    """

    stage: str
    times: tuple[int, ...]
    images: tuple[str, ...]
    light: Array
    turns: Array
    changes: tuple[str, ...] = ()

    def image(self, place: int) -> str:
        """Return where the image of a frame is, of a rest that is not off.

        Raises:
            InputError: It is missing.
        """
        if not self.images[place]:
            raise InputError(
                f"{self.stage}: the image of the rest at frame {self.times[place]} is not there; "
                "expected the folder of images beside the stage. Copy it with the stage, or cut "
                "the keys anew: asglight keys STAGE --reference IMAGES."
            )
        return self.images[place]

    def radiance(self, place: int) -> Tensor:
        """Return the rest of a frame, in Rec.709 and with +Y up; black where it is off.  [H, W, 3].

        Args:
            place: Of the frame.

        Raises:
            InputError: Its image is missing, or cannot be read.
        """
        if not self.images:
            return torch.zeros(2, 4, 3)
        with image_file(self.image(place)) as path:
            image = read_latlong(path).radiance
        if turn_words(self.turns[place : place + 1]):
            image = turned_image(image, self.turns[place])
        return (image @ torch.from_numpy(self.light[place].T.copy()).to(image)).clamp(min=0)


def read_rest(view: View) -> Rest:
    """Read the rest of a rig that shows its keys."""
    stage, times = name_of(view.rig.GetStage()), view.times
    dome = child_of(view.rig, schema.REST)
    if not dome or not dome.IsActive():
        path = view.rig.GetPath().AppendChild(schema.REST)
        same = np.tile(np.eye(3), (len(times), 1, 1))
        return Rest(stage, times, (), same, same, (f"{path}: {DARK if dome else 'is gone'}",))
    edits = dome_edits(view, dome)
    turns = upright(dome)[:3, :3] @ edits.turns @ view.placement.to_world
    to_709 = ocio.matrix(view.colorspace, ocio.REC709)
    light = to_709 @ (edits.light[..., None] * np.linalg.inv(to_709))
    words = (f"{dome.GetPath()}: {', '.join(edits.words)}",) if edits.words else ()
    return Rest(stage, times, images_of(dome, times), light, turns, words)


def images_of(light: Usd.Prim, times: Sequence[int]) -> tuple[str, ...]:
    """Return a light's image at each frame; "" where there is none or it is not opened unasked."""
    attribute = light.GetAttribute(schema.TEXTURE)
    stage = Path(light.GetStage().GetRootLayer().realPath)
    found = []
    for time in times:
        asset = attribute.Get(time) if attribute else None
        # a damaged crate may hold a value of another type than it declares
        path = getattr(asset, "resolvedPath", "")
        found.append(path if path and may_open(stage, path) else "")
    return tuple(found)


def turned_image(image: Tensor, turn: Array) -> Tensor:
    """Turn a map, interpolated linearly between texel centres.

    Args:
        image: [H, W, 3]
        turn: From its directions to those of the result, for row vectors.  [3, 3]

    Returns:
        [H, W, 3]
    """
    height, width = image.shape[:2]
    seen = latlong.directions(height, width, dtype=torch.float64) @ torch.from_numpy(turn.copy()).mT
    u, v = latlong.uv_from_direction(seen)
    row, column = (v * height - 0.5).clamp(0, height - 1), u * width - 0.5
    above, left = row.floor().long(), column.floor().long()
    down, right = (row - above)[..., None].float(), (column - left)[..., None].float()
    below, left = (above + 1).clamp(max=height - 1), left % width
    beside = (left + 1) % width
    upper = torch.lerp(image[above, left], image[above, beside], right)
    return torch.lerp(upper, torch.lerp(image[below, left], image[below, beside], right), down)
