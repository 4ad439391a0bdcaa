# SPDX-License-Identifier: Apache-2.0
"""Texel means against a fine supersampled reference and against the exact flux of the lobe."""

import math

import lobe_samples
import numpy as np
import pytest
import torch
from lobe_samples import FORMS, lobes_of, value_of

from asglight.lobes import Form, Lobes, asg, texels
from asglight.sphere import latlong

HEIGHT, WIDTH = 32, 64

FLUX_BOUND = 0.0026
"""The midpoint rule at the pole for sub-texels of a quarter of sigma: (1/4)^2 / 24."""

OFF_POLE_BOUND = 1e-4
"""Away from the poles the rule is exact but for exact areas times midpoint values: (pi/H)^2 / 24
a sub-texel, and what a lobe of finite width reaches of the pole."""

PLACES = {
    "north pole": (0.5, 0.0),
    "south pole": (0.3, 1.0),
    "a fifth of a texel off the pole": (0.31, 0.2 / HEIGHT),
    "centre of a polar texel": (7.5 / WIDTH, 0.5 / HEIGHT),
    "seam": (0.0, 0.41),
    "seam and a corner": (1.0, 13 / HEIGHT),
    "texel centre": (20.5 / WIDTH, 15.5 / HEIGHT),
    "corner between four texels": (20 / WIDTH, 15 / HEIGHT),
    "edge between two": (20 / WIDTH, 15.5 / HEIGHT),
    "anywhere": (0.3716, 0.6183),
}


def _direction(u: float, v: float) -> tuple[float, float, float]:
    longitude, latitude = math.pi - 2 * math.pi * u, math.pi / 2 - math.pi * v
    across = math.cos(latitude)
    return across * math.sin(longitude), math.sin(latitude), across * math.cos(longitude)


def _lobe(place: str, sharpness: tuple[float, float], form: Form) -> Lobes:
    axes = lobe_samples.pointing([_direction(*PLACES[place])], seed=len(place))
    return lobes_of(axes, sharpness, form)


def _flux(image: torch.Tensor) -> float:
    height, width = image.shape[:2]
    edges = np.sin(np.pi / 2 - np.pi * np.arange(height + 1) / height)
    bands = 2 * np.pi / width * (edges[:-1] - edges[1:])
    return float((image[..., 0].double().numpy() * bands[:, None]).sum())


def _lit(image: torch.Tensor) -> list[list[int]]:
    """Return rows and columns of the texels above a billionth of the brightest.  [H, W]."""
    return torch.nonzero(image > 1e-9 * image.max()).tolist()


FLAT_VARIANCE = (3 - 3 / 4 + 1 / 9) / (3 - 3 / 2 + 1 / 3)
"""Mean x^2 of a narrow flat lobe, of that of an asg lobe: z (3 E - 3 E^2 + E^3), term by term."""


def _terms_share(form: Form) -> float:
    """Return the absolute light of a lobe's terms, of its own: by so much do errors of each add."""
    return (3 + 3 / 2 + 1 / 3) / (3 - 3 / 2 + 1 / 3) if form is Form.FLAT else 1.0


def _supersampled(lobe: Lobes, height: int, width: int, order: int) -> np.ndarray:
    """Average over every texel by Gauss and Legendre, `order` nodes a side, cos(latitude) weights.

    Texels farther from the lobe than seven of its wider sigmas stay 0: below exp(-24).
    """
    nodes, weights = np.polynomial.legendre.leggauss(order)
    share = (nodes + 1) / 2
    axes, s = lobe.axes[0].numpy(), lobe.sharpness[0].numpy()
    sigma = 1 / math.sqrt((1 if lobe.form is Form.SG else 2) * s.min())
    reach = math.cos(min(math.pi, 7 * sigma + math.pi / height))
    means = np.zeros((height, width))
    for row, column in np.ndindex(height, width):
        centre = axes[2] @ np.array(_direction((column + 0.5) / width, (row + 0.5) / height))
        if (abs(centre) if lobe.form is Form.BINGHAM else centre) < reach:
            continue
        longitude = np.pi - 2 * np.pi * (column + share) / width
        latitude = (np.pi / 2 - np.pi * (row + share) / height)[:, None]
        d = np.stack(
            np.broadcast_arrays(
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
                np.cos(latitude) * np.cos(longitude),
            ),
            axis=-1,
        )
        area = weights[:, None] * np.cos(latitude) * weights
        values = value_of(lobe.form, axes, s, d.reshape(-1, 3)).reshape(order, order)
        means[row, column] = (area * values).sum() / area.sum()
    return means


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("sharpness", [3.0, 30.0, 1e3, 1e5])
@pytest.mark.parametrize("ratio", [1.0, 20.0])
def test_flux_of_the_texels_is_the_flux_of_the_lobe(
    form: Form, place: str, sharpness: float, ratio: float
) -> None:
    lobe = _lobe(place, (sharpness, sharpness / ratio), form)
    found = _flux(texels.texel_means(lobe, HEIGHT, WIDTH))
    polar = "pol" in place
    bound = 1.01 * FLUX_BOUND if polar else OFF_POLE_BOUND + (math.pi / HEIGHT) ** 2 / 24
    if sharpness / ratio < 30 and not polar:
        bound = FLUX_BOUND  # wide or long enough to reach a pole
    bound *= _terms_share(form)
    assert found == pytest.approx(float(asg.flux(lobe)[0, 0]), rel=bound)


