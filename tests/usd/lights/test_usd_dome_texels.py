# SPDX-License-Identifier: Apache-2.0
"""What linear interpolation makes of a dome's texels, held against the lobes' exact moments."""

import itertools
import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.usd.lights import dome_texels

HEIGHT = 128
TEXEL = math.pi / HEIGHT
FINER = 6

PLACES = {
    "centre": (64, 128.5),
    "between": (61.5, 190.0),
    "quarter": (40.25, 255.75),  # over the seam
    "steep": (19.6, 60.2),
}
"""Of the lobe's axis, in rows and columns from the first texel's corner."""


def interpolated(lobes: Lobes, height: int) -> torch.Tensor:
    """Return the texels of one frame.  [H, 2H, 3]."""
    return dome_texels.images(lobes[None], height)[0]()


def direction(row: float, column: float) -> torch.Tensor:
    """Return where a place of the image is; texel centres are at halves.  [3]."""
    lat, lon = math.pi * (0.5 - row / HEIGHT), math.pi * (1 - column / HEIGHT)
    x, y, z = math.cos(lat) * math.sin(lon), math.sin(lat), math.cos(lat) * math.cos(lon)
    return torch.tensor([x, y, z], dtype=torch.float64)


def lobe(place: str, sigma_x: float, sigma_y: float, form: Form = Form.ASG) -> Lobes:
    """Return a lobe of these standard deviations in texels, its axes turned by 25 degrees."""
    axes = axes_around(direction(*PLACES[place])[None])[0]
    c, s = math.cos(0.44), math.sin(0.44)
    axes = torch.stack([c * axes[0] + s * axes[1], c * axes[1] - s * axes[0], axes[2]])
    variance = (torch.tensor([sigma_x, sigma_y]).double() * TEXEL) ** 2
    sharpness = 1 / variance if form is Form.SG else 0.5 / variance
    colour = torch.tensor([[3.0, 2.0, 1.0]]).double()
    return Lobes(axes[None], sharpness[None], colour, form)


