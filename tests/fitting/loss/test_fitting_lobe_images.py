# SPDX-License-Identifier: Apache-2.0
"""Images of lobes on adaptive cells against texel means; columns against differences."""

import math

import numpy as np
import pytest
import torch
from adaptive_cases import (
    CENTRES,
    PLACES,
    POLES,
    SUN,
    at_texel,
    differences,
    lobes_at,
    plain_cells,
    refined_cells,
    single,
)
from lobe_cases import DOUBLE, random_lobes

from asglight.fitting.loss import coordinates, lobe_images
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.loss.footprints import footprint
from asglight.fitting.loss.grid import POWERS
from asglight.fitting.loss.lobe_images import COLUMNS
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

TERMS_SHARE = (3 + 3 / 2 + 1 / 3) / (3 - 3 / 2 + 1 / 3)
"""Light of a flat lobe's terms, all taken positive, of the lobe's: so do their errors add."""


def _wide(form: Form, sigma_texels: float, rows: int, ratio: float = 1.0) -> Lobes:
    """Return lobes whose sharper sigma is so many texels; the other is sqrt(ratio) of it."""
    s = 1 / ((1 if form is Form.SG else 2) * (sigma_texels * math.pi / rows) ** 2)
    return lobes_at(form, PLACES, [s, s / ratio])


NODES = 3
"""A side of a texel, of Gauss and Legendre: 2e-5 of the peak of a lobe as narrow as a texel."""


