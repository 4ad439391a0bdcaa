# SPDX-License-Identifier: Apache-2.0
"""A lobe in degrees, stops and kelvin: what is set is met, and nothing else changes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from pxr import UsdLux
from scipy.spatial.transform import Rotation
from usd_tracks import moving

from asglight.keys.lobes import as_lobes
from asglight.keys.rectangles import Card
from asglight.lobes import Form, Lobes, asg
from asglight.usd.lights.colour_temperature import KELVIN_LIMITS, rgb_of, temperature_of
from asglight.viewer.state.edits.absolute import colour_edit, edit_of, lamp_of
from asglight.viewer.state.edits.applying import apply
from asglight.viewer.state.edits.edit import Span

FIELDS = ("azimuth", "elevation", "roll", "width", "height", "intensity")

FLOAT32_DEG = 2e-4
"""Degrees: a float32 axis is known to 1e-7, and near the zenith azimuth and roll to a thousandth of
that; both are further off here."""


def lamp(azimuth: float, elevation: float, roll: float, sharpness: tuple[float, float]) -> Lobes:
    """Return a lobe that stands as told, built by scipy's rotations."""
    # from +Z, x to +X: roll about z, then up about -X, then around Y
    turned = Rotation.from_euler("YXZ", [azimuth, -elevation, roll], degrees=True)
    axes = torch.tensor(turned.as_matrix().T, dtype=torch.float32)
    return Lobes(axes, torch.tensor(sharpness), torch.tensor([0.36, 0.36, 0.36]))


@pytest.mark.parametrize("azimuth", [-170.0, -30.0, 0.0, 100.0])
@pytest.mark.parametrize("elevation", [-60.0, 0.0, 45.0])
@pytest.mark.parametrize("roll", [-120.0, 0.0, 30.0])
def test_a_lobe_is_described_as_it_was_built(azimuth, elevation, roll):
    found = lamp_of(lamp(azimuth, elevation, roll, (50.0, 20.0)))
    assert found.azimuth == pytest.approx(azimuth, abs=FLOAT32_DEG)
    assert found.elevation == pytest.approx(elevation, abs=FLOAT32_DEG)
    assert found.roll == pytest.approx(roll, abs=FLOAT32_DEG)
    assert found.intensity == pytest.approx(1.0, abs=1e-5)  # 0.36 is a stop over 0.18
    assert found.radiance == pytest.approx(0.36, rel=1e-5)


@pytest.mark.parametrize("form", list(Form))
def test_width_and_height_are_where_the_lobe_has_half_of_its_peak(form):
    sharpness = (80.0, 80.0) if form is Form.SG else (80.0, 10.0)
    lobe = replace(lamp(20.0, 10.0, 0.0, sharpness), form=form)
    found = lamp_of(lobe)
    for angle, across in ((found.width, lobe.axis_x), (found.height, lobe.axis_y)):
        half = math.radians(angle / 2)
        direction = math.cos(half) * lobe.axis_z + math.sin(half) * across
        value = asg.unit_lobes(lobe[None].to(torch.float64), direction[None].double())
        assert float(value) == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("frame", [None, 1])
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("azimuth", -75.0),
        ("elevation", 33.0),
        ("roll", 12.0),
        ("width", 7.5),
        ("height", 21.0),
        ("intensity", 3.25),
    ],
)
def test_what_is_set_is_met_and_the_rest_stays(form, frame, field, value):
    span = None if frame is None else Span.at(frame)
    before = moving(range(3), form=form)
    if form is Form.SG:
        before.lobes.sharpness[..., 1] = before.lobes.sharpness[..., 0]
    lobe = before.lobes[1, 2]
    after = apply(before, edit_of(lobe, (2, span), field, value))
    was, found = lamp_of(lobe), lamp_of(after.lobes[1, 2])
    tolerance = 1e-3
    assert getattr(found, field) == pytest.approx(value, abs=tolerance)
    together = {"width", "height"} if form is Form.SG else set()
    for other in set(FIELDS) - {field} - (together if field in together else set()):
        assert getattr(found, other) == pytest.approx(getattr(was, other), abs=tolerance), other
    untouched = before.lobes[0, 2] if frame is not None else None
    if untouched is not None:
        assert torch.equal(after.lobes[0, 2].axes, untouched.axes)
        assert torch.equal(after.lobes[0, 2].amplitude, untouched.amplitude)


def test_a_colour_is_met_and_the_intensity_stays():
    before = moving(range(2))
    after = apply(before, colour_edit(before.lobes[0, 1], (1, None), (0.2, 0.4, 1.0)))
    was, found = lamp_of(before.lobes[0, 1]), lamp_of(after.lobes[0, 1])
    assert found.intensity == pytest.approx(was.intensity, abs=1e-5)
    np.testing.assert_allclose(np.array(found.colour) / max(found.colour), [0.2, 0.4, 1], rtol=1e-4)


