# SPDX-License-Identifier: Apache-2.0
"""The account of what was left out, and what the stage makes of static lobes."""

from dataclasses import replace
from pathlib import Path

import torch
from lobe_cases import lamps

from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.lobes.data import stack
from asglight.shots.leaving_out import account, one_sharpness, simplified, static
from asglight.usd import write_usd


def flickering() -> Lobes:
    """Return six frames of three long lamps: two all but still, the third flickering."""
    places = [(0.0, 1.0, 0.2), (1.0, 0.3, 0.0), (-0.4, 0.2, -1.0)]
    scene = lamps(places, [2.0, 30.0, 300.0], [1.0, 5.0, 40.0])
    scene = replace(scene, sharpness=scene.sharpness * torch.tensor([4.0, 0.5]))
    shot = stack([scene] * 6)
    generator = torch.Generator().manual_seed(1)
    noise = 1 + 1e-4 * torch.randn(6, 3, 1, generator=generator)
    shot = replace(shot, amplitude=shot.amplitude * noise)
    shot.amplitude[:, 2] *= torch.tensor([1.0, 2.0, 0.5, 1.0, 3.0, 1.0])[:, None]
    return shot


def test_a_static_lobe_has_single_values_in_the_stage(tmp_path: Path) -> None:
    from pxr import Usd

    lobes, _ = simplified(flickering(), list(range(6)), None)
    assert static(lobes) == 2
    write_usd(LobeTracks(tuple(range(6)), 24.0, lobes), tmp_path / "a.usda")
    opened = Usd.Stage.Open(str(tmp_path / "a.usda"))
    samples = {
        prim.GetName(): max(a.GetNumTimeSamples() for a in prim.GetAttributes())
        for prim in opened.GetPrimAtPath("/AsgRig/Lobes").GetChildren()
    }
    assert samples == {"lobe_00": 0, "lobe_01": 0, "lobe_02": 6}


def test_the_flux_of_every_frame_stays() -> None:
    shot = flickering()
    lobes, budget = simplified(shot, list(range(6)), None)
    assert budget == 1e-3
    before, after = (asg.flux(one.to(torch.float64)).sum((1, 2)) for one in (shot, lobes))
    torch.testing.assert_close(after, before, rtol=1e-6, atol=0)  # float32 amplitudes


def test_one_frame_has_no_static_lobes() -> None:
    assert static(flickering()[:1]) == 0


def test_isotropic_lobes_are_counted_but_for_the_form_that_has_no_others() -> None:
    lobes = stack([lamps([(0.0, 1.0, 0.0)], [5.0], [1.0])] * 2)
    assert one_sharpness(lobes) == 1
    assert one_sharpness(replace(lobes, form=Form.SG)) == 0
    lobes.sharpness[1, 0, 0] = 6.0
    assert one_sharpness(lobes) == 0


def test_the_account_names_every_reason() -> None:
    lobes = stack([lamps([(0.0, 1.0, 0.0)], [5.0], [1.0])] * 2)
    assert account(6, 4, lobes, [7], 1e-3) == {
        "budget": 1e-3,
        "black": 2,
        "unneeded": 3,
        "one_sharpness": 1,
        "static": 1,
        "repeated_frames": [7],
        "lights": 1,
        "lit_at_once": 1,
    }