def _means(lobes: Lobes, rows: int, some: torch.Tensor | None = None) -> torch.Tensor:
    """Return means over the texels of a grid, or over some of them, by quadrature.  [N, P]."""
    some = torch.arange(2 * rows**2) if some is None else some
    nodes, weights = (torch.from_numpy(each) for each in np.polynomial.legendre.leggauss(NODES))
    v = (some // (2 * rows))[:, None, None] + (1 + nodes[:, None]) / 2
    u = (some % (2 * rows))[:, None, None] + (1 + nodes) / 2
    directions = latlong.direction_from_uv(u / (2 * rows), v / rows)
    area = weights[:, None] * weights * torch.sin(math.pi * v / rows)
    values = asg.unit_lobes(lobes, directions.reshape(-1, 3)).unflatten(-1, area.shape)
    return (area * values).sum((-2, -1)) / area.sum((-2, -1))


def _centroid_bound(rows: int, sigma: float) -> torch.Tensor:
    """Bound the error of values of lobes of so many texels.  [P].

    A texel of side h at latitude l has its centroid h^2 tan(l) / 12 off its centre, and a lobe's
    slope is 0.6 / sigma of its peak at most; T changes by as large a share of h over the lobe.
    The first term left out of the expansion in the texel's size is of order sigma^-4 / 100.
    """
    side = math.pi / rows
    y = latlong.directions(rows, 2 * rows, dtype=DOUBLE).reshape(-1, 3)[:, 1]
    tangent = y.abs() / (1 - y * y).sqrt()
    return side * (1 + tangent) / (12 * sigma) + 0.01 / sigma**4


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize(("sigma", "ratio"), [(1.5, 1.0), (2.0, 1.0), (2.0, 5.0), (4.0, 3.0)])
def test_values_are_means_over_leaves(form: Form, sigma: float, ratio: float) -> None:
    lobes, rows = _wide(form, sigma, 64, ratio), 64
    found = lobe_images.images(single(lobes), plain_cells(rows)).values[0].double()
    expected, bound = _means(lobes, rows), _centroid_bound(rows, sigma)
    assert bool(((found - expected).abs() <= bound).all())
    centres = latlong.directions(rows, 2 * rows, dtype=DOUBLE).reshape(-1, 3)
    sampled = asg.unit_lobes(lobes, centres)
    # not the values at the centres, which are 1 / (24 sigma^2) an axis too high at the peak
    assert bool(((sampled - expected).abs() > bound).any(-1).all())


@pytest.mark.parametrize("form", list(Form))
def test_values_of_texels_in_a_refined_cell_are_those_of_their_own_size(form: Form) -> None:
    places = refined_cells()
    v, u = (SUN[0] + 0.7) / 256, (SUN[1] + 0.4) / 512
    centre = latlong.direction_from_uv(torch.tensor(u), torch.tensor(v)).tolist()
    sigma = 2.0 * math.pi / 256
    s = 1 / ((1 if form is Form.SG else 2) * sigma**2)
    lobes = lobes_at(form, [(centre[0], centre[1], centre[2])], [s, s])
    found = lobe_images.images(single(lobes), places).values[0, :, places.count :]
    expected = _means(lobes, 256, places.texel[0])
    # exponents are differences of numbers as large as the sharpness, rounded to 2^-24 of it
    bound = _centroid_bound(256, 2.0)[places.texel[0]] + 4 * 2**-24 * s
    if form is Form.FLAT:  # each term is off by its own width's, and counts 3, 3 and 1 times
        narrower = (_centroid_bound(256, 2.0 / math.sqrt(k)) for k in (1, 2, 3))
        one, two, three = (part[places.texel[0]] for part in narrower)
        bound = 3 * one + 3 * two + three + 7 * 4 * 2**-24 * s
    assert bool(((found.double() - expected).abs() <= bound).all())
    assert float(expected.max()) > 0.9


def _flux(lobes: Lobes, places: AdaptiveCells) -> torch.Tensor:
    """Return the integral of each lobe of amplitude 1 as its image has it.  [N]."""
    shown = lobe_images.images(single(lobes), places)
    flux = 4 * math.pi * (shown.values.double() * places.share[:, None]).sum(-1)
    return (flux * shown.scale)[0]


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize(
    "sharpness",
    [(60.0, 60.0), (300.0, 300.0), (1e4, 1e4), (1e5, 1e5), (1e7, 1e7), (1e4, 60.0), (1e7, 100.0)],
)
def test_integrals_of_narrow_lobes_are_exact(form: Form, sharpness: tuple[float, float]) -> None:
    lobes = lobes_at(form, CENTRES, list(sharpness))
    # sums in float32, of terms three times as large as a flat lobe is; the bingham form's integral
    # is Dawson's series, to 3 / (4 s^2) + 15 / (8 s^3)
    s = min(sharpness)
    bound = 3e-5 if form is Form.FLAT else 1e-5
    if form is Form.BINGHAM:
        bound += 3 / (4 * s**2) + 15 / (8 * s**3)
    torch.testing.assert_close(
        _flux(lobes, refined_cells()), asg.integral(lobes), rtol=bound, atol=0
    )


@pytest.mark.parametrize("form", list(Form))
def test_integrals_just_above_the_narrowest_broad_lobe_are_below_a_percent_off(form: Form) -> None:
    edge = lobe_images.NARROW_SHARPNESS
    bound = 1e-2 * (TERMS_SHARE if form is Form.FLAT else 1)
    for sharpness in (0.99 * edge, 1.01 * edge):  # scaled or not
        lobes = lobes_at(form, CENTRES + PLACES, [sharpness] * 2)
        torch.testing.assert_close(
            _flux(lobes, refined_cells()), asg.integral(lobes), rtol=bound, atol=0
        )


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("rows", [16, 50])
def test_integrals_of_broad_lobes_are_exact_on_any_grid(form: Form, rows: int) -> None:
    for sharpness in ([0.001, 0.001], [3.0, 0.1], [20.0, 5.0]):
        lobes = lobes_at(form, PLACES + POLES, sharpness)
        scale = lobe_images.images(single(lobes), plain_cells(rows)).scale
        assert torch.equal(scale, torch.ones_like(scale))
        # the mean of y over a row is 1 - h^2 / 8 of the one at its centre; T of the lobe's centre
        # for all texels, h^2 s / 12 at most; float32
        bound = (math.pi / rows) ** 2 * (1 / 8 + max(sharpness) / 12) + 1e-5
        bound *= TERMS_SHARE if form is Form.FLAT else 1
        torch.testing.assert_close(
            _flux(lobes, plain_cells(rows)), asg.integral(lobes), rtol=bound, atol=0
        )


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sharpness", [1e5, 1e7])
def test_a_narrow_lobe_at_a_corner_of_four_cells_keeps_most_of_its_integral(
    form: Form, sharpness: float
) -> None:
    lobes = lobes_at(form, [at_texel(32, 30, 64), at_texel(20, 31, 64)], [sharpness] * 2)
    share = _flux(lobes, plain_cells(64)) / asg.integral(lobes)
    # a Gaussian of variance 1 / 12 is summed to 2 (6 / pi)^1/2 exp(-3 / 2) of it an axis, 0.38 for
    # both, and the scale is 2 at most: 0.76, at the equator of round cells
    assert bool((share > 0.73).all())
    assert bool((share < 1 + 1e-5).all())


def _monomials(directions: torch.Tensor) -> torch.Tensor:
    x, y, z = directions.unbind(-1)
    return torch.stack([x**i * y**j * z**k for i, j, k in POWERS])


def _long_and_round(form: Form) -> Lobes:
    """Return lobes of all widths with both kinds of turn, one of them near a pole."""
    lobes = random_lobes(form, count=12)
    near_pole = lobes_at(form, POLES[2:], [400.0, 90.0])
    axes = torch.cat([lobes.axes, near_pole.axes])
    sharpness = torch.cat([lobes.sharpness, near_pole.sharpness])
    joined = Lobes(axes, sharpness, torch.cat([lobes.amplitude, near_pole.amplitude]), form)
    if form is not Form.SG:
        assert 0 < int(coordinates.is_round(joined).sum()) < joined.count
    return joined


def _around(lobes: Lobes) -> torch.Tensor:
    """Return directions all over the sphere and some widths around each lobe.  [P, 3]."""
    generator = torch.Generator().manual_seed(6)
    everywhere = fibonacci_directions(200, dtype=DOUBLE)
    aside = torch.randn(lobes.count, 40, 2, generator=generator, dtype=DOUBLE)
    aside = aside * (2 * lobes.sharpness[:, None]).rsqrt()
    near = torch.nn.functional.normalize(
        lobes.axis_z[:, None] + aside @ lobes.axes[:, :2], dim=-1
    ).flatten(0, 1)
    directions = torch.cat([everywhere, near])
    # off the hemisphere's edge, where the asg form has a kink
    return directions[((lobes.axis_z @ directions.mT).abs() > 1e-3).all(0)]


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("rows", [(16,), (64, 256, 32)])
def test_columns_are_differences_along_each_coordinate(form: Form, rows: tuple[int, ...]) -> None:
    lobes = _long_and_round(form)
    directions = _around(lobes)
    seen = footprint(lobes[None], rows)
    for level, count in enumerate(rows):
        columns = lobe_images.columns(lobes[None], seen, level, _monomials(directions))
        found = columns[0].unflatten(0, (lobes.count, COLUMNS))
        expected = differences(lobes, count, directions)
        scale = expected.abs().amax(-1, keepdim=True).clamp(min=1e-3)
        # second order in a turn of 1e-4 of lobes up to ten times as long as wide: (1e-3)^2
        torch.testing.assert_close(found / scale, expected / scale, rtol=0, atol=1e-6)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [1.5, 2.5])