def shown(image: torch.Tensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Interpolate an image as renderers do, by NumPy: directions [T, 3] and flux there [T, 3].

    Rows and columns of nothing but dark texels are left out.
    """
    values = image.double().numpy()
    y = (np.arange(FINER * HEIGHT) + 0.5) / FINER - 0.5
    x = (np.arange(2 * FINER * HEIGHT) + 0.5) / FINER - 0.5
    # all of them together are less than 1e-8 of the light
    lit = values.sum(-1) > 1e-14 * values.sum()
    y, x = (at[_near(at, lit.any(axis))] for at, axis in ((y, 1), (x, 0)))
    row, column = np.floor(y).astype(int), np.floor(x).astype(int)
    down, right = (y - row)[:, None, None], (x - column)[None, :, None]
    upper, lower = (values[np.clip(r, 0, HEIGHT - 1)] for r in (row, row + 1))
    columns = column % (2 * HEIGHT), (column + 1) % (2 * HEIGHT)
    upper, lower = (
        (1 - right) * a[:, columns[0]] + right * a[:, columns[1]] for a in (upper, lower)
    )
    fine = (1 - down) * upper + down * lower
    lat, lon = np.pi * (0.5 - (y + 0.5) / HEIGHT), np.pi * (1 - (x + 0.5) / HEIGHT)
    lat, lon = np.meshgrid(lat, lon, indexing="ij")
    where = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], -1)
    flux = fine * ((TEXEL / FINER) ** 2 * np.cos(lat))[..., None]
    return where.reshape(-1, 3), flux.reshape(-1, 3)


def _near(at: NDArray[np.float64], lit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which places lie between texels of which one is lit; the last is next to the first."""
    before = np.floor(at).astype(int)
    return lit[before % len(lit)] | lit[(before + 1) % len(lit)]


SIGMAS = ((0.85, 0.85), (1.1, 1.1), (0.8, 3.0), (1.2, 9.0), (5.0, 7.0))


@pytest.mark.parametrize(
    ("form", "sigmas", "place"),
    [
        *((Form.ASG, *pair) for pair in itertools.product(SIGMAS, PLACES)),
        *((Form.BINGHAM, *pair) for pair in zip(SIGMAS, itertools.cycle(PLACES), strict=False)),
    ],
)
def test_what_is_shown_has_the_lobes_moments(
    form: Form, sigmas: tuple[float, float], place: str
) -> None:
    one = lobe(place, *sigmas, form)
    directions, flux = shown(interpolated(one, HEIGHT))
    # cos(latitude) over a tent of 2.8 degrees: 2e-4, and float32
    np.testing.assert_allclose(flux.sum(0), asg.flux(one)[0].numpy(), rtol=5e-4)
    local = directions @ one.axes[0].numpy().T
    share = flux[:, 0] / flux[:, 0].sum()
    exact = asg.moments(one)
    squares = (exact.second[0] / exact.zeroth[0]).numpy()
    # texels narrow with latitude, over a lobe too: a fifth of a tent at 62 degrees
    np.testing.assert_allclose(share @ local**2, squares, rtol=1e-3, atol=0.033 * TEXEL**2)
    assert abs(share @ (local[:, 0] * local[:, 1])) < 0.033 * TEXEL**2
    if form is Form.ASG:
        np.testing.assert_allclose(share @ local[:, :2], 0, atol=0.02 * TEXEL)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("form", Form)
def test_a_point_keeps_flux_and_direction(form: Form, place: str) -> None:
    one = lobe(place, 0.1, 0.1, form)
    image = interpolated(one, HEIGHT)
    assert float(image.min()) >= 0
    directions, flux = shown(image)
    np.testing.assert_allclose(flux.sum(0), asg.flux(one)[0].numpy(), rtol=5e-4)
    share = flux[:, 0] / flux[:, 0].sum()
    local = directions @ one.axes[0].numpy().T
    if form is not Form.BINGHAM:
        # mean radiances over texels put it half a texel off
        np.testing.assert_allclose(share @ local[:, :2], 0, atol=0.02 * TEXEL)
    # the tent, 1/6 each way, and 1/4 more between two texels each way
    assert share @ (local[:, :2] ** 2).sum(1) < (2 / 6 + 2 / 4 + 0.02) * TEXEL**2


def test_a_point_in_the_middle_of_a_texel_is_that_texel() -> None:
    axes = axes_around(direction(20.5, 40.5)[None])
    one = Lobes(axes, torch.full((1, 2), 1e6).double(), torch.ones(1, 3).double())
    image = interpolated(one, HEIGHT)[..., 0]
    # a lobe of 0.04 degrees reaches the neighbours by a hundredth
    assert float(image[20, 40]) > 0.95 * float(image.sum())


def test_lobes_of_all_widths_add_up() -> None:
    lobes = [lobe("between", 0.2, 0.2), lobe("steep", 0.4, 6.0), lobe("quarter", 9.0, 4.0)]
    axes, sharpness, amplitude = (
        torch.cat(parts)
        for parts in zip(*((o.axes, o.sharpness, o.amplitude) for o in lobes), strict=True)
    )
    together = Lobes(axes, sharpness, amplitude)
    apart = sum(interpolated(one, HEIGHT) for one in lobes)
    torch.testing.assert_close(interpolated(together, HEIGHT), apart)


@pytest.mark.parametrize("sigma", [0.3, 1.0, 4.0, 12.0])
def test_sg_lobes_keep_flux_and_spread(sigma: float) -> None:
    one = lobe("quarter", sigma, sigma, Form.SG)
    directions, flux = shown(interpolated(one, HEIGHT))
    np.testing.assert_allclose(flux.sum(0), asg.flux(one)[0].numpy(), rtol=5e-4)
    share = flux[:, 0] / flux[:, 0].sum()
    exact = asg.moments(one)
    spread = 1 - float(exact.first[0] / exact.zeroth[0])
    found = 1 - share @ (directions @ one.axis_z[0].numpy())
    # those of more than 0.05 radian are not narrowed: 1/6 square texel each way
    assert found == pytest.approx(spread, abs=(1 / 6 + 0.3 * (sigma < 0.5) + 0.01) * TEXEL**2)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("height", [9, 64])
def test_texels_of_broad_lobes_are_the_narrowed_lobes_at_the_centres(
    form: Form, height: int
) -> None:
    """Held against float64 over the whole sphere: rows are taken apart and far lobes left out."""
    random = np.random.default_rng(7)
    towards = torch.from_numpy(random.normal(size=(12, 3)))
    axes = axes_around(towards / towards.norm(dim=-1, keepdim=True))
    texel = math.pi / height
    sigma = texel * torch.from_numpy(random.uniform(1.2, 12, (12, 2)))
    sharpness = (1 if form is Form.SG else 0.5) / sigma.square()
    if form is Form.SG:
        sharpness = sharpness.amin(-1, keepdim=True).expand(-1, 2).clamp(max=300.0)
    if form is Form.FLAT:
        sharpness = sharpness / 2
    amplitude = torch.from_numpy(random.uniform(0.5, 2, (12, 3)))
    lobes = Lobes(axes, sharpness.contiguous(), amplitude, form)
    narrowed = lobes if form is Form.SG else dome_texels.narrowed(lobes, texel, dome_texels.TENT)
    centres = latlong.directions(height, 2 * height, dtype=torch.float64).view(-1, 3)
    wanted = asg.evaluate(narrowed, centres).view(height, 2 * height, 3)
    found = interpolated(lobes, height).double()
    error = (found - wanted).abs()
    assert float((error / wanted.clamp(min=1e-3)).max()) < 1e-5
    assert float(error.max() / wanted.max()) < 2e-6


def test_frames_are_what_each_of_them_is_alone() -> None:
    """Frames are narrowed together; each image is that of its lobes alone."""
    shapes = [(0.3, 0.3), (0.2, 5.0), (1.5, 4.0), (9.0, 9.0)]
    frames = [
        [lobe(place, *shape) for place, shape in zip(PLACES, row, strict=True)]
        for row in (shapes, shapes[::-1])
    ]
    alone = [lobes_together(row) for row in frames]
    together = dome_texels.images(stack(alone), HEIGHT)
    for lobes, image in zip(alone, together, strict=True):
        assert torch.equal(image(), interpolated(lobes, HEIGHT))


def lobes_together(parts: list[Lobes]) -> Lobes:
    return Lobes(
        torch.cat([one.axes for one in parts]),
        torch.cat([one.sharpness for one in parts]),
        torch.cat([one.amplitude for one in parts]),
        parts[0].form,
    )


@pytest.mark.parametrize("height", [24, 64, 256])
def test_broad_lobes_are_narrowed_and_taken_at_the_centres_of_every_row(height: int) -> None:
    """Of two frames; most of the narrower ones' rows are left out, and show none of them."""
    texel = math.pi / height
    axes = axes_around(torch.stack([direction(20, 30), direction(64, 90), direction(100, 200)]))
    sharpness = torch.tensor([[900.0, 700.0], [150.0, 90.0], [2.0, 1.5]]).double()
    sharpness = sharpness.clamp(max=0.4 / texel**2)
    light = torch.tensor([[[9.0, 1, 1], [1, 5, 1], [1, 1, 1]], [[0, 0, 2], [7, 7, 7], [0, 1, 0]]])
    shot = stack([Lobes(axes, sharpness, colours.double()) for colours in light])
    centres = latlong.directions(height, 2 * height, dtype=torch.float64).view(-1, 3)
    for frame, image in enumerate(dome_texels.images(shot, height)):
        narrow = dome_texels.narrowed(shot[frame], texel, dome_texels.TENT)
        wanted = asg.evaluate(narrow, centres).view(height, 2 * height, 3)
        torch.testing.assert_close(image().double(), wanted, rtol=2e-5, atol=1e-7)
