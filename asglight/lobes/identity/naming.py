# SPDX-License-Identifier: Apache-2.0
"""Names of lobes: sorted by energy once, then kept.

Lights are linked, muted and overridden by name, so a name must mean the same light when a shot is
fitted again. Lobes of a first fit are named by their flux over the shot, the largest first. Those
of a later fit take the name of the lobe whose light they send now, by the assignment that joins
parts of a shot (asglight.lobes.stitching); what is new gets a name that was never used, and the
name of what is gone is not given to another light.
"""

from dataclasses import replace

import torch

from asglight.lobes import asg
from asglight.lobes.data import LobeTracks, first_unused, lobe_names
from asglight.lobes.stitching import light_saved, pairs_that_save, shares

FRAMES_MAX = 32
"""Frames compared at most, evenly spaced: enough to tell lights apart, whatever a shot's length."""

SAME_LIGHT = 0.5
"""Share of the light that has to be found again; with less it is another environment."""


def by_energy(tracks: LobeTracks) -> LobeTracks:
    """Return the lobes sorted by their flux over the shot, the largest first, named in order."""
    flux = asg.flux(tracks.lobes.to("cpu", torch.float64)).sum((0, -1))  # [N]
    order = torch.argsort(flux, descending=True, stable=True)
    return _in_order(tracks, order.tolist(), lobe_names(tracks.lobes.count))


def named_as(tracks: LobeTracks, earlier: LobeTracks) -> LobeTracks:
    """Return the lobes under the names that they had in an earlier fit of the shot, in its order.

    Lobes without a counterpart come last, by their flux. An earlier fit that has no frame in
    common, or less than half of the light, is of another environment: then they are named anew.
    """
    tracks = by_energy(tracks)
    same = found_again(tracks, earlier)
    if same is None:
        return tracks
    new = [index for index in range(tracks.lobes.count) if index not in same.values()]
    order = [*(same[index] for index in sorted(same)), *new]
    names = [earlier.names[index] for index in sorted(same)]
    unused = lobe_names(len(new), first_unused(earlier.names))
    named = _in_order(tracks, order, (*names, *unused))
    kept = {name: earlier.display_names[name] for name in names if name in earlier.display_names}
    return replace(named, display_names={**named.display_names, **kept})


def found_again(tracks: LobeTracks, earlier: LobeTracks) -> dict[int, int] | None:
    """Return which lobe each lobe of an earlier fit is now; None for another environment.

    Those whose light is gone are left out.

    Args:
        tracks: The fit as it is now.
        earlier: What is to be found again in it.
    """
    common = sorted(set(tracks.frames) & set(earlier.frames))
    if not common or tracks.lobes.form is not earlier.lobes.form:
        return None
    step = -(-len(common) // FRAMES_MAX)
    before, after = (
        one.lobes[torch.tensor([one.frames.index(frame) for frame in common[::step]])].to(
            "cpu", torch.float64
        )
        for one in (earlier, tracks)
    )
    same = pairs_that_save(light_saved(before, after).mean(0))
    light = shares(before, after)[0][..., 0].mean(0)  # [N]
    return same if float(light[list(same)].sum()) >= SAME_LIGHT else None


def _in_order(tracks: LobeTracks, order: list[int], names: tuple[str, ...]) -> LobeTracks:
    """Return the lobes in another order under other names; people call them as before."""
    called = zip(names, (tracks.names[index] for index in order), strict=True)
    shown = {new: tracks.display_names[old] for new, old in called if old in tracks.display_names}
    lobes = tracks.lobes.select(torch.tensor(order, device=tracks.lobes.axes.device))
    return replace(tracks, lobes=lobes, names=names, display_names=shown)
