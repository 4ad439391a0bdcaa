# SPDX-License-Identifier: Apache-2.0
"""Images of lobes on leaves against texel means; slopes and columns against differences."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import DOUBLE, random_lobes

from asglight.fitting import coordinates, lobe_images
from asglight.fitting.coordinates import UNKNOWNS
from asglight.fitting.grid import POWERS
from asglight.fitting.leaves import Leaves, leaves
from asglight.fitting.lobe_images import COLUMNS
from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

PLACES = [(0.3, 0.2, 1.0), (-1.0, 0.6, 0.1), (0.02, -0.5, -1.0)]
"""Away from the poles; the last on the seam."""

POLES = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1e-3, 1.0, -2e-3)]

SUN = (90, 201)
"""Row and column of the texel that the refined maps of 256 rows have detail around."""


def _lobes(form: Form, places: list[tuple[float, float, float]], sharpness: list[float]) -> Lobes:
    """Return one frame of lobes that share their sharpness, in float64.  [N, .]."""
    axis_z = torch.nn.functional.normalize(torch.tensor(places, dtype=DOUBLE), dim=-1)
    both = torch.tensor(sharpness[:1] * 2 if form is Form.SG else sharpness, dtype=DOUBLE)
    light = 0.5 + torch.arange(3.0 * len(places), dtype=DOUBLE).reshape(-1, 3)
    return Lobes(axes_around(axis_z), both.expand(len(places), 2), light, form)


def _wide(form: Form, sigma_texels: float, rows: int, ratio: float = 1.0) -> Lobes:
    """Return lobes whose sharper sigma is so many texels; the other is sqrt(ratio) of it."""
    s = 1 / ((1 if form is Form.SG else 2) * (sigma_texels * math.pi / rows) ** 2)
    return _lobes(form, PLACES, [s, s / ratio])


def _single(lobes: Lobes) -> Lobes:
    """Return one frame as the fit takes it: float32, F = 1."""
    return lobes.to(torch.float32)[None]


def _plain(rows: int, frames: int = 1) -> Leaves:
    """Return leaves that are the cells of a grid."""
    return leaves(torch.zeros(frames, 3, 2 * rows * rows), rows)


def _refined() -> Leaves:
    """Return leaves of 64 rows, the cell around SUN refined into texels of 256 rows."""
    reference = torch.zeros(1, 3, 2 * 256 * 256)
    reference[..., SUN[0] * 512 + SUN[1]] = 1.0
    return leaves(reference, 64, 1)


def _means(lobes: Lobes, rows: int) -> torch.Tensor:
    """Return exact means over the texels of a grid, from those of one eight times finer.  [N, P].

    Finer, for a lobe wider than four texels is sampled at their centres.
    """
    fine = texels.unit_texel_means(lobes, 8 * rows, 16 * rows)
    return latlong.reduce(fine.mT.reshape(8 * rows, 16 * rows, -1), rows, 2 * rows).flatten(0, 1).mT


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
    found = lobe_images.images(_single(lobes), _plain(rows)).values[0].double()
    expected, bound = _means(lobes, rows), _centroid_bound(rows, sigma)
    assert bool(((found - expected).abs() <= bound).all())
    centres = latlong.directions(rows, 2 * rows, dtype=DOUBLE).reshape(-1, 3)
    sampled = asg.unit_lobes(lobes, centres)
    # not the values at the centres, which are 1 / (24 sigma^2) an axis too high at the peak
    assert bool(((sampled - expected).abs() > bound).any(-1).all())


@pytest.mark.parametrize("form", list(Form))
def test_values_of_texels_in_a_refined_cell_are_those_of_their_own_size(form: Form) -> None:
    places = _refined()
    v, u = (SUN[0] + 0.7) / 256, (SUN[1] + 0.4) / 512
    centre = latlong.direction_from_uv(torch.tensor(u), torch.tensor(v)).tolist()
    sigma = 2.0 * math.pi / 256
    s = 1 / ((1 if form is Form.SG else 2) * sigma**2)
    lobes = _lobes(form, [(centre[0], centre[1], centre[2])], [s, s])
    found = lobe_images.images(_single(lobes), places).values[0, :, places.count :]
    expected = _means(lobes, 256)[:, places.texel[0]]
    # exponents are differences of numbers as large as the sharpness, rounded to 2^-24 of it
    bound = _centroid_bound(256, 2.0)[places.texel[0]] + 4 * 2**-24 * s
    assert bool(((found.double() - expected).abs() <= bound).all())
    assert float(expected.max()) > 0.9


def _flux(lobes: Lobes, places: Leaves) -> torch.Tensor:
    """Return the integral of each lobe of amplitude 1 as its image on leaves has it.  [N]."""
    shown = lobe_images.images(_single(lobes), places)
    flux = 4 * math.pi * (shown.values.double() * places.share[:, None]).sum(-1)
    return (flux * shown.scale)[0]


def _at(row: float, column: float, rows: int) -> tuple[float, float, float]:
    """Return the direction so many texels from the grid's corner."""
    v, u = torch.tensor(row / rows, dtype=DOUBLE), torch.tensor(column / (2 * rows), dtype=DOUBLE)
    x, y, z = latlong.direction_from_uv(u, v).tolist()
    return x, y, z


