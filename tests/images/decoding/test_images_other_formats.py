# SPDX-License-Identifier: Apache-2.0
"""Images neither OpenEXR nor Radiance: floats are light, integers only if the user says so."""

from pathlib import Path

import image_files
import numpy as np
import OpenImageIO
import pytest
from PIL import Image

from asglight.errors import InputError
from asglight.images import read_latlong
from asglight.images.options import ReadOptions

SRGB = ReadOptions(colorspace="sRGB")
ENCODED = np.linspace(1, 255, 8 * 16 * 3).reshape(8, 16, 3).round()


def srgb(encoded: np.ndarray) -> np.ndarray:
    """Return linear values (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "tif"])
def test_an_image_of_integers_needs_a_space_and_is_warned_of(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    lossy = {"jpg": {"quality": 100, "subsampling": 0}, "webp": {"lossless": True}}
    Image.fromarray(ENCODED.astype(np.uint8)).save(path, **lossy.get(suffix, {}))
    message = (
        rf"a\.{suffix}: is an image of 8-bit integers, in which suns and lamps are clipped at "
        r"white; expected OpenEXR, .*--input-colorspace sRGB\."
    )
    with pytest.raises(InputError, match=message):
        read_latlong(path)
    image = read_latlong(path, reading=SRGB)
    steps = 3 / 255 if suffix == "jpg" else 1e-6
    np.testing.assert_allclose(image.radiance, srgb(ENCODED / 255), rtol=3e-4, atol=3 * steps)
    assert "suns and lamps are clipped at white" in image.header.warnings[0]


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bits_are_integers_too(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    values = (ENCODED * 257).astype(np.uint16)
    buffer = OpenImageIO.ImageBuf(values)
    buffer.set_write_format("uint16")
    assert buffer.write(str(path)), buffer.geterror()
    with pytest.raises(InputError, match="is an image of 16-bit integers"):
        read_latlong(path)
    radiance = read_latlong(path, reading=SRGB).radiance
    np.testing.assert_allclose(radiance, srgb(ENCODED / 255), rtol=3e-4)


def integer_tiff(path: Path, values: np.ndarray) -> Path:
    """Write integers as they are."""
    stored = getattr(OpenImageIO, values.dtype.name.upper())
    spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], 3, stored)
    output = OpenImageIO.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(values), output.geterror()
    output.close()
    return path


@pytest.mark.parametrize(("space", "is_encoded"), [("sRGB", True), ("Rec.709", False)])
def test_32_bits_are_integers_too(tmp_path: Path, space: str, is_encoded: bool) -> None:
    path = integer_tiff(tmp_path / "a.tif", ENCODED.astype(np.uint32) * (0xFFFFFFFF // 255))
    with pytest.raises(InputError, match="is an image of 32-bit integers, in which suns and lamps"):
        read_latlong(path)
    image = read_latlong(path, reading=ReadOptions(colorspace=space))
    expected = srgb(ENCODED / 255) if is_encoded else ENCODED / 255
    np.testing.assert_allclose(image.radiance, expected, rtol=3e-4)
    assert image.header.warnings == (
        "32-bit integers: suns and lamps are clipped at white, so their light is missing",
    )


@pytest.mark.parametrize("dtype", ["int8", "int16", "int32"])
@pytest.mark.parametrize("space", [None, "sRGB"])
def test_signed_integers_are_refused(tmp_path: Path, dtype: str, space: str | None) -> None:
    path = integer_tiff(tmp_path / "a.tif", np.full((8, 16, 3), 100, dtype))
    message = (
        rf"a\.tif: is an image of signed {dtype[3:]}-bit integers, of which nobody says where "
        r"black and white are; expected OpenEXR, .*convert it\.$"
    )
    with pytest.raises(InputError, match=message):
        read_latlong(path, reading=ReadOptions(colorspace=space))


def test_integers_of_openexr_are_their_values(tmp_path: Path) -> None:
    values = np.arange(1, 4 * 8 + 1, dtype=np.uint32).reshape(4, 8)
    path = image_files.write(tmp_path / "a.exr", {"R": values, "G": 2 * values, "B": 3 * values})
    expected = values[..., None] * np.array([1, 2, 3], np.float32)
    for reading in (ReadOptions(), ReadOptions(colorspace="Rec.709")):
        image = read_latlong(path, reading=reading)
        np.testing.assert_array_equal(image.radiance, expected)
        assert image.header.warnings == ()


def test_a_tiff_of_floats_is_light(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    assert OpenImageIO.ImageBuf(image_files.ramp()).write(str(path))
    np.testing.assert_array_equal(read_latlong(path).radiance, image_files.ramp())


def test_a_profile_is_refused_or_overridden(tmp_path: Path) -> None:
    from PIL import ImageCms

    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    buffer = OpenImageIO.ImageBuf(image_files.ramp())
    buffer.specmod().attribute(
        "ICCProfile", f"uint8[{len(profile)}]", np.frombuffer(profile, np.uint8)
    )
    assert buffer.write(str(tmp_path / "a.tif")), buffer.geterror()
    with pytest.raises(InputError, match=r"a\.tif: has an ICC profile .*--input-colorspace"):
        read_latlong(tmp_path / "a.tif")
    said = ReadOptions(colorspace="Rec.709")
    found = read_latlong(tmp_path / "a.tif", reading=said).radiance
    np.testing.assert_array_equal(found, image_files.ramp())


@pytest.mark.parametrize("order", ["<", ">"])
def test_pfm_begins_at_the_bottom(tmp_path: Path, order: str) -> None:
    scale = b"-1.0" if order == "<" else b"1.0"
    pixels = image_files.ramp()[::-1].astype(f"{order}f4").tobytes()
    path = tmp_path / "a.pfm"
    path.write_bytes(b"PF\n8 4\n" + scale + b"\n" + pixels)
    np.testing.assert_array_equal(read_latlong(path).radiance, image_files.ramp())


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_of_exif_is_followed(tmp_path: Path, orientation: int) -> None:
    """TIFF 6.0: which sides of the picture row 0 and column 0 are."""
    upright = image_files.ramp()
    stored = {
        1: upright,
        2: upright[:, ::-1],
        3: upright[::-1, ::-1],
        4: upright[::-1],
        5: upright.swapaxes(0, 1),
        6: upright[:, ::-1].swapaxes(0, 1)[:, :],
        7: upright[::-1, ::-1].swapaxes(0, 1),
        8: upright[::-1].swapaxes(0, 1),
    }
    # 6: row 0 is the right side, column 0 the top; 8: row 0 the left side, column 0 the bottom
    buffer = OpenImageIO.ImageBuf(np.ascontiguousarray(stored[orientation]))
    buffer.specmod().attribute("Orientation", orientation)
    assert buffer.write(str(tmp_path / "a.tif")), buffer.geterror()
    np.testing.assert_array_equal(read_latlong(tmp_path / "a.tif").radiance, upright)
