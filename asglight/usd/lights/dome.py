# SPDX-License-Identifier: Apache-2.0
"""The dome: one latlong EXR a frame, of all lobes together."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from torch import Tensor

from asglight.images import ocio, write_exr
from asglight.lobes import LobeTracks
from asglight.lobes.data import Lobes
from asglight.threads import one_thread, side_by_side, threads_there
from asglight.usd.lights.dome_texels import images
from asglight.usd.spaces import Space, to_stage


@dataclass(frozen=True)
class Textures:
    """The images of a dome.

    Attributes:
        files: One for each frame, or one.
        writing: What writes each; its folder must exist.
    """

    files: list[Path]
    writing: list[Callable[[], None]]

    def write(self) -> list[Path]:
        """Write them, as many at once as there are threads, and return the files.

        Raises:
            InputError: A file cannot be written.
        """
        with one_thread():
            deque(side_by_side(self.writing, threads_there()), maxlen=0)
        return self.files


def textures(tracks: LobeTracks, folder: Path, stem: str, height: int, space: Space) -> Textures:
    """Return the dome's images, which nothing has written yet; tracks that never change have one.

    Args:
        tracks: Lobes of all frames.
        folder: Of the files.
        stem: Files are named `<stem>.<frame>.exr`.
        height: Rows; there are twice as many columns.
        space: Of the stage's colours, which the images' headers state too.
    """
    count = 1 if is_static(tracks.lobes) else len(tracks.frames)
    paths = [folder / f"{stem}.{frame:04d}.exr" for frame in tracks.frames[:count]]
    colors = replace(space, up_axis="Y")  # the pole of a dome is +Y, whatever is up
    chromaticities = ocio.chromaticities(space.colorspace)

    def write(path: Path, radiance: Callable[[], Tensor]) -> None:
        write_exr(path, radiance(), chromaticities=chromaticities)

    lobes = to_stage(tracks.lobes[:count].to("cpu"), colors)
    calls = [partial(write, *one) for one in zip(paths, images(lobes, height), strict=True)]
    return Textures(paths, calls)


def is_static(lobes: Lobes) -> bool:
    """Tell whether all frames hold the same lobes.  [F, N, .]."""
    return all(
        bool((values == values[:1]).all())
        for values in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )
