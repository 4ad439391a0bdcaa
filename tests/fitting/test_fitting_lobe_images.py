# SPDX-License-Identifier: Apache-2.0
"""Images of lobes against texel means, their columns against differences, slopes against sums."""

import math

import pytest
import torch
from lobe_cases import DOUBLE, random_lobes

from asglight.fitting import coordinates, lobe_images
from asglight.fitting.coordinates import BROAD, UNKNOWNS
from asglight.fitting.grid import coarsen, grid
from asglight.fitting.lobe_images import COLUMNS
from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

PLACES = [(0.3, 0.2, 1.0), (-1.0, 0.6, 0.1), (0.02, -0.5, -1.0)]
"""Away from the poles; the last on the seam."""


def _directions(height: int) -> torch.Tensor:
    return latlong.directions(height, 2 * height, dtype=DOUBLE).reshape(-1, 3)


def _wide(form: Form, sigma_texels: float, height: int, ratio: float = 1.0) -> Lobes:
    """Return lobes whose sharper sigma is so many texels; the other is sqrt(ratio) of it."""
    axis_z = torch.nn.functional.normalize(torch.tensor(PLACES, dtype=DOUBLE), dim=-1)
    s = 1 / ((1 if form is Form.SG else 2) * (sigma_texels * math.pi / height) ** 2)
    sharpness = torch.tensor([s, s if form is Form.SG else s / ratio], dtype=DOUBLE)
    light = torch.tensor([[1.0, 2.0, 3.0], [0.5, 0.1, 4.0], [7.0, 1.0, 1.0]], dtype=DOUBLE)
    return Lobes(axes_around(axis_z), sharpness.expand(3, 2), light, form)


def _together(first: Lobes, second: Lobes) -> Lobes:
    axes = torch.cat([first.axes, second.axes])
    sharpness = torch.cat([first.sharpness, second.sharpness])
    return Lobes(axes, sharpness, torch.cat([first.amplitude, second.amplitude]), first.form)


def _slope(height: int) -> torch.Tensor:
    """Return a rough slope of a loss.  [3, P]."""
    generator = torch.Generator().manual_seed(8)
    return torch.randn(3, 2 * height * height, generator=generator)


def _dense(lobes: Lobes, height: int, finer: int = 1) -> torch.Tensor:
    """Return the columns in float64, averaged over `finer` by `finer` parts of each texel."""
    rows = height * finer
    columns = lobe_images.local_columns(lobes, lobes.axes @ _directions(rows).mT).flatten(0, 1)
    images = columns.mT.reshape(rows, 2 * rows, -1)
    return latlong.reduce(images, height, 2 * height).flatten(0, 1).mT.unflatten(0, (-1, COLUMNS))


def _differences(lobes: Lobes, height: int, step: float = 1e-4) -> torch.Tensor:
    """Return the change of each lobe's texel means along each coordinate.  [N, 5, P]."""
    found = []
    for unknown in range(5):
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ahead, behind = (
            texels.unit_texel_means(coordinates.advance(lobes, way), height, 2 * height)
            for way in (move, -move)
        )
        found.append((ahead - behind) / (2 * step))
    return torch.stack(found, dim=1)


def _assert_near(found: torch.Tensor, expected: torch.Tensor, share: float) -> None:
    """Compare rows to a share of the largest entry of each row."""
    scale = expected.abs().amax(-1, keepdim=True).clamp(min=1e-9)
    torch.testing.assert_close(
        found.double() / scale, expected.double() / scale, rtol=0, atol=share
    )


@pytest.mark.parametrize("form", list(Form))
def test_columns_are_the_derivatives_of_the_lobe_along_each_unknown(form: Form) -> None:
    lobes = random_lobes(form)
    # off the hemisphere's edge, where the asg form has a kink
    directions = fibonacci_directions(200, dtype=DOUBLE)
    directions = directions[((lobes.axis_z @ directions.mT).abs() > 1e-3).all(0)]
    columns = lobe_images.local_columns(lobes, lobes.axes @ directions.mT)
    torch.testing.assert_close(columns[:, 0], asg.unit_lobes(lobes, directions))
    step = 1e-5
    for unknown in range(5):
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ahead = asg.unit_lobes(coordinates.advance(lobes, move), directions)
        behind = asg.unit_lobes(coordinates.advance(lobes, -move), directions)
        # second order in the step: 1e-10 times third derivatives of up to 1e3
        torch.testing.assert_close(
            columns[:, unknown + 1], (ahead - behind) / (2 * step), atol=1e-6, rtol=1e-5
        )


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("height", [32, 50, 128])
def test_lobes_wider_than_four_texels_are_their_texel_means(form: Form, height: int) -> None:
    for sigma, ratio in ((4.01, 1.0), (4.01, 30.0), (10.0, 5.0)):
        lobes = _wide(form, sigma, height, ratio)
        found = lobe_images.images(lobes.to(torch.float32), grid(height)).values
        expected = texels.unit_texel_means(lobes, height, 2 * height)
        # exponents are differences of numbers as large as the sharpness, rounded to 2^-24 of it
        bound = 1e-6 + 4 * 2**-24 * float(lobes.sharpness.max())
        torch.testing.assert_close(found.double(), expected, rtol=0, atol=bound)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [2.01, 3.0, 3.9])
