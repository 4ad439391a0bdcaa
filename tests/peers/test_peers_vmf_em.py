# SPDX-License-Identifier: Apache-2.0
"""The EM peer: flux, recovery of known densities, the closed form of the concentration."""

import math

import pytest
import torch

from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.frames import axes_around
from asglight.peers import vmf_em
from asglight.sphere import latlong


def lamps(axes: list[tuple[float, float, float]], sharpness: list[float]) -> Lobes:
    axis_z = torch.nn.functional.normalize(torch.tensor(axes).float(), dim=-1)
    both = torch.tensor(sharpness)[:, None].expand(-1, 2).contiguous()
    colour = torch.tensor([[4.0, 2.0, 1.0], [1.0, 2.0, 6.0]])[: len(axes)]
    return Lobes(axes_around(axis_z), both, colour, Form.SG)


def test_em_keeps_the_flux_of_every_channel() -> None:
    reference = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0)) ** 6
    weight = latlong.texel_solid_angles(32, 64)[..., None]
    flux = asg.flux(vmf_em.fit(reference, 5)).sum(0)
    torch.testing.assert_close(flux, (weight * reference).sum((0, 1)), rtol=1e-4, atol=0)


def test_em_finds_two_known_lobes() -> None:
    truth = lamps([(1, 0.3, 0), (-0.2, 0.1, -1)], [60.0, 20.0])
    found = vmf_em.fit(texels.texel_means(truth, 64, 128), 2)
    nearest = (found.axis_z @ truth.axis_z.mT).argmax(0)
    assert sorted(nearest.tolist()) == [0, 1]
    for index, lobe in enumerate(nearest.tolist()):
        assert float(found.axis_z[lobe] @ truth.axis_z[index]) > math.cos(math.radians(0.3))
        # the closed form of the concentration is good to a few percent in between its limits
        assert float(found.sharpness[lobe, 0]) == pytest.approx(
            float(truth.sharpness[index, 0]), rel=0.05
        )
        torch.testing.assert_close(
            found.amplitude[lobe], truth.amplitude[index], rtol=0.06, atol=0.01
        )


def test_a_lamp_of_one_texel_stays_bounded() -> None:
    reference = torch.zeros(32, 64, 3)
    reference[9, 20] = 1e6
    found = vmf_em.fit(reference, 3)
    assert bool(torch.isfinite(found.amplitude).all())
    assert float(found.sharpness.max()) <= vmf_em.CONCENTRATION_MAX
