# SPDX-License-Identifier: Apache-2.0
"""The first frame of a shot is lit as the frames that follow, by what its steps see."""

import torch
from lobe_cases import lamps

from asglight.fitting.first_frame.fit import fit_first_frame
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import joined

ROWS = 64


def test_only_a_still_is_lit_by_exact_means_over_texels() -> None:
    axis_z = torch.tensor([0.0, 0.0, 1.0])
    up = torch.tensor([0.0, 1.0, 0.0])
    axes = torch.stack([up, torch.linalg.cross(axis_z, up), axis_z])[None]
    streak = Lobes(axes, torch.tensor([[4000.0, 1.6]]), torch.full((1, 3), 20.0))
    truth = joined(streak, lamps([(0.0, 1.0, 0.2), (0.3, -1.0, 0.0)], [2.0, 1.0], [1.0, 0.5]))
    radiance = texels.texel_means(truth, ROWS, 2 * ROWS)
    seen, exact = (
        fit_first_frame(radiance, 3, Form.ASG, in_shot=is_shot) for is_shot in (True, False)
    )
    torch.testing.assert_close(seen.lobes.axes, exact.lobes.axes, rtol=0, atol=0)
    assert not torch.equal(seen.lobes.amplitude, exact.lobes.amplitude)
    options = FitOptions(lobes=3, preset=Preset.LIVE)
    still = fit_frame(radiance, options.settled(1), None).lobes
    first = fit_frame(radiance, options.settled(2), None).lobes
    torch.testing.assert_close(still.amplitude, exact.lobes.amplitude, rtol=0, atol=0)
    torch.testing.assert_close(first.amplitude[:3], seen.lobes.amplitude, rtol=0, atol=0)
