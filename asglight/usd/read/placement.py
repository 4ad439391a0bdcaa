# SPDX-License-Identifier: Apache-2.0
"""How a rig stands in the shot that a stage is: turned, mirrored, scaled, and under which up axis.

asglight has +Y up. Which way is up in a shot its own `upAxis` says, whatever the layer of the rig
says: USD composes it across no arc. So a rig that was written with +Y up and stands in a shot with
+Z up is on its side, unless it is turned there.

A light that is far has a direction and a size, and no place. So a lobe is turned and mirrored as
its rig is; a scale alike in all directions changes nothing that is seen from the rig's origin, and
so does a unit. A rig scaled unevenly has cards that are seen stretched (held_lights.py); its lobes
take the nearest turn.

Dimension letters: F frames, N lobes. Matrices are for row vectors.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from asglight.lobes import Lobes, LobeTracks
from asglight.lobes.rectangles import mirrored_slant
from asglight.usd.spaces import from_y_up, space_of
from asglight.usd.stage import DamagedValueError

TURNED_DEG = 0.01
"""Of a transform that is not the authored one: float32 matrices keep a hundredth of that."""

STRETCHED = 1e-3
"""Relative difference of the scales along two axes that counts: nobody sees a size change less."""

VOLUME_MIN = 1e-30
"""Of the unit cube under a transform: smaller ones have no direction that float64 can tell."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """Where a rig stands.

    Attributes:
        origins: Of the rig in the stage.  [F, 3]
        turns: From the rig to the stage, orthogonal; a mirrored rig has determinant -1.  [F, 3, 3]
        scales: Geometric means of the scales along three axes.  [F]
        is_stretched: Whether the scales differ in any frame.
        written_up: The axis that was up when the rig was written.
        shot_up: The axis that is up in the stage.
        states_up: Whether the stage says so; USD takes its usual axis where it does not.
    """

    origins: Array
    turns: Array
    scales: Array
    is_stretched: bool
    written_up: str
    shot_up: str
    states_up: bool

    @property
    def to_world(self) -> Array:
        """Return the turns from directions of the rig to asglight's, with +Y up.  [F, 3, 3]."""
        return self.turns @ from_y_up(self.shot_up).T

    @property
    def net(self) -> Array:
        """Return the turns from the light that was written to the one that is met.  [F, 3, 3]."""
        return from_y_up(self.written_up) @ self.to_world

    @property
    def is_plain(self) -> bool:
        """Tell whether the light is met as it was written."""
        return not self.is_stretched and not turn_words(self.net)

    def relative(self, matrices: Array) -> Array:
        """Return matrices of the stage as seen from the rig, were it neither turned nor scaled.

        Args:
            matrices: Of prims, one a frame.  [F, 4, 4]

        Returns:
            What the images of the axes and the place are in the rig.  [F, 4, 3]
        """
        rows = matrices[:, :, :3].copy()
        rows[:, 3] -= self.origins
        return rows @ np.swapaxes(self.turns, -1, -2) / self.scales[:, None, None]

    def words(self) -> list[str]:
        """Say how the light differs from the one that was written."""
        words = [f"{word} with all its lobes" for word in turn_words(self.net)]
        if words and self.shot_up != self.written_up:
            shot = f"is {self.shot_up}-up" + ("" if self.states_up else ", as it states no upAxis")
            words[-1] += f" (it was written {self.written_up}-up, and the shot {shot})"
        return words


def placement_of(rig: Usd.Prim, times: tuple[float, ...]) -> Placement:
    """Find how a rig stands at every frame.

    Raises:
        DamagedValueError: Its transform has no extent, or is not finite.
    """
    matrices = world_matrices(rig, times)
    left, scales, right = np.linalg.svd(_checked(rig, matrices[:, :3, :3], times))
    spread = scales.max(-1) / scales.min(-1)
    return Placement(
        origins=matrices[:, 3, :3],
        turns=left @ right,
        scales=np.cbrt(scales.prod(-1)),
        is_stretched=bool((spread > 1 + STRETCHED).any()),
        written_up=space_of(rig).up_axis,
        shot_up=str(UsdGeom.GetStageUpAxis(rig.GetStage())),
        states_up=rig.GetStage().HasAuthoredMetadata(UsdGeom.Tokens.upAxis),
    )


def _checked(rig: Usd.Prim, linear: Array, times: tuple[float, ...]) -> Array:
    volume = np.abs(np.linalg.det(linear))
    flat = np.flatnonzero(~((volume >= VOLUME_MIN) & np.isfinite(volume)))
    if len(flat):
        frame = times[int(flat[0])]
        raise DamagedValueError(f"{rig.GetPath()} has no extent, or no end, at frame {frame}")
    return linear


def world_matrices(prim: Usd.Prim, times: tuple[float, ...]) -> Array:
    """Return the transform of a prim to the stage at every frame.  [F, 4, 4]."""
    cache, found = UsdGeom.XformCache(), []
    for time in times:
        cache.SetTime(time)
        found.append(np.array(cache.GetLocalToWorldTransform(prim)))
    return np.stack(found)


def turned_or_mirrored(lobes: Lobes, turns: Array) -> Lobes:
    """Turn lobes; a turn of determinant -1 mirrors them.

    Every form is the same when its y axis is reversed, so the mirror image of a lobe is the lobe
    whose frame is made right-handed so.

    Args:
        lobes: Lobes of F frames.  [F, N, .]
        turns: Orthogonal.  [F, 3, 3]
    """
    matrices = torch.from_numpy(turns).to(lobes.axes)
    axes = lobes.axes @ matrices[:, None]
    hand = torch.from_numpy(np.sign(np.linalg.det(turns))).to(axes)
    one = torch.ones_like(hand)
    axes = axes * torch.stack([one, hand, one], -1)[:, None, :, None]
    return replace(lobes, axes=axes, slant=mirrored_slant(lobes.slant, hand[:, None]))


def as_written(tracks: LobeTracks, placement: Placement) -> LobeTracks:
    """Return the tracks that a rig so placed has to be written with, undoing its placement."""
    if placement.is_plain:
        return tracks
    back = np.swapaxes(placement.net, -1, -2)
    lobes = turned_or_mirrored(tracks.lobes.to("cpu", torch.float64), back)
    return replace(tracks, lobes=lobes.to(torch.float32))


def turn_words(turns: Array) -> list[str]:
    """Say how far turns go; nothing where they go nowhere.  [F, 3, 3]."""
    if (np.linalg.det(turns) < 0).any():
        return ["mirrored"]
    cosine = (np.trace(turns, axis1=1, axis2=2) - 1) / 2
    degrees = math.degrees(math.acos(float(np.clip(cosine.min(), -1, 1))))
    return [f"turned by {degrees:.3g} degrees"] if degrees > TURNED_DEG else []
