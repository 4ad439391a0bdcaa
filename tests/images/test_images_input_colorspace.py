# SPDX-License-Identifier: Apache-2.0
"""What the user says of an image's colours, against the matrices that are published for them."""

from pathlib import Path

import image_files
import numpy as np
import pytest

from asglight.errors import InputError
from asglight.images import colour, open_sequence, read_latlong
from asglight.images.options import ReadOptions

PUBLISHED = {
    # ACES TB-2014-004 and the documents of ACEScg
    "ACEScg": [
        [1.70505, -0.62179, -0.08326],
        [-0.13026, 1.14080, -0.01055],
        [-0.02400, -0.12897, 1.15297],
    ],
    # ITU-R BT.2087-0, the inverse of its table
    "Linear Rec.2020": [
        [1.6605, -0.5876, -0.0728],
        [-0.1246, 1.1329, -0.0083],
        [-0.0182, -0.1006, 1.1187],
    ],
    # linear Display P3 to linear sRGB, which have one white
    "P3-D65": [
        [1.2249, -0.2249, 0.0],
        [-0.0421, 1.0421, 0.0],
        [-0.0196, -0.0786, 1.0983],
    ],
}


def values() -> np.ndarray:
    """Return colours near grey, which no matrix here makes negative."""
    return (10 + image_files.ramp()).astype(np.float32)


@pytest.mark.parametrize("name", PUBLISHED)
def test_an_image_that_states_nothing_is_what_the_user_says(name: str, tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    image = read_latlong(path, reading=ReadOptions(colorspace=name))
    # the last printed digit of three terms
    expected = values() @ np.array(PUBLISHED[name]).T
    np.testing.assert_allclose(image.radiance.numpy(), expected, rtol=2e-4)
    assert not image.header.colour.is_rec709


def test_the_names_of_one_space_mean_the_same(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    wanted = read_latlong(path, reading=ReadOptions(colorspace="ACEScg")).radiance.numpy()
    for name in ("lin_ap1_scene", "acescg", "ACES - ACEScg", "lin_ap1"):
        found = read_latlong(path, reading=ReadOptions(colorspace=name)).radiance.numpy()
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("stated", ["ACES AP0", "Rec.709"])
def test_the_user_knows_better_than_the_file(stated: str, tmp_path: Path) -> None:
    plain = image_files.write_rgb(tmp_path / "plain.exr", values())
    path = image_files.write_rgb(tmp_path / "a.exr", values(), chromaticities=colour.KNOWN[stated])
    found = read_latlong(path, reading=ReadOptions(colorspace="Rec.2020")).radiance.numpy()
    wanted = read_latlong(plain, reading=ReadOptions(colorspace="Rec.2020")).radiance.numpy()
    np.testing.assert_array_equal(found, wanted)
    image = read_latlong(path, reading=ReadOptions(colorspace="Rec.709"))
    np.testing.assert_array_equal(image.radiance.numpy(), values())
    assert image.header.colour.is_rec709


def test_a_sequence_reads_every_frame_so(tmp_path: Path) -> None:
    for frame in (1, 2):
        image_files.write_rgb(tmp_path / f"sky.{frame:04d}.exr", frame * values())
    sequence = open_sequence(tmp_path, reading=ReadOptions(colorspace="P3-D65"))
    expected = values() @ np.array(PUBLISHED["P3-D65"]).T
    for frame, image in zip((1, 2), sequence, strict=True):
        np.testing.assert_allclose(image.radiance.numpy(), frame * expected, rtol=2e-4)


def test_a_space_that_nobody_knows_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    image_files.write_rgb(tmp_path / "sky.exr", values())
    message = r"input colorspace: sRBG; expected a name .* Nearest: srgb"
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path, reading=ReadOptions(colorspace="sRBG"))