def test_a_colour_without_a_channel_leaves_a_millionth_of_it() -> None:
    grey = lamp(0.0, 0.0, 0.0, (50.0, 20.0))
    red, green, blue = colour_edit(grey, (0, None), (1.0, 0.0, 1.0)).gain_log2
    assert green == pytest.approx(-20, abs=1e-5)
    assert red == blue > 0


def test_black_is_no_colour_and_a_black_lobe_has_no_stops():
    before = moving(range(2))
    assert colour_edit(before.lobes[0, 1], (1, None), (0.0, 0.0, 0.0)).is_identity
    before.lobes.amplitude[0, 1] = 0
    assert lamp_of(before.lobes[0, 1]).intensity == -math.inf
    assert edit_of(before.lobes[0, 1], (1, None), "intensity", 2.0).is_identity


@pytest.mark.parametrize("kelvin", [1700.0, 2856.0, 5000.0, 6504.0, 9990.0])
@pytest.mark.parametrize("tint", [-1.0, 0.0, 0.5])
def test_temperature_and_tint_come_back(kelvin, tint):
    colour = rgb_of(kelvin, tint)
    assert np.dot(colour, (0.2126, 0.7152, 0.0722)) == pytest.approx(1)
    found = temperature_of(tuple(7 * value for value in colour))
    # between two entries of a table of 10 K
    assert found == (pytest.approx(kelvin, abs=1), pytest.approx(tint, abs=1e-3))


def test_a_temperature_is_the_colour_that_usd_gives_it():
    body = np.array(UsdLux.BlackbodyTemperatureAsRgb(3200.0))
    np.testing.assert_allclose(
        rgb_of(3200.0) / body, np.full(3, 1 / (body @ [0.2126, 0.7152, 0.0722]))
    )


@pytest.mark.parametrize(("colour", "end"), [((1.0, 0.1, 1e-6), 0), ((0.1, 0.2, 1.0), 1)])
def test_a_colour_beyond_all_black_bodies_gets_the_nearest_end(colour, end):
    assert temperature_of(colour)[0] == KELVIN_LIMITS[end]


def card(width: float, height: float) -> Lobes:
    """Return a key whose rectangle has some angles and a radiance of 0.36, turned somewhere."""
    tangents = np.tan(np.radians([width, height]) / 2)
    p, q = tangents
    solid_angle = 4 * math.atan(p * q / math.sqrt(1 + p * p + q * q))
    axes = lamp(30.0, 20.0, 10.0, (1.0, 1.0)).axes.numpy().astype(np.float64)
    facing = Card.facing(axes[0] if axes.ndim == 3 else axes, np.array(tangents))
    return as_lobes([[facing]], np.full((1, 1, 3), 0.36 * solid_angle))[0, 0].to(torch.float32)


@pytest.mark.parametrize(("width", "height"), [(0.5, 0.4), (20.0, 30.0), (120.0, 8.0)])
def test_a_key_is_described_as_the_rectangle_that_it_is(width: float, height: float) -> None:
    found = lamp_of(card(width, height), is_key=True)
    # a float32 sharpness is known to 1e-7, and a narrow card's size is its square root's inverse
    assert (found.width, found.height) == pytest.approx((width, height), rel=2e-5)
    assert found.radiance == pytest.approx(0.36, rel=1e-4)


@pytest.mark.parametrize(("field", "value"), [("width", 45.0), ("height", 2.0), ("width", 110.0)])
def test_a_key_that_is_resized_keeps_its_other_side_and_its_radiance(
    field: str, value: float
) -> None:
    tracks = moving(range(2))
    key = card(20.0, 30.0)
    lobes = replace(tracks.lobes, axes=tracks.lobes.axes.clone())
    lobes.axes[:, 0], lobes.sharpness[:, 0] = key.axes, key.sharpness
    lobes.amplitude[:, 0] = key.amplitude
    tracks = replace(tracks, lobes=lobes)
    edit = edit_of(key, (0, None), field, value, is_key=True)
    found = lamp_of(apply(tracks, edit).lobes[0, 0], is_key=True)
    wanted = {"width": 20.0, "height": 30.0, field: value}
    assert (found.width, found.height) == pytest.approx(
        (wanted["width"], wanted["height"]), rel=1e-4
    )
    assert found.radiance == pytest.approx(0.36, rel=1e-4)
    assert found.azimuth == pytest.approx(30.0, abs=FLOAT32_DEG)