CENTRES = [
    _at(SUN[0] + 0.5, SUN[1] + 0.5, 256),  # a texel's centre, in the refined cell
    _at(SUN[0] + 0.5, SUN[1], 256),  # between two of its texels
    _at(20.5, 30.5, 64),  # a cell's centre
    _at(20.5, 30, 64),  # between two cells
    _at(50.3, 90.8, 64),
    _at(0.0, 0.0, 64),  # a pole
]


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize(
    "sharpness",
    [(60.0, 60.0), (300.0, 300.0), (1e4, 1e4), (1e5, 1e5), (1e7, 1e7), (1e4, 60.0), (1e7, 100.0)],
)
def test_integrals_of_narrow_lobes_are_exact(form: Form, sharpness: tuple[float, float]) -> None:
    lobes = _lobes(form, CENTRES, list(sharpness))
    # sums in float32; the bingham form's is Dawson's series, to 3 / (4 s^2) + 15 / (8 s^3)
    s = min(sharpness)
    bound = 1e-5 + (3 / (4 * s**2) + 15 / (8 * s**3) if form is Form.BINGHAM else 0)
    torch.testing.assert_close(_flux(lobes, _refined()), asg.integral(lobes), rtol=bound, atol=0)


@pytest.mark.parametrize("form", list(Form))
def test_integrals_just_above_the_narrowest_broad_lobe_are_below_a_percent_off(form: Form) -> None:
    edge = lobe_images.NARROW_SHARPNESS
    for sharpness in (0.99 * edge, 1.01 * edge):  # scaled or not
        lobes = _lobes(form, CENTRES + PLACES, [sharpness] * 2)
        torch.testing.assert_close(_flux(lobes, _refined()), asg.integral(lobes), rtol=1e-2, atol=0)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("rows", [16, 50])
def test_integrals_of_broad_lobes_are_exact_on_any_grid(form: Form, rows: int) -> None:
    for sharpness in ([0.001, 0.001], [3.0, 0.1], [20.0, 5.0]):
        lobes = _lobes(form, PLACES + POLES, sharpness)
        scale = lobe_images.images(_single(lobes), _plain(rows)).scale
        assert torch.equal(scale, torch.ones_like(scale))
        # the mean of y over a row is 1 - h^2 / 8 of the one at its centre; T of the lobe's centre
        # for all texels, h^2 s / 12 at most; float32
        bound = (math.pi / rows) ** 2 * (1 / 8 + max(sharpness) / 12) + 1e-5
        torch.testing.assert_close(
            _flux(lobes, _plain(rows)), asg.integral(lobes), rtol=bound, atol=0
        )


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sharpness", [1e5, 1e7])
def test_a_narrow_lobe_at_a_corner_of_four_cells_keeps_most_of_its_integral(
    form: Form, sharpness: float
) -> None:
    lobes = _lobes(form, [_at(32, 30, 64), _at(20, 31, 64)], [sharpness] * 2)
    share = _flux(lobes, _plain(64)) / asg.integral(lobes)
    # a Gaussian of variance 1 / 12 is summed to 2 (6 / pi)^1/2 exp(-3 / 2) of it an axis, 0.38 for
    # both, and the scale is 2 at most: 0.76, at the equator of round cells
    assert bool((share > 0.73).all())
    assert bool((share < 1 + 1e-5).all())