@pytest.mark.parametrize("form", FORMS)
def test_flux_holds_on_both_sides_of_the_narrow_limit(form: Form) -> None:
    width_factor = {Form.SG: 1, Form.FLAT: 2 / FLAT_VARIANCE}.get(form, 2)
    limit = 1 / (width_factor * (texels.NARROW_WIDTH_TEXELS * math.pi / HEIGHT) ** 2)
    for sharpness, narrow in ((limit * 1.01, True), (limit * 0.99, False)):
        for place in PLACES:
            lobe = _lobe(place, (sharpness, sharpness), form)
            assert texels.is_narrow(lobe, HEIGHT).tolist() == [narrow]
            found = _flux(texels.texel_means(lobe, HEIGHT, WIDTH))
            bound = FLUX_BOUND * _terms_share(form)
            assert found == pytest.approx(float(asg.flux(lobe)[0, 0]), rel=bound)


def test_width_is_the_standard_deviation_of_the_sharper_axis() -> None:
    axes = lobe_samples.random_axes(1)
    for pair in ((200.0, 2.0), (2.0, 200.0)):
        assert texels.lobe_width(lobes_of(axes, pair, Form.ASG)).item() == pytest.approx(0.05)
        assert texels.lobe_width(lobes_of(axes, pair, Form.BINGHAM)).item() == pytest.approx(0.05)
    sg = lobes_of(axes, (400.0, 400.0), Form.SG)
    assert texels.lobe_width(sg).item() == pytest.approx(0.05)
    flat = lobes_of(axes, (200.0 * FLAT_VARIANCE, 2.0), Form.FLAT)
    assert texels.lobe_width(flat).item() == pytest.approx(0.05)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("sharpness", [(40.0, 40.0), (900.0, 60.0), (6e3, 150.0)])
@pytest.mark.parametrize(
    "place", ["north pole", "seam and a corner", "corner between four texels", "anywhere"]
)
def test_texel_means_equal_a_fine_supersampled_reference(
    form: Form, sharpness: tuple[float, float], place: str
) -> None:
    height, width = 8, 16
    lobe = _lobe(place, sharpness, form)
    assert texels.is_narrow(lobe, height).all()
    expected = _supersampled(lobe, height, width, order=110)
    found = texels.texel_means(lobe, height, width)[..., 0].numpy()
    # sampling in steps of sigma / 4 is 0.26 % high an axis where a whole texel is within the peak,
    # nothing where the texel holds the lobe
    np.testing.assert_allclose(found, expected, atol=0.0055 * expected.max())


@pytest.mark.parametrize("form", FORMS)
def test_wide_lobes_are_sampled_at_the_centres(form: Form) -> None:
    # the narrowest term of the flat form has three times the sharpness
    widest = {Form.SG: 6.4, Form.FLAT: 3.2 / 3}.get(form, 3.2)
    lobe = _lobe("texel centre", (widest, widest), form)
    assert not texels.is_narrow(lobe, HEIGHT).any()
    centres = latlong.directions(HEIGHT, WIDTH, dtype=torch.float64).reshape(-1, 3)
    expected = value_of(form, lobe.axes[0].numpy(), lobe.sharpness[0].numpy(), centres.numpy())
    found = texels.unit_texel_means(lobe, HEIGHT, WIDTH)[0].numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    # at the peak of a lobe that is just wide enough, (1/4)^2 / 24 = 0.26 % an axis, and 0.07 % for
    # the factor z of the asg form
    mean = _supersampled(lobe, HEIGHT, WIDTH, order=6).ravel()
    # a flat lobe so wide has 0.7 of its peak where z is 0: an eighth of a texel's diagonal of that
    bound = 0.7 * math.sqrt(2) * math.pi / HEIGHT / 8 if form is Form.FLAT else 0.0
    np.testing.assert_allclose(found, mean, atol=0.006 + bound)


