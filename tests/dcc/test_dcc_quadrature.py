# SPDX-License-Identifier: Apache-2.0
"""The integrals that renders are held against: brute force, furnaces, closed forms."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.shading import brute_force, ggx
from asglight.sphere import latlong
from dcc import lobe_light, quadrature, scene

SIZE = 4
VIEW = torch.tensor(scene.VIEWS["front"], dtype=torch.float64)


def normals() -> Tensor:
    return torch.from_numpy(scene.normals(SIZE, "front"))


def lobes() -> Lobes:
    """Return a sun, a thin line, and a sky: what a grid cannot hold and what it can."""
    towards = torch.tensor([[0.3, 0.5, 0.8], [-0.7, 0.2, 0.4], [0.0, 1.0, 0.1]]).double()
    return Lobes(
        axes_around(torch.nn.functional.normalize(towards, dim=-1)),
        torch.tensor([[2e4, 2e4], [5e3, 2.0], [0.8, 3.0]]).double(),
        torch.tensor([[2e3, 1e3, 5e2], [30.0, 40.0, 50.0], [0.2, 0.5, 1.0]]).double(),
    )


@pytest.mark.parametrize("form", [Form.BINGHAM, Form.SG])
def test_narrow_lobes_of_other_forms_send_from_where_they_are(form: Form) -> None:
    sun = replace(lobes().select(torch.tensor([0])), form=form)
    light = lobe_light.light_of(sun)
    cosine = light.directions @ sun.axis_z[0]
    share = light.flux[:, 0] / light.flux[:, 0].sum()
    exact = asg.moments(sun)
    assert float((share * cosine).sum()) == pytest.approx(
        float(exact.first[0] / exact.zeroth[0]), abs=1e-6
    )
    assert float((share * cosine**2).sum()) == pytest.approx(
        float(exact.second[0, 2] / exact.zeroth[0]), abs=1e-6
    )


@pytest.mark.parametrize("roughness", scene.MATERIALS.values())
def test_lobes_show_what_brute_force_shows(roughness: float | None) -> None:
    light = lobe_light.light_of(lobes())
    assert len(light.directions) > 0
    assert float(light.radiance.sum()) > 0
    found = quadrature.shown([light], normals(), VIEW, roughness)[0]
    if roughness is None:
        of_each = brute_force.irradiance_over_pi(lobes(), normals())
    else:
        of_each = brute_force.reflected(lobes(), normals(), VIEW, roughness).sum(-1)
    expected = torch.einsum("np,nc->pc", of_each, lobes().amplitude)
    # brute force is within 0.07 % of itself with more points
    assert float((found - expected).norm() / expected.norm()) < 1e-3


@pytest.mark.parametrize("form", Form)
def test_a_light_has_the_lobes_flux(form: Form) -> None:
    isotropic = lobes().sharpness.amax(-1, keepdim=True).expand(-1, 2)
    sharpness = isotropic if form is Form.SG else lobes().sharpness
    of_form = replace(lobes(), sharpness=sharpness, form=form)
    light = lobe_light.light_of(of_form)
    weights = latlong.texel_solid_angles(256, 512, dtype=torch.float64)[..., None]
    found = (light.radiance * weights).sum((0, 1)) + light.flux.sum(0)
    # the grid's midpoints: (texel in radians)^2 / 24, and the kink at a lobe's horizon
    torch.testing.assert_close(found, asg.flux(of_form).sum(0), rtol=1e-4, atol=0)


def test_a_white_map_shows_the_albedo() -> None:
    white = quadrature.broad(torch.ones(256, 512, 3))
    matte, rough = (quadrature.shown([white], normals(), VIEW, r)[0] for r in (None, 0.5))
    # the kink where texels pass the horizon
    torch.testing.assert_close(matte, torch.ones_like(matte), rtol=1e-4, atol=0)
    albedo = ggx.albedo(normals() @ VIEW, 0.25)[:, None].expand(-1, 3)
    torch.testing.assert_close(rough, albedo, rtol=2e-3, atol=0)  # as ggx.albedo says of itself


def test_separable_shadowing_is_the_product_of_both_sides() -> None:
    alpha, view, light = 0.3, math.cos(0.4), math.cos(1.2)

    def side(cosine: float) -> float:  # 1 / (1 + Lambda) of GGX, Walter et al. 2007
        tan2 = 1 / cosine**2 - 1
        return 2 / (1 + math.sqrt(1 + alpha**2 * tan2))

    found = quadrature.separable_visibility(
        torch.tensor(view).double(), torch.tensor(light).double(), alpha
    )
    expected = side(view) * side(light) / (4 * view * light)
    assert float(found) == pytest.approx(expected, rel=1e-6)  # cosines of float32


def test_a_small_map_repeats_its_texels() -> None:
    small = torch.rand(64, 128, 3)
    large = quadrature.at_rows(small)
    assert torch.equal(large[::4, ::4], small)
    assert torch.equal(large[3::4, 3::4], small)


def test_the_two_views_see_every_normal_once() -> None:
    front, back = (scene.normals(32, view) for view in scene.VIEWS)
    assert front[:, 2].min() >= scene.COS_EDGE
    assert back[:, 2].max() <= -scene.COS_EDGE
    right = scene.pixel_places(32)[scene.judged(32)][:, 0]
    assert front[:, 0].tolist() == pytest.approx(right.tolist())  # +X is on the right
    assert back[:, 0].tolist() == pytest.approx((-right).tolist())
    assert front[:, 1].tolist() == pytest.approx(back[:, 1].tolist())