def _moment(lobes: Lobes, rows: int) -> torch.Tensor:
    """Return a texel's second moment about the centre of each lobe, in its frame.  [N, 2, 2].

    A twelfth of its height squared northwards, cos(latitude)^2 of that eastwards, which goes to a
    square's within half a texel of a pole; for the sg form the mean of both.
    """
    height = math.pi / rows
    x, y, z = lobes.axis_z.unbind(-1)
    cosine = (x * x + z * z).sqrt()
    east = torch.stack([z, torch.zeros_like(y), -x], dim=-1) / cosine[:, None]
    ways = torch.stack([torch.linalg.cross(lobes.axis_z, east), east], dim=1)
    parts = lobes.axes[:, :2] @ ways.mT  # columns are north and east
    width2 = 1 - (y * (cosine / (height / 2)).clamp(max=1)).square()
    moment = (
        height**2 / 12 * parts @ torch.diag_embed(torch.stack([y * 0 + 1, width2], -1)) @ parts.mT
    )
    if lobes.form is Form.SG:
        trace = torch.diagonal(moment, dim1=-2, dim2=-1).sum(-1)
        return trace[:, None, None] / 2 * torch.eye(2, dtype=DOUBLE)
    return moment


def _seen(lobes: Lobes, before: Lobes, rows: int, directions: torch.Tensor) -> torch.Tensor:
    """Return lobes as texels see them that have the moments of lobes of before.  [N, P].

    A Gaussian of covariance (2 S)^-1 + T whose integral in the plane is the lobe's own.
    """
    moment = _moment(before, rows)
    turn = before.axes[:, :2] @ lobes.axes[:, :2].mT  # of the new x and y, in the frame before
    across = turn @ lobes.axes[:, :2] @ directions.mT  # [N, 2, P]
    z = lobes.axis_z @ directions.mT
    if lobes.form is Form.SG:
        wider = 1 + lobes.sharpness[:, :1] * moment[:, 0, :1]
        return torch.exp(lobes.sharpness[:, :1] / wider * (z - 1)) / wider
    covariance = turn @ torch.diag_embed(0.5 / lobes.sharpness) @ turn.mT
    seen = torch.linalg.inv(covariance + moment)
    peak = (torch.linalg.det(covariance) * torch.linalg.det(seen)).sqrt()
    power = -0.5 * (across * (seen @ across)).sum(1)
    gaussian = peak[:, None] * torch.exp(power)
    return gaussian * z.clamp(min=0) if lobes.form is Form.ASG else gaussian


def _differences(lobes: Lobes, rows: int, directions: torch.Tensor) -> torch.Tensor:
    """Return each lobe and its change along each coordinate, T held.  [N, 6, P]."""
    narrowest = float((2 * lobes.sharpness.max()).rsqrt())
    found = [_seen(lobes, lobes, rows, directions)]
    for unknown in range(COLUMNS - 1):
        step = 1e-4 * (narrowest if unknown < 2 else 1)
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ways = [coordinates.advance(lobes, way) for way in (move, -move)]
        ahead, behind = (
            # the amplitude comes with a lobe's shape
            moved.amplitude[:, :1] / lobes.amplitude[:, :1] * _seen(moved, lobes, rows, directions)
            for moved in ways
        )
        found.append((ahead - behind) / (2 * step))
    return torch.stack(found, dim=1)


def _monomials(directions: torch.Tensor) -> torch.Tensor:
    x, y, z = directions.unbind(-1)
    return torch.stack([x**i * y**j * z**k for i, j, k in POWERS])


def _long_and_round(form: Form) -> Lobes:
    """Return lobes of all widths with both kinds of turn, one of them near a pole."""
    lobes = random_lobes(form, count=12)
    near_pole = _lobes(form, POLES[2:], [400.0, 90.0])
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
    seen = lobe_images.footprint(lobes[None], rows)
    for level, count in enumerate(rows):
        columns = lobe_images.columns(lobes[None], seen, level, _monomials(directions))
        found = columns[0].unflatten(0, (lobes.count, COLUMNS))
        expected = _differences(lobes, count, directions)
        scale = expected.abs().amax(-1, keepdim=True).clamp(min=1e-3)
        # second order in a turn of 1e-4 of lobes up to ten times as long as wide: (1e-3)^2
        torch.testing.assert_close(found / scale, expected / scale, rtol=0, atol=1e-6)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [1.5, 2.5])
def test_columns_are_differences_of_texel_means(form: Form, sigma: float) -> None:
    lobes = _wide(form, sigma, 64, 4.0)
    seen = lobe_images.footprint(lobes[None], (64,))
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


