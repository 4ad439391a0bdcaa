# SPDX-License-Identifier: Apache-2.0
"""Primaries are converted as OpenColorIO and the ACES documents have it."""

from pathlib import Path

import image_files
import numpy as np
import OpenImageIO
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from asglight.errors import InputError
from asglight.images import colour, read_latlong

OCIO_NAMES = {
    "ACES AP0": "ACES2065-1",
    "ACEScg (AP1)": "ACEScg",
    "Rec.2020": "Linear Rec.2020",
    "P3-D65": "Linear P3-D65",
    "Adobe RGB": "Linear AdobeRGB",
}


@pytest.mark.parametrize("name", OCIO_NAMES)
def test_matrix_agrees_with_opencolorio(name: str) -> None:
    buffer = OpenImageIO.ImageBuf(np.eye(3, dtype=np.float32).reshape(1, 3, 3))
    converted = OpenImageIO.ImageBufAlgo.colorconvert(
        buffer, OCIO_NAMES[name], "Linear Rec.709 (sRGB)"
    )
    assert not converted.has_error, converted.geterror()
    expected = np.array([converted.getpixel(column, 0) for column in range(3)]).T
    # OpenColorIO's AP0 and AP1 go through its own rounded D60-to-D65 matrix.
    np.testing.assert_allclose(colour.to_rec709(colour.KNOWN[name]), expected, atol=2e-4)


def test_acescg_matrix_is_the_published_one() -> None:
    published = [
        [1.70505, -0.62179, -0.08326],
        [-0.13026, 1.14080, -0.01055],
        [-0.02400, -0.12897, 1.15297],
    ]
    matrix = colour.to_rec709(colour.KNOWN["ACEScg (AP1)"])
    # the last printed digit, and the white's five digits
    np.testing.assert_allclose(matrix, published, atol=3e-5)


def test_rec709_to_rec709_is_the_identity() -> None:
    # the rounding of float64, through two solutions of 3 x 3
    np.testing.assert_allclose(colour.to_rec709(colour.REC709), np.eye(3), atol=1e-15)


def test_xyz_files_go_through_the_published_srgb_matrix(tmp_path: Path) -> None:
    """XYZ is XYZ: the white that such files state, of equal energy, adapts nothing."""
    xyz_to_rec709 = [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
    values = (20 + image_files.ramp()).astype(np.float32)
    values *= [0.95, 1, 1.09]  # near D65, so that nothing is negative
    path = image_files.write_rgb(
        tmp_path / "xyz.exr", values, chromaticities=colour.KNOWN["CIE XYZ"]
    )
    # Printed (Lindbloom) for a white of 0.95047, 1, 1.08883, a rounding away from OpenColorIO's.
    expected = values @ np.array(xyz_to_rec709).T
    np.testing.assert_allclose(read_latlong(path).radiance.numpy(), expected, rtol=2e-3)


@given(
    st.tuples(
        *(st.floats(low, high) for low, high in ((0.6, 0.73), (0.26, 0.33))),
        *(st.floats(low, high) for low, high in ((0.0, 0.3), (0.6, 1.0))),
        *(st.floats(low, high) for low, high in ((0.0, 0.15), (-0.07, 0.06))),
        *(st.floats(low, high) for low, high in ((0.28, 0.36), (0.29, 0.37))),
    )
)
def test_white_stays_white(chromaticities: colour.Chromaticities) -> None:
    white = colour.to_rec709(chromaticities) @ np.ones(3)
    np.testing.assert_allclose(white, np.ones(3), rtol=1e-9)


def test_file_with_other_primaries_is_converted_and_says_so(tmp_path: Path) -> None:
    values = 10 + image_files.ramp()
    path = image_files.write_rgb(
        tmp_path / "ap1.exr", values, chromaticities=colour.KNOWN["ACEScg (AP1)"]
    )
    image = read_latlong(path)
    expected = values @ colour.to_rec709(colour.KNOWN["ACEScg (AP1)"]).T
    assert image.header.colour.name == "ACEScg (AP1)"
    # float32 chromaticities in the file
    np.testing.assert_allclose(image.radiance.numpy(), expected, rtol=1e-5)


@pytest.mark.parametrize("white", [(0.3127, 0.3290), (0.31271, 0.32902)])
def test_file_that_states_rec709_is_left_alone(tmp_path: Path, white: tuple[float, float]) -> None:
    values = image_files.ramp()
    stated = (*colour.REC709[:6], *white)
    image = read_latlong(image_files.write_rgb(tmp_path / "a.exr", values, chromaticities=stated))
    assert image.header.colour.is_rec709
    np.testing.assert_array_equal(image.radiance.numpy(), values)


def test_colour_interop_id_is_heeded_where_no_numbers_are(tmp_path: Path) -> None:
    path = image_files.write_rgb(
        tmp_path / "id.exr", image_files.ramp(), colorInteropID="lin_ap1_scene"
    )
    assert read_latlong(path).header.colour.name == "ACEScg"


def test_unnamed_primaries_are_named_by_their_numbers(tmp_path: Path) -> None:
    stated = (0.7, 0.3, 0.2, 0.75, 0.1, 0.05, 0.3457, 0.3585)
    path = image_files.write_rgb(tmp_path / "a.exr", image_files.ramp(), chromaticities=stated)
    found = read_latlong(path).header.colour.name
    assert found == "primaries 0.7 0.3 0.2 0.75 0.1 0.05 0.3457 0.3585"


def test_nan_stays_one_texel_and_negatives_are_judged_in_rec709(
    tmp_path: Path,
) -> None:
    values = np.full((4, 8, 3), 0.5, dtype=np.float32)
    values[0, 1, 2] = np.nan
    values[1, 2] = (0.0, 1.0, 0.0)  # AP0 green lies outside Rec.709: red and blue go negative
    path = image_files.write_rgb(
        tmp_path / "a.exr", values, chromaticities=colour.KNOWN["ACES AP0"]
    )
    image = read_latlong(path)
    assert (image.repair.nonfinite, image.repair.first) == (1, (0, 1))
    assert bool(torch.isfinite(image.radiance).all())
    green = image.radiance[1, 2]
    assert green[0] == 0
    assert green[2] == 0
    assert green[1] > 1
    assert image.repair.negative == 1


@pytest.mark.parametrize(
    "stated",
    [
        (0.0,) * 8,
        (0.64, 0.33, 0.64, 0.33, 0.15, 0.06, 0.3127, 0.3290),
        (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.0),
        (0.64, float("nan"), 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    ],
)
def test_primaries_that_span_no_colours_are_refused(
    tmp_path: Path, stated: tuple[float, ...]
) -> None:
    path = image_files.write_rgb(tmp_path / "bad.exr", image_files.ramp(), chromaticities=stated)
    with pytest.raises(InputError, match=r"bad\.exr: states chromaticities .*; expected three"):
        read_latlong(path)
