# SPDX-License-Identifier: Apache-2.0
"""A fit to be watched: frames in order with the `live` preset, nothing kept on disk."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import Following
from asglight.lobes import Lobes
from asglight.shots.reading import ahead


def live_fits(
    read: Callable[[int], Tensor], frames: Sequence[int], lobes: int | None = None
) -> Iterator[tuple[int, Lobes]]:
    """Fit frames one after the other, each from the ones before, as `fit_frames` does.

    Args:
        read: Returns the repaired radiance of a frame, [H, 2 H, 3]; called in threads.
        frames: Frame numbers.
        lobes: Number of lobes; None for that of `FitOptions`.

    Yields:
        Frame number and lobes, [N, .]; those of the frame before where the pixels are the same,
        unless they can be followed to better ones.

    Raises:
        InputError: A frame cannot be read.
    """
    following = Following(FitOptions(lobes, Preset.LIVE, moving=len(frames) > 1))
    with contextlib.closing(ahead(read, list(frames))) as images:
        for frame, radiance in zip(frames, images, strict=True):
            following.take(radiance)
            assert following.last is not None
            yield frame, following.last.lobes