def _slopes(
    lobes: Lobes, places: Leaves
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return slopes of frames of lobes as the fit takes them, with what they should be.

    Returns:
        The slopes, the sums, the sums' size if terms had random signs, each [F, N, 8], and
        the scales [F, N].
    """
    generator = torch.Generator().manual_seed(8)
    slope = torch.randn(len(lobes.axes), 3, places.share.shape[-1], generator=generator)
    single = lobes.to(torch.float32)
    shown = lobe_images.images(single, places)
    seen = lobe_images.footprint(single, [rows for rows, _, _ in places.levels])
    found = lobe_images.slopes(shown, seen, slope, places)
    sums, sizes = [], []
    for frame in range(len(slope)):
        own = lobes[frame]
        directions = places.directions[frame].double().mT
        parts = [_differences(own, rows, directions[place]) for rows, _, place in places.levels]
        columns = torch.cat(parts, dim=-1) * shown.scale[frame, :, None, None].double()
        for power, kept in ((1, sums), (2, sizes)):
            pulled = columns**power @ slope[frame].double().mT ** power
            shape = (pulled[:, 1:] * own.amplitude[:, None] ** power).sum(-1)
            kept.append(torch.cat([shape, pulled[:, 0]], dim=-1))
    return found, torch.stack(sums), torch.stack(sizes).sqrt(), shown.scale


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("rows", [16, 50])
def test_slopes_are_the_columns_times_the_slope(form: Form, rows: int) -> None:
    frames = stack([random_lobes(form, count=8, seed=seed) for seed in (0, 1)])
    found, expected, size, _ = _slopes(frames, _plain(rows, 2))
    # moments are differences: sums in float32, times a sharpness of up to 100
    difference = (found - expected).abs()
    assert bool((difference <= 2e-4 * size + 1e-6).all())
    assert bool((expected.abs().amax((0, 1)) > 0.1)[[0, 1, 2, 5, 6, 7]].all())
    if form is Form.SG:
        assert not found[..., 3:5].any()


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sharpness", [(300.0, 300.0), (3e3, 200.0), (3e4, 2e4), (1e5, 1e3)])
def test_slopes_of_narrow_lobes_count_texels_and_the_scale(
    form: Form, sharpness: tuple[float, float]
) -> None:
    lobes = _lobes(form, [*CENTRES[:5], *PLACES], list(sharpness))
    found, expected, size, scale = _slopes(stack([lobes]), _refined())
    # a moment along a lobe's width cancels to 1 / s' of the lobe, and again with the light that
    # comes with the width, in float32
    seen = min(sharpness[0], 6 / (math.pi / 256) ** 2)
    difference = (found - expected).abs()
    assert bool((difference <= (2e-4 + 8 * 2**-24 * seen) * size + 1e-6).all())
    assert sharpness[0] < 1e4 or float((scale - 1).abs().max()) > 0.05


@pytest.mark.parametrize("form", list(Form))
def test_everything_is_finite_from_the_broadest_to_the_narrowest_lobe(form: Form) -> None:
    places = _refined()
    for first in (1e-3, 1.0, 49.0, 51.0, 1e4, 1e7):
        for second in (1e-3, 1.0, 49.0, 51.0, 1e4, 1e7):
            lobes = _single(_lobes(form, PLACES + POLES + CENTRES[:2], [first, second]))
            shown = lobe_images.images(lobes, places)
            seen = lobe_images.footprint(lobes, (64, 256, 32))
            of_leaves = replace(seen, exponent=seen.exponent[:2], derivatives=seen.derivatives[:2])
            slope = torch.ones(1, 3, places.share.shape[-1])
            slopes = lobe_images.slopes(shown, of_leaves, slope, places)
            coarse = _plain(32).cells.monomials
            columns = lobe_images.columns(lobes, seen, 2, coarse)
            for found in (shown.values, shown.scale, shown.radiance, slopes, columns):
                assert bool(found.isfinite().all())
            # 1 at the peak of a lobe that a leaf resolves; exponents of up to 6 / T in float32
            assert float(shown.values.min()) >= 0
            assert float(shown.values.max()) <= 1.05


def test_radiance_is_light_times_scaled_images() -> None:
    lobes = stack([_lobes(Form.ASG, CENTRES, [1e5, 1e3]), _lobes(Form.ASG, CENTRES, [9.0, 1.0])])
    places = _refined().repeated(2)
    shown = lobe_images.images(lobes.to(torch.float32), places)
    scaled = shown.values.double() * shown.scale[..., None]
    total = (lobes.amplitude[..., None] * scaled[:, :, None]).sum(1)
    # sums of six products in float32
    torch.testing.assert_close(shown.radiance.double(), total, rtol=1e-6, atol=1e-6)
    assert torch.equal(shown.scale[1], torch.ones(6))
    assert float((shown.scale[0] - 1).abs().min()) > 0
