# SPDX-License-Identifier: Apache-2.0
"""The stage that is edited, as it is on disk, and what its attributes are there."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Sdf, Usd
from torch import Tensor

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.lights import cards
from asglight.usd.read.placement import placement_of
from asglight.usd.read.read_options import (
    dome_images,
    fill_images,
    options_of,
    shown_kinds,
    shown_threefold,
)
from asglight.usd.read.tracks import read_stage
from asglight.usd.schema import Representation
from asglight.usd.stage import lobe_prims, numbers, open_rig, readable, show


@dataclass(frozen=True)
class AttributeTrack:
    """What an attribute should be at every frame, and between.

    Attributes:
        path: The attribute in the layer, with its variant.
        representation: Whose light it is of; None for the lobe itself.
        values: One value a time.  [T, K]
        times: All frames, and some between.  [T]
        tolerance: Relative error of a sample left out.
    """

    path: Sdf.Path
    representation: Representation | None
    values: Tensor
    times: NDArray[np.float64]
    tolerance: float


class EditedStage:
    """The stage that was edited, as it is on disk.

    Attributes:
        path: The stage.
        stage: Its composition; which representation it shows changes as it is read.
        rig: The prim that holds the lobes.
        tracks: Its lobes, those that are muted as they would light.
        muted: Indices of the muted ones.
        options: How it was written.
        placement: How the rig stands in the stage.
        kinds: What each lobe is in its cards; none without cards.
        threefold: Which lobes have three distant lights; none without such.
        images: Those of its dome and of its fill that are there, as USD resolves them.
    """

    def __init__(self, path: Path) -> None:
        """Read the stage.

        Raises:
            InputError: There is no such stage, it holds no lobes, or a value is damaged.
        """
        self.path = path
        reading = read_stage(path)
        self.tracks, self.muted = reading.unmuted, reading.muted
        self.stage, self.rig = open_rig(path)
        self.stage.SetEditTarget(self.stage.GetSessionLayer())
        self.options = options_of(self.rig)
        self.kinds = shown_kinds(self.rig)
        self.threefold = shown_threefold(self.rig)
        self.images = dome_images(self.rig) + fill_images(self.rig)
        with readable(path):
            self.placement = placement_of(self.rig, self.tracks.frames)
        fault = None
        if self.rig.IsInstance() or self.rig.IsInstanceProxy():
            fault = "is an instance, in which USD heeds no edit"
        elif self.placement.is_stretched:
            fault = "is scaled unevenly, so that its lights are not those of its lobes"
        if fault is not None:
            raise InputError(
                f"{shown(path)}: {self.rig.GetPath()} {fault}; expected a rig that can be edited. "
                f"Edit the stage that holds it."
            )

    def kinds_of(self, lobes: Collection[int]) -> list[cards.Kind]:
        """Return what some lobes are in the cards; none for a stage without them."""
        return [self.kinds[index] for index in lobes] if self.kinds else []

    def unmuted(self, tracks: LobeTracks, edited: Collection[int]) -> LobeTracks:
        """Return tracks with the light of the muted lobes that were not edited."""
        chosen = torch.tensor(sorted(self.muted - set(edited)), dtype=torch.long)
        if tracks.lobes.count < self.tracks.lobes.count or not len(chosen):
            return tracks
        lobes = tracks.lobes.replaced(chosen, self.tracks.lobes.select(chosen))
        return replace(tracks, lobes=lobes)

    @property
    def lobe_paths(self) -> list[Sdf.Path]:
        """The prims of the lobes."""
        return [prim.GetPath() for prim in lobe_prims(self.rig)]

    def values(self, track: AttributeTrack) -> NDArray[np.float64] | None:
        """Return what an attribute is at every frame, or None where it has no value.  [F, K]."""
        if track.representation is not None:
            show(self.rig, track.representation)  # in memory only
        attribute = self.stage.GetAttributeAtPath(track.path.StripAllVariantSelections())
        kind = schema.VALUE_TYPES[track.path.name]
        if not attribute or attribute.GetTypeName() != kind:
            return None
        query = Usd.AttributeQuery(attribute)
        values = [query.Get(frame) for frame in self.tracks.frames]
        return None if None in values else numbers(values, kind)