@pytest.mark.parametrize("form", FORMS)
def test_energy_of_a_pinpoint_lobe_falls_in_the_texel_it_points_at(form: Form) -> None:
    lobe = _lobe("anywhere", (1e6, 1e6), form)
    image = texels.texel_means(lobe, HEIGHT, WIDTH)[..., 0]
    u, v = PLACES["anywhere"]
    row, column = int(v * HEIGHT), int(u * WIDTH)
    lit = _lit(image)
    opposite = [HEIGHT - 1 - row, (column + WIDTH // 2) % WIDTH]
    expected = [[row, column], opposite] if form is Form.BINGHAM else [[row, column]]
    assert lit == sorted(expected)
    # four nodes a panel of two sigmas: 6e-8 2^8
    bound = 2e-5 * _terms_share(form)
    assert _flux(image[..., None]) == pytest.approx(float(asg.flux(lobe)[0, 0]), rel=bound)


def test_energy_of_a_pinpoint_lobe_on_a_corner_is_shared_by_four_texels() -> None:
    lobe = _lobe("corner between four texels", (1e6, 1e6), Form.ASG)
    image = texels.texel_means(lobe, HEIGHT, WIDTH)[..., 0]
    assert _lit(image) == [[14, 19], [14, 20], [15, 19], [15, 20]]
    bright = image[14:16, 19:21]
    # energy is shared, not the mean: the lower row has more area. Halves only to 3e-5, because the
    # edge is a parallel, which bends by tan(latitude) within the lobe
    edges = [math.cos(math.pi * j / HEIGHT) for j in (14, 15, 16)]
    energy = bright * torch.tensor([[edges[0] - edges[1]], [edges[1] - edges[2]]])
    np.testing.assert_allclose(energy.numpy(), energy.mean().item(), rtol=1e-4)


def test_energy_of_a_pinpoint_lobe_on_the_seam_is_shared_by_both_ends() -> None:
    lobe = _lobe("seam", (1e6, 1e6), Form.ASG)
    image = texels.texel_means(lobe, HEIGHT, WIDTH)[..., 0]
    assert {column for _, column in _lit(image)} == {0, WIDTH - 1}
    np.testing.assert_allclose(
        image[:, 0].numpy(), image[:, -1].numpy(), atol=1e-9 * float(image.max())
    )


def test_texel_means_add_narrow_and_wide_lobes_with_their_colours() -> None:
    places = ["anywhere", "seam", "north pole"]
    sharpness = [(5.0, 2.0), (1e4, 1e3), (3e5, 3e5)]
    single = [_lobe(p, s, Form.ASG) for p, s in zip(places, sharpness, strict=True)]
    colours = torch.tensor([[1, 2, 3], [40, 0, 5], [0, 0, 7e3]], dtype=torch.float64)
    together = Lobes(
        torch.cat([one.axes for one in single]),
        torch.cat([one.sharpness for one in single]),
        colours,
    )
    expected = torch.zeros(HEIGHT, WIDTH, 3, dtype=torch.float64)
    for one, colour in zip(single, colours, strict=True):
        expected += texels.texel_means(one, HEIGHT, WIDTH) * colour
    found = texels.texel_means(together, HEIGHT, WIDTH)
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-12)


def test_texel_means_in_float32_keep_the_flux() -> None:
    for place in PLACES:
        lobe = _lobe(place, (2e4, 3e3), Form.ASG).to(torch.float32)
        found = texels.texel_means(lobe, HEIGHT, WIDTH)
        assert found.dtype == torch.float32
        wide = texels.texel_means(lobe.to(torch.float64), HEIGHT, WIDTH)
        # sub-texel directions rounded to float32: errors of 2^-24 sqrt(s), averaged out
        assert _flux(found) == pytest.approx(_flux(wide), rel=2e-6)


def test_pieces_of_the_subtexels_give_the_same_means(monkeypatch: pytest.MonkeyPatch) -> None:
    lobe = _lobe("north pole", (500.0, 300.0), Form.ASG)
    whole = texels.texel_means(lobe, HEIGHT, WIDTH)
    monkeypatch.setattr(texels, "SAMPLES_AT_ONCE", 50)
    torch.testing.assert_close(texels.texel_means(lobe, HEIGHT, WIDTH), whole)


def test_texels_not_reached_hold_nothing_worth_keeping() -> None:
    lobe = _lobe("anywhere", (400.0, 90.0), Form.BINGHAM)
    reached = texels.texels_reached(lobe, (HEIGHT, 2 * HEIGHT))
    expected = _supersampled(lobe, HEIGHT, WIDTH, order=6).ravel()
    expected[reached.numpy()] = 0
    assert expected.max() < math.exp(-texels.CUTOFF)
    assert len(reached) < HEIGHT * WIDTH / 3


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("height", [1, 2, 3, 5, 8, 12])
@pytest.mark.parametrize("sharpness", [(1e-3, 1e-3), (0.5, 0.1), (3.0, 0.2)])
def test_texels_of_a_coarse_grid_hold_the_mean_of_broad_lobes(
    form: Form, height: int, sharpness: tuple[float, float]
) -> None:
    lobes = _lobe("anywhere", sharpness, form)
    factor = -(-96 // height)
    fine = texels.texel_means(lobes, factor * height, 2 * factor * height)
    blocks = latlong.reduce(fine, height, 2 * height)
    found = texels.texel_means(lobes, height, 2 * height)
    # the horizon of the asg form is a bend within a texel, which Gauss's rule sees to 1 %
    torch.testing.assert_close(found, blocks, rtol=0, atol=0.01 * float(blocks.max()))
