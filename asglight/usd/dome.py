# SPDX-License-Identifier: Apache-2.0
"""The dome: one latlong EXR a frame, of all lobes together."""

from pathlib import Path

from asglight.images import write_exr
from asglight.lobes import LobeTracks, texels
from asglight.lobes.data import Lobes

HEIGHT = 128
"""Rows of the images where nothing else is asked for: texels of 1.4 degrees."""


def write_textures(tracks: LobeTracks, folder: Path, stem: str, height: int) -> list[Path]:
    """Write the dome's images; tracks that never change get one.

    Args:
        tracks: Lobes of all frames.
        folder: An existing folder.
        stem: Files are named `<stem>.<frame>.exr`.
        height: Rows; there are twice as many columns.

    Returns:
        The files: one for each frame, or one.

    Raises:
        InputError: A file cannot be written.
    """
    count = 1 if is_static(tracks.lobes) else len(tracks.frames)
    paths = [folder / f"{stem}.{frame:04d}.exr" for frame in tracks.frames[:count]]
    for index, path in enumerate(paths):
        write_exr(path, texels.texel_means(tracks.lobes[index].to("cpu"), height, 2 * height))
    return paths


def is_static(lobes: Lobes) -> bool:
    """Tell whether all frames hold the same lobes.  [F, N, .]."""
    return all(
        bool((values == values[:1]).all())
        for values in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )
