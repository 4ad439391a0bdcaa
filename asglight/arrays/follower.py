# SPDX-License-Identifier: Apache-2.0
"""A live feed: one frame in, its lobes out."""

from typing import Any

import torch

from asglight.arrays.radiance import prepared
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import Following
from asglight.images.options import LOST_MAX, ReadOptions
from asglight.images.repair import Repair
from asglight.lobes import Lobes
from asglight.lobes.data import lobe_names
from asglight.lobes.frames import align
from asglight.shots.settings import check_options


class Follower:
    """Fits frames as they come, each from the two before, with the preset `live`.

    The lobes of a frame are there when its call returns: none waits for a later one. The first
    frame is fitted from nothing and takes many times as long as the others.

    There are two tracks for each lobe, and half of them are lit at most. A track is the same light
    as long as it is lit; one that was dark may come back as another.

    Examples:
        >>> follower = asglight.Follower(lobes=2)
        >>> for radiance in camera:  # [H, 2 H, 3] each, numpy or torch
        ...     lobes = follower.follow(radiance)
        >>> follower.frames
        2

    Attributes:
        names: Of the tracks, for good.
        frames: How many frames were taken.
        lobes: Those of the newest frame; None before the first.
        repair: What was changed in the newest frame; None before the first.
    """

    def __init__(
        self, lobes: int | None = None, *, device: str = "cpu", repair: float = LOST_MAX
    ) -> None:
        """Begin before the first frame.

        Args:
            lobes: Lit at a time, at most (None: 15).
            device: Where torch computes: `cpu`, `cuda`, `cuda:1`.
            repair: Share of a frame's light or texels that may be lost to values that are no light.

        Raises:
            InputError: A setting cannot be used.
        """
        options = FitOptions(lobes, Preset.LIVE, device=device, moving=True)
        check_options(options)
        ReadOptions(repair=repair).check()
        self.frames = 0
        self.names: tuple[str, ...] = ()
        self.lobes: Lobes | None = None
        self.repair: Repair | None = None
        self._device, self._share = device, repair
        self._following = Following(options)

    def follow(self, radiance: Any) -> Lobes:
        """Take the next frame and return its lobes.

        Args:
            radiance: Linear Rec.709, row 0 = +Y; numpy or torch.  [H, 2 H, 3]

        Returns:
            Float32 lobes on the CPU, as many in every frame, in the order of `names`; black ones
            send no light. Axes turn on from the frame before.  [N, .]

        Raises:
            InputError: It is no latlong, lost too much, or is too bright; the follower stays as it
                was and takes the next one.
        """
        frame = prepared(radiance, self._share, f"frame {self.frames}")
        self._following.take(frame.radiance.to(self._device))
        fit = self._following.last
        assert fit is not None
        found = fit.lobes.to("cpu", torch.float32)
        if self.lobes is not None:
            found = align(found, self.lobes)
        self.names = self.names or lobe_names(found.count)
        self.frames += 1
        self.lobes, self.repair = found, frame.repair
        return self.lobes

    def __repr__(self) -> str:
        """Say how far it is."""
        lit = 0 if self.lobes is None else int((self.lobes.amplitude > 0).any(-1).sum())
        return f"<Follower: {self.frames} frames, {lit} of {len(self.names)} tracks lit>"
