# SPDX-License-Identifier: Apache-2.0
"""A stage between its frames: what a program interpolates there, and how many samples say it."""

from collections.abc import Sequence
from pathlib import Path

import torch
from pxr import Sdf, Usd

from asglight.images import ocio
from asglight.lobes import Lobes
from asglight.usd.read.edited_lights import hidden_lobes
from asglight.usd.read.placement import placement_of, turned_or_mirrored
from asglight.usd.read.times import frame_numbers
from asglight.usd.read.tracks import darkened, lobes_at
from asglight.usd.spaces import in_colorspace, space_of
from asglight.usd.stage import lobe_prims, name_of, open_rig, readable


def read_between(
    path: str | Path | Usd.Stage, times: Sequence[float], rig: str | None = None
) -> Lobes:
    """Read the lobes of a stage at any times, as a program reads them.

    Each of their own attributes is what USD interpolates; edits of lights do not count, but for a
    lobe that is invisible: it is black.

    Args:
        path: The stage.
        times: Time codes; fractions lie between frames.
        rig: Path of the prim that holds the lobes, of a stage with several.

    Returns:
        float32 lobes on the CPU, with +Y up and in Rec.709.  [T, N, .]

    Raises:
        InputError: As `read_usd`.
    """
    stage, prim = open_rig(path, rig)
    with readable(path):
        prims = lobe_prims(prim)
        lobes = lobes_at(name_of(path), prims, list(times))
        hidden, _ = hidden_lobes(prims, tuple(times))
        placement = placement_of(prim, tuple(times))
        lobes = turned_or_mirrored(lobes.to(torch.float64), placement.to_world)
        lobes = in_colorspace(lobes, space_of(prim).colorspace, ocio.REC709).to(torch.float32)
    del stage  # kept until here: the rig dies with it
    return darkened(lobes, hidden)


def samples_between(path: str | Path | Usd.Stage, rig: str | None = None) -> int:
    """Return how many time samples of a stage's layers lie between its frames.

    Raises:
        InputError: As `read_usd`.
    """
    stage, prim = open_rig(path, rig)
    with readable(path):
        frames = set(frame_numbers(stage, prim, lobe_prims(prim)))
        return sum(_samples_beside(layer, frames) for layer in stage.GetUsedLayers())


def _samples_beside(layer: Sdf.Layer, frames: set[int]) -> int:
    """Count the samples of a layer at other times than the frames; in all variants."""
    count = 0

    def visit(path: Sdf.Path) -> None:
        nonlocal count
        if path.IsPropertyPath():
            count += len(set(layer.ListTimeSamplesForPath(path)) - frames)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return count
