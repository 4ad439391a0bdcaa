# SPDX-License-Identifier: Apache-2.0
"""The display pass: exposure, view transforms, channels, comparisons, in the published numbers."""

import math

import matplotlib
import moderngl
import numpy as np
import pytest

from asglight.viewer.gl import passes
from asglight.viewer.gl.display_pass import DIVERGING_SCALE, STOPS_SCALE, DisplayPass
from asglight.viewer.gl.passes import Picture
from asglight.viewer.state.display import Channel, Comparison, Display, ViewTransform
from asglight.viewer.uniforms.shader_defines import SURROUND

# An 8-bit target rounds to the nearest of 255 steps; OpenGL allows 0.6 of a step where halves meet.
STEP = 0.6 / 255


def texture(opengl: moderngl.Context, radiance: np.ndarray, alpha: float = 1.0) -> moderngl.Texture:
    """Upload radiance [H, W, 3], multiplied by its coverage already."""
    height, width = radiance.shape[:2]
    coverage = np.full((height, width, 1), alpha)
    rgba = np.concatenate([radiance, coverage], axis=2).astype(np.float32)
    return opengl.texture((width, height), 4, rgba.tobytes(), dtype="f4")


def displayed(
    opengl: moderngl.Context,
    fit: Picture,
    display: Display | None = None,
    reference: Picture | None = None,
    comparison: Comparison = Comparison.FIT,
    **options: float,
) -> np.ndarray:
    """Run the display pass and return 8-bit sRGB [H, W, 3]."""
    target = passes.display_target(opengl, fit.front.size)
    DisplayPass(opengl).draw(
        fit, reference or fit, display or Display(), comparison, target, **options
    )
    width, height = fit.front.size
    return np.frombuffer(target.read(components=3, alignment=1), np.uint8).reshape(height, width, 3)


def one(opengl: moderngl.Context, value: float) -> Picture:
    return Picture(texture(opengl, np.full((1, 1, 3), value)))


