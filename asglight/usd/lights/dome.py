# SPDX-License-Identifier: Apache-2.0
"""The dome: one latlong EXR a frame, of all lobes together."""

from dataclasses import replace
from pathlib import Path

from asglight.images import ocio, write_exr
from asglight.lobes import LobeTracks
from asglight.lobes.data import Lobes
from asglight.usd.lights import dome_texels
from asglight.usd.spaces import Space, to_stage


def write_textures(
    tracks: LobeTracks, folder: Path, stem: str, height: int, space: Space
) -> list[Path]:
    """Write the dome's images; tracks that never change get one.

    Args:
        tracks: Lobes of all frames.
        folder: An existing folder.
        stem: Files are named `<stem>.<frame>.exr`.
        height: Rows; there are twice as many columns.
        space: Of the stage's colours, which the images' headers state too.

    Returns:
        The files: one for each frame, or one.

    Raises:
        InputError: A file cannot be written.
    """
    count = 1 if is_static(tracks.lobes) else len(tracks.frames)
    paths = [folder / f"{stem}.{frame:04d}.exr" for frame in tracks.frames[:count]]
    colors = replace(space, up_axis="Y")  # the pole of a dome is +Y, whatever is up
    chromaticities = ocio.chromaticities(space.colorspace)
    for index, path in enumerate(paths):
        lobes = to_stage(tracks.lobes[index].to("cpu"), colors)
        radiance = dome_texels.interpolated(lobes, height)
        write_exr(path, radiance, chromaticities=chromaticities)
    return paths


def is_static(lobes: Lobes) -> bool:
    """Tell whether all frames hold the same lobes.  [F, N, .]."""
    return all(
        bool((values == values[:1]).all())
        for values in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )
