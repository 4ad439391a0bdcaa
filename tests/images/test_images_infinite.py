# SPDX-License-Identifier: Apache-2.0
"""+inf is the brightest light, NaN is none, and a frame that lost too much is refused."""

import math
from pathlib import Path

import image_files
import numpy as np
import pytest

from asglight.errors import InputError
from asglight.images import colour, open_sequence, read_latlong
from asglight.images.decoding.header import DamagedError
from asglight.images.infinite import Infinities
from asglight.images.options import ReadOptions


def kept(values: np.ndarray, rows: int, brightest: float = 65504.0) -> tuple[np.ndarray, int]:
    """Return an image whose strips have some rows each, without infinities, and their count."""
    infinities = Infinities(brightest)
    buffer = np.empty((rows, *values.shape[1:]), values.dtype)

    def strips():
        for top in range(0, len(values), rows):
            strip = values[top : top + rows]
            buffer[: len(strip)] = strip  # a strip is valid until the next one
            yield tuple(np.ascontiguousarray(buffer[: len(strip), :, i]) for i in range(3))
            buffer[:] = np.nan

    found = [np.stack(planes, axis=-1) for planes in infinities.kept(strips())]
    return np.concatenate(found), infinities.count


@pytest.mark.parametrize("rows", [1, 2, 3, 8])
def test_touching_texels_have_the_light_around_them_or_65504(rows: int) -> None:
    values = np.ones((8, 16, 3), dtype=np.float32)
    values[1, 2:4] = np.inf
    values[2, 4, 0] = 1e6  # beside the first set, in red only
    values[5, 15] = values[5, 0] = np.inf  # one set across the seam
    values[4, 1, 1] = 2e5
    values[7, 8, 2] = np.inf
    found, count = kept(values, rows)
    expected = values.copy()
    expected[1, 2:4] = (1e6, 65504, 65504)
    expected[5, [0, 15]] = (65504, 2e5, 65504)
    expected[7, 8, 2] = 65504
    np.testing.assert_array_equal(found, expected)
    assert count == 5


def test_nan_and_minus_infinity_are_left_to_the_repair() -> None:
    values = np.full((2, 4, 3), np.nan, dtype=np.float32)
    values[0, 0] = -np.inf
    values[1, 1] = np.inf
    found, count = kept(values, 2)
    assert math.isnan(found[0, 1, 0])
    assert found[0, 0, 0] == -np.inf
    assert found[1, 1].tolist() == [65504] * 3
    assert count == 1


def test_an_image_without_infinities_is_not_copied() -> None:
    plane = np.ones((2, 4), dtype=np.float32)
    (planes,) = Infinities().kept([(plane, plane, plane)])
    assert all(one is plane for one in planes)


def sun(value: float, height: int = 8) -> np.ndarray:
    values = np.ones((height, 2 * height, 3), dtype=np.float32)
    values[2, 3] = value
    return values


def test_a_half_sun_beyond_the_largest_half_is_kept_and_told(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "s.exr", sun(np.inf).astype(np.float16))
    image = read_latlong(path)
    np.testing.assert_array_equal(image.radiance, sun(65504))
    said = "1 infinite texel taken as 65504, or as the light around"
    assert image.repair.sentence() == said
    assert (image.repair.infinite, image.repair.nonfinite, image.repair.texels) == (1, 0, 1)


def test_an_infinite_sun_in_other_primaries_is_white_light_of_them(tmp_path: Path) -> None:
    ap1 = colour.KNOWN["ACEScg (AP1)"]
    path = image_files.write_rgb(tmp_path / "s.exr", sun(np.inf), chromaticities=ap1)
    np.testing.assert_allclose(read_latlong(path).radiance[2, 3], [65504] * 3, rtol=1e-5)


def test_infinity_in_an_encoded_space_is_its_white(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "s.exr", sun(np.inf))
    image = read_latlong(path, reading=ReadOptions(colorspace="sRGB"))
    np.testing.assert_allclose(image.radiance[2, 3], [1] * 3, rtol=1e-4)


LOST = {
    "all NaN": (lambda values: values.fill(np.nan), "holds nothing but NaN; expected light"),
    "a quarter NaN": (
        lambda values: values[:2].fill(np.nan),
        r"has NaN or infinite values in 25 % of its texels; expected at most 10 %.*--repair 0\.25",
    ),
    "a quarter infinite": (
        lambda values: values[:2].fill(np.inf),
        "has NaN or infinite values in 25 %",
    ),
    "vectors": (
        lambda values: values[:, ::2].fill(-0.9),
        r"holds 90 % as much negative light as positive; .*normals.*--repair 0\.9",
    ),
    "below 0": (lambda values: values.fill(-1), "holds negative values and nothing above 0"),
}


@pytest.mark.parametrize("name", LOST)
def test_a_frame_that_lost_too_much_is_refused_or_filled(tmp_path: Path, name: str) -> None:
    damage, message = LOST[name]
    values = np.ones((8, 16, 3), dtype=np.float32)
    image_files.write_rgb(tmp_path / "s.0001.exr", values)
    damage(values)
    path = image_files.write_rgb(tmp_path / "s.0002.exr", values)
    with pytest.raises(DamagedError, match=rf"s\.0002\.exr: {message}"):
        read_latlong(path)
    held = open_sequence(tmp_path, missing="hold").read_or_fill(2)
    assert held.repair.filled_from == (1,)
    assert float(held.radiance.min()) == 1


@pytest.mark.parametrize(("name", "share"), [("a quarter NaN", 0.25), ("vectors", 0.91)])
def test_the_user_may_take_it_as_it_is(tmp_path: Path, name: str, share: float) -> None:
    values = np.ones((8, 16, 3), dtype=np.float32)
    LOST[name][0](values)
    path = image_files.write_rgb(tmp_path / "s.exr", values)
    image = read_latlong(path, reading=ReadOptions(repair=share))
    expected = np.where(np.isnan(values), 0, values).clip(0)
    np.testing.assert_array_equal(image.radiance, expected)


@pytest.mark.parametrize("name", ["all NaN", "below 0"])
def test_nothing_allows_a_frame_without_light(tmp_path: Path, name: str) -> None:
    values = np.ones((8, 16, 3), dtype=np.float32)
    LOST[name][0](values)
    path = image_files.write_rgb(tmp_path / "s.exr", values)
    with pytest.raises(DamagedError):
        read_latlong(path, reading=ReadOptions(repair=1))


def test_saturated_light_is_not_lost_light(tmp_path: Path) -> None:
    values = np.zeros((8, 16, 3), dtype=np.float32)
    values[..., 1] = 1  # the green of Rec.2020, which is 60 % negative in Rec.709
    path = image_files.write_rgb(tmp_path / "s.exr", values)
    image = read_latlong(path, reading=ReadOptions(colorspace="Linear Rec.2020"))
    assert image.repair.negative_flux_ratio > 0.5


@pytest.mark.parametrize("share", [-0.1, 1.5, math.nan])
def test_a_share_that_is_none_is_refused(tmp_path: Path, share: float) -> None:
    with pytest.raises(InputError, match=r"repair: .*; expected a share from 0 to 1"):
        open_sequence(tmp_path, reading=ReadOptions(repair=share))
