# SPDX-License-Identifier: Apache-2.0
"""What the keys and the rest of a stage show together, as a map: judged as a fit is."""

from pathlib import Path

import torch
from torch import Tensor

from asglight.images.decoding.decode import read_header
from asglight.images.decoding.strips import read_pixels
from asglight.judging.keyed import gathered
from asglight.lobes import asg
from asglight.sphere import latlong
from asglight.usd.lights import cards
from asglight.usd.options import KeyLights
from asglight.usd.read.keys import HeldKeys, held_keys
from asglight.usd.schema import Representation
from asglight.usd.stage import image_file, representations_of


def shown_keys(path: str | Path, rig: str | None = None) -> HeldKeys | None:
    """Read the keys of a stage that opens with them as rectangles; None of any other stage.

    Keys as distant lights have no picture that could be held against an image.

    Raises:
        InputError: There is no such stage, or a value is damaged.
    """
    shows, _ = representations_of(path, rig)
    held = held_keys(path, rig) if shows == Representation.KEYS else None
    return held if held is not None and held.lights is KeyLights.RECT else None


def shown_map(held: HeldKeys, frame: int, height: int, width: int) -> Tensor:
    """Return the mean radiance over each texel that keys and rest show.

    Args:
        held: Of a stage.
        frame: Frame number.
        height: Rows.
        width: Columns.

    Returns:
        [H, W, 3]

    Raises:
        InputError: An image is missing, or cannot be read.
    """
    place = held.keys.times.index(frame)
    found = latlong.reduce(held.keys.rest.radiance(place), height, width).clone()
    if held.keys.tracks is None:
        return found
    keys = held.keys.tracks.at(frame).to("cpu", torch.float64)
    every, flux = cards.rectangles_of(keys), asg.flux(keys)
    for index, paths in enumerate(held.textures):
        if bool((flux[index] > 0).any()):
            image = _texture(paths[place]) if paths else None
            found += gathered(every[index], flux[index], image, height, width)
    return found


def _texture(resolved: str) -> Tensor:
    with image_file(resolved) as path:
        return torch.from_numpy(read_pixels(read_header(path)))
