# SPDX-License-Identifier: Apache-2.0
"""A row of the map, stacked over time with a row between every two frames.

Three stacks side by side: the reference, the fitted frames dissolved, the lobes in motion. A lamp
that moves is a line; dissolved, it is a ladder.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import torch
from matplotlib.figure import Figure

from asglight.images.output import written_beside
from asglight.judging.motion import between
from asglight.judging.pictures.display import exposure_stops, view_transform
from asglight.lobes import Lobes, LobeTracks, motion, texels
from asglight.sphere import latlong

DARKER = 5.0
"""Stops below the exposure of a contact sheet: lamps show their colour and edges."""

TITLES = ("reference", "fits dissolved", "lobes")


def draw(path: Path, maps: dict[int, torch.Tensor], tracks: LobeTracks) -> None:
    """Draw the line of the map in which lights move most.

    Args:
        path: Target.
        maps: Every frame.  [H, W, 3] each
        tracks: A fit of every second one.
    """
    times = [frame for frame in maps if tracks.frames[0] <= frame <= tracks.frames[-1]]
    height = len(maps[times[0]])
    fits = {frame: shown(tracks.at(frame), height) for frame in tracks.frames}
    lobes, dissolved = [], []
    for time in times:
        lobes.append(fits[time] if time in fits else shown(motion.at(tracks, [time])[0], height))
        if time in fits:
            dissolved.append(fits[time])
            continue
        before, after = between.neighbours(tracks.frames, time)
        dissolved.append(torch.lerp(fits[before], fits[after], (time - before) / (after - before)))
    reference = torch.stack([maps[time] for time in times])
    along_column, line = busiest(reference)
    stacks = []
    for one in (reference, torch.stack(dissolved), torch.stack(lobes)):
        stacks.append(one[:, :, line] if along_column else one[:, line])
    stops = exposure_stops(reference) - DARKER
    rows = max(1, 300 // len(times))
    figure = Figure(figsize=(12, 4.4), facecolor="#1b1d1f", layout="constrained")
    for axes, title, stack in zip(figure.subplots(1, 3), TITLES, stacks, strict=True):
        axes.imshow(np.repeat(view_transform(stack, stops), rows, 0), aspect="auto")
        axes.set_title(title, color="#d8d8d8", fontsize=11)
        axes.set_axis_off()
    kind = "column" if along_column else "row"
    figure.supxlabel(f"{kind} {line} of the map, time downwards", color="#9a9a9a", fontsize=10)
    with mpl.rc_context({"savefig.facecolor": "#1b1d1f"}), written_beside(path) as temporary:
        figure.savefig(temporary, dpi=110)


def shown(lobes: Lobes, height: int) -> torch.Tensor:
    """Return the texel means of lobes.  [H, 2 H, 3]."""
    return texels.texel_means(lobes.to(torch.float32), height, 2 * height)


def busiest(maps: torch.Tensor) -> tuple[bool, int]:
    """Return whether a column is drawn, and which line: that with the most change over time.

    Args:
        maps: [T, H, W, 3]
    """
    solid_angle = latlong.texel_solid_angles(*maps.shape[1:3])
    change = solid_angle * maps.diff(dim=0).abs().sum((0, -1))  # [H, W]
    rows, columns = change.mean(1), change.mean(0)
    if float(columns.max()) > float(rows.max()):
        return True, int(columns.argmax())
    return False, int(rows.argmax())
