# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import sky_files
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Lobes
from asglight.shots.live import live_fits

FRAMES = (1001, 1002, 1003, 1004, 1005)

OPTIONS = FitOptions(4, Preset.LIVE, moving=True)


def sky(frame: int) -> Tensor:
    """Return a sky that rests from 1003 to 1004."""
    shown = 1003 if frame == 1004 else frame
    return torch.from_numpy(np.ascontiguousarray(sky_files.sky(shown)))


def same(found: Lobes, expected: Lobes) -> bool:
    pairs = (
        (found.axes, expected.axes),
        (found.sharpness, expected.sharpness),
        (found.amplitude, expected.amplitude),
    )
    return all(torch.equal(a, b) for a, b in pairs)


def test_each_frame_is_fitted_from_the_two_before_that_differ() -> None:
    one = fit_frame(sky(1001), OPTIONS, None).lobes
    two = fit_frame(sky(1002), OPTIONS, one).lobes
    three = fit_frame(sky(1003), OPTIONS, two, one).lobes
    five = fit_frame(sky(1005), OPTIONS, three, two).lobes
    fits = dict(live_fits(sky, FRAMES, OPTIONS.count))
    assert tuple(fits) == FRAMES
    for frame, expected in zip(FRAMES, (one, two, three, three, five), strict=True):
        assert same(fits[frame], expected)


def test_a_frame_that_cannot_be_read_ends_the_fit_when_its_turn_comes() -> None:
    def read(frame: int) -> Tensor:
        if frame == 1002:
            raise InputError("sky.1002.exr: is damaged.")
        return sky(frame)

    fits = live_fits(read, FRAMES, OPTIONS.count)
    assert next(fits)[0] == 1001
    with pytest.raises(InputError, match=r"sky\.1002"):
        next(fits)