def test_lobes_two_to_four_texels_wide_are_a_percent_an_axis_off_at_most(
    form: Form, sigma: float
) -> None:
    # the midpoint rule's (1 / sigma)^2 / 24 for each axis that is narrow; 0.2 % for what the mean
    # over a texel's own area differs from the one over its longitudes and latitudes
    axis = 1 / (24 * sigma**2)
    for ratio, narrow_axes in ((1.0, 2), (100.0, 2 if form is Form.SG else 1.01)):
        lobes = _wide(form, sigma, 128, ratio)
        found = lobe_images.images(lobes.to(torch.float32), grid(128)).values
        expected = texels.unit_texel_means(lobes, 128, 256)
        difference = float((found - expected).abs().max())
        assert difference < narrow_axes * axis + 0.002
        assert difference > 0.1 * axis  # not the means themselves


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [2.01, 3.0, 8.0])
def test_sampled_lobes_keep_their_flux(form: Form, sigma: float) -> None:
    lobes = _wide(form, sigma, 128, 2.0)
    values = lobe_images.images(lobes.to(torch.float32), grid(128)).values
    flux = 4 * math.pi * (values * grid(128).share).double().sum(-1)
    # exact areas times values at the centres: (pi / 128)^2 / 24; float32
    torch.testing.assert_close(flux, asg.integral(lobes), rtol=5e-5, atol=0)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [0.1, 0.7, 1.9])
def test_lobes_narrower_than_two_texels_are_averaged_over_each(form: Form, sigma: float) -> None:
    lobes = _wide(form, sigma, 64, 3.0)
    found = lobe_images.images(lobes.to(torch.float32), grid(64)).values
    # directions in float32: 2^-24 sqrt(s) of an exponent of order 1
    _assert_near(found, texels.unit_texel_means(lobes, 64, 128), 2e-4)


def test_narrow_and_wide_lobes_share_an_image() -> None:
    wide, narrow = _wide(Form.SG, 9.0, 32), _wide(Form.SG, 0.5, 32)
    both = _together(wide, narrow)
    shown = lobe_images.images(both.to(torch.float32), grid(32))
    # as above: exponents and directions in float32
    _assert_near(shown.values, texels.unit_texel_means(both, 32, 64), 2e-4)
    expected = shown.values.mT @ shown.lobes.amplitude
    torch.testing.assert_close(shown.radiance, expected.mT)


def _slopes(lobes: Lobes, slope: torch.Tensor, height: int) -> torch.Tensor:
    """Return the slopes as the fit takes them, in float32."""
    single, texel_grid = lobes.to(torch.float32), grid(height)
    near = lobe_images.near_columns(single, texel_grid, height)
    return lobe_images.slopes(lobe_images.images(single, texel_grid), near, slope, texel_grid)