def test_columns_are_differences_of_texel_means(form: Form, sigma: float) -> None:
    lobes = _wide(form, sigma, 64, 4.0)
    seen = footprint(lobes[None], (64,))
    centres = latlong.directions(64, 128, dtype=DOUBLE).reshape(-1, 3)
    columns = lobe_images.columns(lobes[None], seen, 0, _monomials(centres))
    found = columns[0].unflatten(0, (3, COLUMNS))
    for unknown in range(3 if form is Form.SG else 5):
        step = 0.01 * (math.pi / 64 if unknown < 2 else 1)
        move = torch.zeros(3, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ways = [coordinates.advance(lobes, way) for way in (move, -move)]
        before = lobes.amplitude[:, :1]
        ahead, behind = (moved.amplitude[:, :1] / before * _means(moved, 64) for moved in ways)
        expected = (ahead - behind) / (2 * step)
        scale = expected.abs().amax(-1, keepdim=True)
        # as for the values at 32 degrees, as high as any of PLACES, and twice for a derivative
        bound = 2 * float(_centroid_bound(64, sigma)[128 * 20])
        difference = (found[:, unknown + 1] - expected).abs() / scale
        assert bool((difference < bound).all())


def test_radiance_is_light_times_scaled_images() -> None:
    lobes = stack(
        [lobes_at(Form.ASG, CENTRES, [1e5, 1e3]), lobes_at(Form.ASG, CENTRES, [9.0, 1.0])]
    )
    places = refined_cells().repeated(2)
    shown = lobe_images.images(lobes.to(torch.float32), places)
    scaled = shown.values.double() * shown.scale[..., None]
    total = (lobes.amplitude[..., None] * scaled[:, :, None]).sum(1)
    # sums of six products in float32
    torch.testing.assert_close(shown.radiance.double(), total, rtol=1e-6, atol=1e-6)
    assert torch.equal(shown.scale[1], torch.ones(6))
    assert float((shown.scale[0] - 1).abs().min()) > 0
