# SPDX-License-Identifier: Apache-2.0
"""Keys and rest of a stage as the numbers that engines are given."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from asglight.errors import InputError
from asglight.images.message import shown

if TYPE_CHECKING:
    from asglight.cli.progress import Reporter
    from asglight.export.keyed import KeyedLight


def keyed_light(
    stage: str | Path, rig: str | None, frames: Sequence[int], report: "Reporter"
) -> "KeyedLight | None":
    """Return keys and rest of some frames of a stage; None where it has no keys.

    Args:
        stage: The stage.
        rig: Prim that holds the lobes, of a stage with several.
        frames: Frame numbers.
        report: Shows how far the images of the rest are read.

    Raises:
        InputError: An image of the rest is missing, or shows something else than the rest that the
            stage shows.
    """
    from asglight.export.keyed import KeyedLight, irradiance_terms
    from asglight.lobes import asg
    from asglight.usd import read_keys
    from asglight.usd.lights import cards
    from asglight.usd.read.placement import turn_words

    keys = read_keys(stage, rig)
    if keys is None:
        return None
    turns = [f"the rest is {word}" for word in turn_words(keys.rest.turns)]
    changes = [*keys.rest.changes, *turns]
    if changes:
        raise InputError(
            f"{shown(stage)}: {changes[0]}, which the images of the rest do not show; expected the "
            "rest as it was written. Undo that in the layer that changed it."
        )
    places = [keys.times.index(frame) for frame in frames]
    numbers = [
        irradiance_terms(keys.rest.radiance(place))
        for place in report.follow(places, "rest", len(places))
    ]
    tracks, half_sizes = keys.tracks, torch.empty(len(keys.times), 0, 2)
    if tracks is not None:
        squares = cards.mean_squares(asg.moments(tracks.lobes.to(torch.float64)))
        half_sizes = cards.half_extent(squares)
    images = keys.rest.images
    whole = KeyedLight(tracks, half_sizes, keys.times, keys.fps, images, torch.empty(0))
    return whole.of_frames(places, torch.stack(numbers))