def _contracted(lobes: Lobes, columns: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
    """Sum columns times slope over every texel.  [N, 8]."""
    pulled = columns @ slope.double().mT  # [N, 6, 3]
    shape = (pulled[:, 1:] * lobes.amplitude[:, None]).sum(-1)
    return torch.cat([shape, pulled[:, 0]], dim=-1)


def _scale(lobes: Lobes, columns: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
    """Return the root of the sum of squares: the size of a sum of random signs.  [N, 8]."""
    return _contracted(lobes, columns.square(), slope.square()).abs().sqrt()


@pytest.mark.parametrize("form", list(Form))
def test_slopes_by_moments_are_the_columns_times_the_slope(form: Form) -> None:
    lobes, slope = random_lobes(form), _slope(64)
    lobes = lobes.select(~texels.is_narrow(lobes, 64, lobe_images.NARROW_TEXELS))
    assert lobes.count >= 4
    columns = _dense(lobes, 64)
    found, expected = _slopes(lobes, slope, 64), _contracted(lobes, columns, slope)
    # moments are differences: sums in float32, times a sharpness of up to 50
    difference = (found - expected).abs()
    assert bool((difference <= 1e-4 * _scale(lobes, columns, slope) + 1e-5).all())
    dead = [3, 4] if form is Form.SG else []
    assert not found[:, dead].any()


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [2.5, 4.0, 12.0])
def test_slopes_by_moments_hold_for_lobes_of_a_few_texels(form: Form, sigma: float) -> None:
    lobes, slope = _wide(form, sigma, 64, 1.5), _slope(64)
    columns = _dense(lobes, 64)
    difference = (_slopes(lobes, slope, 64) - _contracted(lobes, columns, slope)).abs()
    # as above; the moments of a lobe along its own width cancel to 1 / s of the lobe
    assert bool((difference <= 5e-4 * _scale(lobes, columns, slope)).all())


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize(
    ("sigma", "bound"),
    [
        # eight parts per sigma for the reference: the midpoint rule's 1 / (24 8^2), three times
        # that for the derivative of a Gaussian
        (0.4, 4e-3),
        (0.8, 4e-3),
        # two nodes are exact to q^4 / 1440, times 15: a Gaussian's fifth derivative by its first
        (1.2, 1e-2),
    ],
)
def test_slopes_of_narrow_lobes_are_the_texel_means_times_the_slope(
    form: Form, sigma: float, bound: float
) -> None:
    lobes, slope = _wide(form, sigma, 16, 2.0), _slope(16)
    columns = _dense(lobes, 16, finer=20)
    difference = (_slopes(lobes, slope, 16) - _contracted(lobes, columns, slope)).abs()
    assert bool((difference <= bound * _scale(lobes, columns, slope)).all())


def _moved(lobes: Lobes, step: torch.Tensor) -> Lobes:
    """Move by a step [N, 8] with differentiable turns of the frame, as for long lobes."""
    about = step[:, :1] * lobes.axis_y - step[:, 1:2] * lobes.axis_x + step[:, 4:5] * lobes.axis_z
    a, b, c = about.unbind(-1)
    none = torch.zeros_like(a)
    cross = torch.stack([none, -c, b, c, none, -a, -b, a, none], dim=-1).reshape(-1, 3, 3)
    axes = lobes.axes @ torch.linalg.matrix_exp(cross).mT
    widths = step[:, 2:3].expand(-1, 2) if lobes.form is Form.SG else step[:, 2:4]
    sharpness = (lobes.sharpness + BROAD) * widths.exp() - BROAD
    return Lobes(axes, sharpness, lobes.amplitude + step[:, 5:], lobes.form)


@pytest.mark.parametrize("form", list(Form))
def test_slopes_are_the_gradient_of_the_evaluated_radiance(form: Form) -> None:
    lobes, slope = random_lobes(form, count=12), _slope(64)
    long = torch.ones(12, dtype=torch.bool) if form is Form.SG else ~coordinates.is_round(lobes)
    lobes = lobes.select(long & ~texels.is_narrow(lobes, 64, lobe_images.NARROW_TEXELS))
    assert lobes.count >= 4
    step = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE, requires_grad=True)
    radiance = asg.evaluate(_moved(lobes, step), _directions(64))
    (expected,) = torch.autograd.grad((radiance * slope.double().mT).sum(), step)
    difference = (_slopes(lobes, slope, 64) - expected).abs()
    # as by moments: float32
    bound = 1e-4 * _scale(lobes, _dense(lobes, 64), slope) + 1e-5
    assert bool((difference <= bound).all())


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sigma", [0.3, 0.9, 2.5])
def test_near_columns_are_differences_of_texel_means(form: Form, sigma: float) -> None:
    lobes = _wide(form, sigma, 64, 2.0)
    near = lobe_images.near_columns(lobes.to(torch.float32), grid(64), 32)
    assert near.lobe.tolist() == [0, 1, 2]
    found = torch.zeros(3, COLUMNS, 64 * 128)
    found[:, :, near.texel] = near.columns
    # directions in float32, 2^-24 sqrt(s); differences of the rule that averages, 1e-4
    _assert_near(found[:, 0], texels.unit_texel_means(lobes, 64, 128), 2e-4)
    _assert_near(found[:, 1:], _differences(lobes, 64), 1e-3)


def test_columns_of_narrow_lobes_are_cell_means_and_of_wide_ones_values_at_the_centres() -> None:
    narrow, wide = _wide(Form.ASG, 0.9, 64, 2.0), _wide(Form.ASG, 12.0, 64, 2.0)
    both = _together(wide, narrow)
    single, cells = both.to(torch.float32), grid(32)
    near = lobe_images.near_columns(single, grid(64), 32)
    assert near.lobe.tolist() == [3, 4, 5]
    columns = lobe_images.cell_columns(single, near, grid(64), cells).unflatten(0, (6, COLUMNS))
    _assert_near(columns[:3], _dense(wide, 32), 1e-5)  # float32
    # four nodes a texel and eight a cell, both exact to 6e-8 2^8
    _assert_near(columns[3:, 0], texels.unit_texel_means(narrow, 32, 64), 2e-4)
    # differences of the rule that averages, each on its own grid
    _assert_near(columns[3:, 1:], coarsen(_differences(narrow, 64), 64, 32), 1e-3)


def test_wide_lobes_have_no_near_columns() -> None:
    lobes = _wide(Form.ASG, 12.0, 64).to(torch.float32)
    near = lobe_images.near_columns(lobes, grid(64), 32)
    assert (len(near.lobe), len(near.texel)) == (0, 0)
    assert near.columns.numel() == 0