def srgb(linear: np.ndarray) -> np.ndarray:
    """Encode [0, 1] as IEC 61966-2-1 prints it."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("exposure_ev", [0.0, -3.0, 2.5])
def test_transfer_is_the_srgb_formula(opengl: moderngl.Context, exposure_ev: float) -> None:
    ramp = np.concatenate([np.linspace(0, 0.01, 300), np.geomspace(0.01, 1e5, 724)])
    radiance = np.stack([ramp, ramp[::-1], 0.5 * ramp], axis=-1).reshape(32, 32, 3)
    shown = displayed(opengl, Picture(texture(opengl, radiance)), Display(exposure_ev))
    expected = srgb(np.clip(radiance.astype(np.float32) * 2.0**exposure_ev, 0, 1))
    np.testing.assert_allclose(shown / 255, expected, rtol=0, atol=STEP)


@pytest.mark.parametrize(("linear", "code"), [(0.0, 0), (0.18, 118), (0.5, 188), (1.0, 255)])
def test_transfer_has_the_published_values(
    opengl: moderngl.Context, linear: float, code: int
) -> None:
    assert (displayed(opengl, one(opengl, linear)) == code).all()


def test_intensity_adds_to_the_exposure(opengl: moderngl.Context) -> None:
    shown = displayed(opengl, one(opengl, 0.125), Display(-1.0), gain_ev=3.0)
    assert (shown == 188).all()  # 0.125 * 4 = 0.5


@pytest.mark.parametrize("value", [0.0, 0.01, 0.18, 0.5, 1.0, 4.0, 1e9])
def test_filmic_is_the_curve_of_narkowicz(opengl: moderngl.Context, value: float) -> None:
    x = value
    linear = np.clip((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    shown = displayed(opengl, one(opengl, value), Display(transform=ViewTransform.FILMIC))
    np.testing.assert_allclose(shown / 255, srgb(linear), atol=STEP)


@pytest.mark.parametrize("value", [-1.0, 1e30])
@pytest.mark.parametrize("transform", [ViewTransform.SRGB, ViewTransform.FILMIC])
def test_values_beyond_the_screen_are_clipped(
    opengl: moderngl.Context, value: float, transform: ViewTransform
) -> None:
    for exposure_ev in (0.0, 20.0):
        # 40 stops more leave float32: infinity is white as well
        display = Display(exposure_ev, transform)
        shown = displayed(opengl, one(opengl, value), display, gain_ev=2 * exposure_ev)
        assert (shown == (255 if value > 0 else 0)).all()


@pytest.mark.parametrize("stops", [-9, -8, -3, 0, 2.5, 8, 12])
def test_false_colour_takes_stops_from_middle_grey(opengl: moderngl.Context, stops: float) -> None:
    display = Display(exposure_ev=1.0, transform=ViewTransform.FALSE_COLOUR)
    shown = displayed(opengl, one(opengl, 0.18 * 2.0 ** (stops - 1)), display)
    place = min(max(0.5 + stops / 16, 0), 1)
    expected = matplotlib.colormaps[STOPS_SCALE](np.linspace(0, 1, 256))[:, :3]
    wanted = [np.interp(place * 255, np.arange(256), column) for column in expected.T]
    np.testing.assert_allclose(shown[0, 0] / 255, wanted, atol=2 / 255)  # the scale has 8 bits too


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        (Channel.RED, 0.2),
        (Channel.GREEN, 0.5),
        (Channel.BLUE, 0.9),
        (Channel.LUMINANCE, 0.2126 * 0.2 + 0.7152 * 0.5 + 0.0722 * 0.9),
    ],
)
def test_channels_are_shown_as_grey(
    opengl: moderngl.Context, channel: Channel, expected: float
) -> None:
    picture = Picture(texture(opengl, np.array([[[0.2, 0.5, 0.9]]])))
    shown = displayed(opengl, picture, Display(channel=channel)) / 255
    np.testing.assert_allclose(shown, np.full((1, 1, 3), srgb(np.array(expected))), atol=STEP)


def test_zebra_marks_what_clips_and_nothing_else(opengl: moderngl.Context) -> None:
    radiance = np.full((16, 16, 3), 0.5)
    radiance[:, 8:, 1] = 1.01
    shown = displayed(opengl, Picture(texture(opengl, radiance)), Display(zebra=True))
    assert (shown[:, :8] == 188).all()
    stripes = shown[:, 8:]
    assert set(np.unique(stripes)) == {0, 255}
    assert stripes.mean() == pytest.approx(127.5)  # as much black as white


def test_row_0_of_the_image_is_row_0_of_the_picture(opengl: moderngl.Context) -> None:
    radiance = np.zeros((2, 3, 3))
    radiance[0, 2, 1] = 1.0
    shown = displayed(opengl, Picture(texture(opengl, radiance)))
    assert np.argwhere(shown).tolist() == [[0, 2, 1]]


def test_coverage_mixes_with_the_background_in_radiance(opengl: moderngl.Context) -> None:
    front = texture(opengl, np.full((1, 1, 3), 0.1), alpha=0.25)
    picture = Picture(front, texture(opengl, np.full((1, 1, 3), 0.4)))
    shown = displayed(opengl, picture) / 255
    np.testing.assert_allclose(shown, np.full((1, 1, 3), srgb(np.array(0.4))), atol=STEP)


def test_without_background_coverage_mixes_with_the_surround(opengl: moderngl.Context) -> None:
    picture = Picture(texture(opengl, np.full((1, 1, 3), 0.25), alpha=0.5))
    shown = displayed(opengl, picture) / 255
    expected = 0.5 * srgb(np.array(0.5)) + 0.5 * np.array(SURROUND)
    np.testing.assert_allclose(shown[0, 0], expected, atol=STEP)


def test_wipe_shows_the_fit_on_the_left(opengl: moderngl.Context) -> None:
    fit = Picture(texture(opengl, np.full((1, 8, 3), 1.0)))
    reference = Picture(texture(opengl, np.zeros((1, 8, 3))))
    shown = displayed(opengl, fit, None, reference, Comparison.WIPE, wipe=0.25)
    assert shown[0, :, 0].tolist() == [255, 255, 0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("comparison", "fit", "reference", "place"),
    [
        (Comparison.DIFFERENCE, 0.5, 0.5, 0.5),
        (Comparison.DIFFERENCE, 0.75, 0.5, 0.75),  # exposed by one stop: 2 * 0.25
        (Comparison.DIFFERENCE, 0.0, 9.0, 0.0),
        (Comparison.RATIO, 0.5, 0.5, 0.5),
        (Comparison.RATIO, 2.0, 1.0, 0.5 + 1 / 6),
        (Comparison.RATIO, 1.0, 16.0, 0.0),
        (Comparison.RATIO, 0.0, 0.0, 0.5),
    ],
)
def test_differences_have_their_place_on_the_scale(
    opengl: moderngl.Context, comparison: Comparison, fit: float, reference: float, place: float
) -> None:
    pair = one(opengl, fit), one(opengl, reference)
    shown = displayed(opengl, pair[0], Display(1.0), pair[1], comparison)
    colours = matplotlib.colormaps[DIVERGING_SCALE](np.linspace(0, 1, 256))[:, :3]
    wanted = [np.interp(place * 255, np.arange(256), column) for column in colours.T]
    np.testing.assert_allclose(shown[0, 0] / 255, wanted, atol=2 / 255)


def test_background_is_a_perspective_of_90_degrees(opengl: moderngl.Context) -> None:
    """A map whose value is its direction shows where each pixel looks."""
    rows = 64
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(2 * rows) + 0.5) / 2 / rows)
    longitude, latitude = math.pi - 2 * math.pi * u.T, math.pi / 2 - math.pi * v.T
    direction = np.stack(
        [
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
            np.cos(latitude) * np.cos(longitude),
        ],
        axis=-1,
    )
    latlong = texture(opengl, direction)
    latlong.filter = moderngl.LINEAR, moderngl.LINEAR
    latlong.repeat_x, latlong.repeat_y = True, False
    target = passes.radiance_target(opengl, (41, 21))
    passes.BackgroundPass(opengl).draw(latlong, np.eye(3), target)
    seen = np.frombuffer(target.read(components=3, dtype="f4"), np.float32).reshape(21, 41, 3)
    # The camera stands at +Z and looks to -Z, its right is +X.
    for row, column, expected in (
        (10, 20, [0, 0, -1]),
        (10, 40, [40 / 41, 0, -1]),
        (0, 20, [0, 20 / 41, -1]),
    ):
        found = seen[row, column] / np.linalg.norm(seen[row, column])
        wanted = np.array(expected) / np.linalg.norm(expected)
        np.testing.assert_allclose(found, wanted, atol=5e-3)  # linear between texels of 3 degrees
