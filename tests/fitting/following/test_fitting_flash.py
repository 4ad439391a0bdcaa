# SPDX-License-Identifier: Apache-2.0
"""After a flash of one frame, lobes are back at the lights that it outshone."""

import pytest
import torch
from lobe_cases import lamps
from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.judging.following import follow
from asglight.judging.metrics import frame_errors
from asglight.lobes import texels

ROWS, LOBES = 32, 8
ROOM = ((1, 0.3, 0), (-0.5, 0.6, 0.8), (0, 0.1, -1), (-1, -0.2, 0.1), (0, 1, 0))
FLASH = (0.6, 0.2, 0.7)


def room() -> Tensor:
    """Return the map of four lamps and a ceiling."""
    shown = lamps(ROOM, [300.0, 150.0, 90.0, 60.0, 1.0], [200.0, 150.0, 100.0, 50.0, 0.3])
    return texels.texel_means(shown, ROWS, 2 * ROWS)


@pytest.mark.parametrize("dimmed", [1.0, 0.8])
def test_after_a_flash_lamps_have_their_lobes_again(dimmed: float) -> None:
    steady = room()
    flash = steady + texels.texel_means(lamps([FLASH], [60.0], [3e6]), ROWS, 2 * ROWS)
    maps = [steady, flash, dimmed * steady]
    (before, _, after), _ = follow(maps, FitOptions(LOBES, Preset.LIVE))
    first, last = frame_errors(before, maps[0]), frame_errors(after, maps[2])
    assert last.values["r0.5"] < 1.2 * first.values["r0.5"] + 1e-3
    lit = (before.amplitude > 0).any(-1)
    assert torch.equal((after.amplitude > 0).any(-1), lit)  # each in its own track
    assert float((before.axis_z * after.axis_z).sum(-1)[lit].min()) > 0.99
