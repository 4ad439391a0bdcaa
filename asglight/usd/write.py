# SPDX-License-Identifier: Apache-2.0
"""Writing lobe tracks as a USD stage with three representations."""

import math
from pathlib import Path

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.usd import dome, layer, staging
from asglight.usd.checks import check_target, check_tracks
from asglight.usd.lint import lint_stage
from asglight.usd.schema import Representation
from asglight.usd.spaces import UP_AXES, Space
from asglight.usd.staging import WriteReport


def write_usd(
    tracks: LobeTracks,
    path: str | Path,
    *,
    representation: Representation | str = Representation.CARDS,
    distance: float = 1000.0,
    dome_height: int = dome.HEIGHT,
    meters_per_unit: float = 1.0,
    up_axis: str = "Y",
) -> WriteReport:
    """Write tracks as one stage that holds cards, distant lights and a dome as variants.

    The dome's images go to the folder `<stem>_dome` beside the stage, `<stem>.<frame>.exr`; tracks
    that never change have one. Images of an earlier, longer write stay where they are.

    Args:
        tracks: Lobes of F frames; metadata of JSON values, which come back as JSON gives them.
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates.
        representation: The variant that the stage shows: `cards`, `distant` or `dome`.
        distance: Of the cards from the origin, in stage units.
        dome_height: Rows of the dome's images; there are twice as many columns.
        meters_per_unit: Length of a stage unit.
        up_axis: Of the stage: `Y` or `Z`. `read_usd` turns the lobes back to +Y up.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights, an option is out of range, or nothing can be
            written there.
    """
    path = Path(path)
    _check_options(representation, distance, dome_height, meters_per_unit, up_axis)
    check_tracks(tracks)
    check_target(path)
    with staging.staged(path) as place:
        textures = staging.write_dome(tracks, place, dome_height)
        placement = layer.Placement(
            Representation(representation),
            distance,
            meters_per_unit,
            staging.relative_names(textures),
            Space(up_axis),
        )
        built, author = layer.build(tracks, placement)
        staging.export(built, place)
        findings = lint_stage(place)
        if findings:
            raise RuntimeError(f"the stage breaks its own contract: {findings}")
        return staging.move_into_place(place, path, textures, author)


def _check_options(
    representation: str, distance: float, dome_height: int, meters_per_unit: float, up_axis: str
) -> None:
    if representation not in set(Representation):
        known = ", ".join(Representation)
        raise InputError(f"representation: {representation!r}; expected one of {known}.")
    for name, value in (("distance", distance), ("meters_per_unit", meters_per_unit)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: {value}; expected a finite number above 0.")
    if dome_height < 2:
        raise InputError(f"dome_height: {dome_height}; expected 2 rows or more.")
    if up_axis not in UP_AXES:
        raise InputError(f"up_axis: {up_axis!r}; expected one of {', '.join(UP_AXES)}.")
