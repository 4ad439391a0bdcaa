# SPDX-License-Identifier: Apache-2.0
"""What files state of their colours is obeyed, or refused where it cannot be."""

import struct
from collections.abc import Callable
from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import OpenImageIO
import PyOpenColorIO
import pytest
from effort import is_thorough

from asglight.errors import InputError
from asglight.images import colour, open_sequence, read_latlong
from asglight.images.decoding.decode import read_header
from asglight.images.ocio import space_named
from asglight.images.options import ReadOptions

XYZ_TO_RGB = np.linalg.inv(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""IEC 61966-2-1, four digits."""


def srgb(encoded: np.ndarray) -> np.ndarray:
    """Return linear values (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def encoded() -> np.ndarray:
    return (image_files.ramp() / 12).astype(np.float32)  # 0.01 to 1


def near_white() -> np.ndarray:
    return ((20 + image_files.ramp()) * [0.95, 1, 1.09]).astype(np.float32)


def written(path: Path, values: np.ndarray, **header: object) -> Path:
    return image_files.write_rgb(path / "a.exr", values, **header)


def power(exponent: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values**exponent


CURVES = {
    "srgb_rec709_scene": srgb,
    "sRGB": srgb,
    "sRGB - Texture": srgb,
    "srgb_tx": srgb,
    "g22_rec709_scene": power(2.2),
    "g18_rec709_scene": power(1.8),
    "g24_rec709_scene": power(2.4),
    "ocio:g24_rec709_scene": power(2.4),
}


@pytest.mark.parametrize("name", CURVES)
def test_an_encoded_space_is_made_linear(tmp_path: Path, name: str) -> None:
    expected = CURVES[name](encoded().astype(np.float64))
    stated = written(tmp_path, encoded(), colorInteropID=name)
    # OpenColorIO's powers are good to 5e-5, its straight part of sRGB to 3e-4
    np.testing.assert_allclose(read_latlong(stated).radiance, expected, rtol=3e-4)
    image = read_latlong(written(tmp_path, encoded()), reading=ReadOptions(colorspace=name))
    np.testing.assert_allclose(image.radiance, expected, rtol=3e-4)


@pytest.mark.parametrize(
    "header",
    [
        {"colorInteropID": "lin_ciexyzd65_scene"},
        {"chromaticities": colour.KNOWN["CIE XYZ"]},
        {"chromaticities": colour.KNOWN["CIE XYZ"], "colorInteropID": "lin_ciexyzd65_scene"},
    ],
)
def test_xyz_is_xyz_whoever_says_so(tmp_path: Path, header: dict[str, object]) -> None:
    image = read_latlong(written(tmp_path, near_white(), **header))
    # the four digits of the matrix, against differences of 20 and more
    np.testing.assert_allclose(image.radiance, near_white() @ XYZ_TO_RGB.T, rtol=3e-3)


@pytest.mark.parametrize("name", ["XYZ", "CIE XYZ", "lin_ciexyzd65_scene", "cie_xyz_d65_scene"])
def test_the_user_may_say_xyz(tmp_path: Path, name: str) -> None:
    image = read_latlong(written(tmp_path, near_white()), reading=ReadOptions(colorspace=name))
    np.testing.assert_allclose(image.radiance, near_white() @ XYZ_TO_RGB.T, rtol=3e-3)


def test_channels_x_y_z_are_xyz(tmp_path: Path) -> None:
    channels = {name: near_white()[..., i].copy() for i, name in enumerate("XYZ")}
    image = read_latlong(image_files.write(tmp_path / "xyz.exr", channels))
    np.testing.assert_allclose(image.radiance, near_white() @ XYZ_TO_RGB.T, rtol=3e-3)
    assert image.header.colour.said_by == "channels X, Y, Z"


@pytest.mark.thorough
def test_every_name_of_the_config_is_offered_and_read(tmp_path: Path) -> None:
    """Held against OpenColorIO itself; images are read with OpenImageIO's."""
    config = OpenImageIO.ColorConfig("ocio://studio-config-latest")
    itself = PyOpenColorIO.Config.CreateFromFile("ocio://studio-config-latest")
    path = written(tmp_path, encoded())
    for space in config.getColorSpaceNames():
        names = (space, *config.getAliases(space))
        assert {space_named(name) for name in names} == {space}
        expected = encoded()
        processor = itself.getProcessor(space, "lin_rec709_scene")
        processor.getDefaultCPUProcessor().applyRGB(expected)
        for name in names if is_thorough() else names[-1:]:
            found = read_latlong(path, reading=ReadOptions(colorspace=name, repair=1)).radiance
            np.testing.assert_allclose(found, expected.clip(0), rtol=1e-3, atol=1e-4, err_msg=name)


def test_an_aces_container_is_ap0(tmp_path: Path) -> None:
    flagged = read_latlong(written(tmp_path, near_white(), acesImageContainerFlag=1)).radiance
    stated = written(tmp_path, near_white(), chromaticities=colour.KNOWN["ACES AP0"])
    # OpenColorIO's matrix of AP0 against ours: 2e-4 of the sum
    np.testing.assert_allclose(flagged, read_latlong(stated).radiance, rtol=1e-3)


AP1 = colour.KNOWN["ACEScg (AP1)"]
REFUSED = {
    "two spaces": (
        {"chromaticities": AP1, "colorInteropID": "lin_rec709_scene"},
        r"states linear Rec\.709 \(colorInteropID\) and ACEScg \(AP1\) \(chromaticities\)",
    ),
    "curve and other primaries": (
        {"chromaticities": AP1, "colorInteropID": "srgb_rec709_scene"},
        r"states sRGB Encoded Rec\.709 \(sRGB\) \(colorInteropID\) and ACEScg",
    ),
    "a container of AP1": (
        {"chromaticities": AP1, "acesImageContainerFlag": 1},
        r"states ACEScg \(AP1\) \(chromaticities\) and ACES AP0 \(acesImageContainerFlag\)",
    ),
    "no name": (
        {"colorInteropID": "lin_mycamera_scene"},
        "states colorInteropID lin_mycamera_scene, which OpenColorIO has not",
    ),
    "data": ({"colorInteropID": "data"}, "states colorInteropID data: data, no colours"),
    "gamma": ({"gamma": 2.2}, r"states gamma 2\.2.*; expected linear light"),
    "no primaries": ({"chromaticities": (0.0,) * 8}, "states chromaticities 0 0 0"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_obeyed_is_refused_and_the_user_overrides_it(
    tmp_path: Path, name: str
) -> None:
    header, message = REFUSED[name]
    path = written(tmp_path, near_white(), **header)
    with pytest.raises(InputError, match=rf"a\.exr: {message}.*--input-colorspace"):
        read_latlong(path)
    image = read_latlong(path, reading=ReadOptions(colorspace="Linear Rec.709 (sRGB)"))
    np.testing.assert_array_equal(image.radiance, near_white())


@pytest.mark.parametrize(
    "header",
    [
        {"chromaticities": AP1, "colorInteropID": "lin_ap1_scene"},
        {"chromaticities": colour.REC709, "colorInteropID": "srgb_rec709_scene"},
        {"chromaticities": colour.KNOWN["ACES AP0"], "acesImageContainerFlag": 1},
        {"colorInteropID": "unknown"},
    ],
)
def test_statements_that_agree_are_taken(tmp_path: Path, header: dict[str, object]) -> None:
    assert read_latlong(written(tmp_path, encoded(), **header)).radiance.max() > 0


def of_another_type(path: Path, name: str, kind: str, value: bytes) -> Path:
    """Write a standard attribute as no library does."""
    planes = {channel: (np.ones((4, 8), np.float32), 1) for channel in "RGB"}
    return image_files.raw_exr(path / "a.exr", planes, (8, 4), attributes=[(name, kind, value)])


@pytest.mark.parametrize(
    ("kind", "value"), [("v2f", struct.pack("<2f", 0.3, 0.3)), ("string", b"Rec.709")]
)
def test_chromaticities_of_another_type_are_refused_and_the_user_overrides_them(
    tmp_path: Path, kind: str, value: bytes
) -> None:
    path = of_another_type(tmp_path, "chromaticities", kind, value)
    message = r"a\.exr: states chromaticities that are not eight numbers.*--input-colorspace"
    with pytest.raises(InputError, match=message):
        read_latlong(path)
    image = read_latlong(path, reading=ReadOptions(colorspace="Linear Rec.709 (sRGB)"))
    assert (image.radiance == 1).all()


@pytest.mark.parametrize(
    ("name", "kind", "value"),
    [
        ("whiteLuminance", "string", b"bright"),
        ("whiteLuminance", "v2f", struct.pack("<2f", 203, 204)),
        ("adoptedNeutral", "float", struct.pack("<f", 0.3)),
        ("adoptedNeutral", "string", b"D60"),
        ("multiView", "v2i", struct.pack("<2i", 1, 2)),
        ("multiView", "float", struct.pack("<f", 2)),
    ],
)
def test_what_is_stated_of_looks_in_another_type_says_nothing(
    tmp_path: Path, name: str, kind: str, value: bytes
) -> None:
    assert (read_latlong(of_another_type(tmp_path, name, kind, value)).radiance == 1).all()


def test_what_is_stated_of_looks_is_told_and_changes_nothing(tmp_path: Path) -> None:
    header = {"whiteLuminance": 203.0, "adoptedNeutral": np.array([0.3457, 0.3585], np.float32)}
    image = read_latlong(written(tmp_path, near_white(), **header))
    np.testing.assert_array_equal(image.radiance, near_white())
    assert image.header.notes == (
        "whiteLuminance 203 is not applied: radiance is relative, 1 is that many nits",
        "adoptedNeutral 0.3457 0.3585 is not applied: it says what a display shows as grey",
    )


def luminance_chroma(
    values: np.ndarray, weights: tuple[float, float, float] = (0.2126, 0.7152, 0.0722)
) -> dict[str, np.ndarray]:
    """Return Y, RY, BY as OpenEXR defines them, of Rec.709 or by other weights."""
    y = values @ np.array(weights)
    chroma = (values[..., 0] - y) / y, (values[..., 2] - y) / y
    planes = {"Y": y, "RY": chroma[0], "BY": chroma[1]}
    return {name: plane.astype(np.float32) for name, plane in planes.items()}


def test_luminance_and_chroma_are_read_at_full_size(tmp_path: Path) -> None:
    path = image_files.write(tmp_path / "yc.exr", luminance_chroma(near_white()))
    # the weights' four digits
    np.testing.assert_allclose(read_latlong(path).radiance, near_white(), rtol=1e-3)


AP1_LUMINANCE = (0.2722287, 0.6740818, 0.0536895)
"""Of the matrix from AP1 to XYZ (ACES TB-2014-004)."""

BROKEN = (0.64, 0.33, 0.64, 0.33, 0.15, 0.06, 0.3127, 0.3290)
"""Two of the primaries are one."""


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ({"chromaticities": AP1}, None),
        ({"chromaticities": AP1, "colorInteropID": "lin_ap1_scene"}, None),
        ({"colorInteropID": "lin_ap1_scene"}, None),
        ({"chromaticities": AP1}, "ACEScg"),
        ({}, "ACEScg"),
        ({"chromaticities": BROKEN}, "ACEScg"),
    ],
)
def test_luminance_is_of_the_primaries_whoever_says_them(
    tmp_path: Path, header: dict[str, object], said: str | None
) -> None:
    colour_ap1 = np.ones((8, 16, 3)) * [0.8, 0.3, 0.1]
    planes = luminance_chroma(colour_ap1, AP1_LUMINANCE)
    path = image_files.write(tmp_path / "yc.exr", planes, **header)
    found = read_latlong(path, reading=ReadOptions(colorspace=said)).radiance.numpy()
    # the published matrix of ACEScg, of five digits; blue is small
    rec709 = (1.16918, 0.23698, 0.05741)
    np.testing.assert_allclose(found, np.broadcast_to(rec709, found.shape), rtol=5e-4)
    plain = image_files.write_rgb(
        tmp_path / "rgb.exr", colour_ap1.astype(np.float32), chromaticities=AP1
    )
    np.testing.assert_allclose(found, read_latlong(plain).radiance, rtol=5e-4)


def test_luminance_is_of_the_stated_primaries_where_the_user_says_others(tmp_path: Path) -> None:
    # what the numbers are is the user's to say; how Y was made of them is the writer's
    planes = luminance_chroma(np.broadcast_to([0.8, 0.3, 0.1], (8, 16, 3)), AP1_LUMINANCE)
    path = image_files.write(tmp_path / "yc.exr", planes, chromaticities=AP1)
    found = read_latlong(path, reading=ReadOptions(colorspace="Rec.709")).radiance.numpy()
    np.testing.assert_allclose(found, np.broadcast_to((0.8, 0.3, 0.1), found.shape), rtol=1e-5)


def test_subsampled_chroma_is_interpolated_around_the_sphere(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:16, :32]
    values = np.empty((16, 32, 3))
    values[..., 0] = 4 + np.cos(columns * np.pi / 16)
    values[..., 1] = 5
    values[..., 2] = 4 - np.cos(columns * np.pi / 16) * np.cos(rows * np.pi / 16)
    planes = luminance_chroma(values)
    stored = {
        "Y": (planes["Y"], 1),
        "RY": (planes["RY"][::2, ::2].copy(), 2),
        "BY": (planes["BY"][::2, ::2].copy(), 2),
    }
    path = image_files.raw_exr(tmp_path / "yc.exr", stored, (32, 16))
    found = read_latlong(path).radiance.numpy()
    # what linear interpolation misses of cosines over 16 samples, and 3 % where blue is darkest
    np.testing.assert_allclose(found, values, rtol=0.03)
    np.testing.assert_allclose(found[::2, ::2], values[::2, ::2], rtol=1e-3)
    for name in ("yc", "yc.hdr", "yc.1001"):  # a file is known by its content
        other = path.rename(tmp_path / name)
        np.testing.assert_array_equal(read_latlong(other).radiance, found)
        path = other


def test_a_frame_that_lost_its_statement_is_named(tmp_path: Path) -> None:
    for frame, header in ((1, {"chromaticities": AP1}), (2, {"chromaticities": AP1}), (3, {})):
        image_files.write_rgb(tmp_path / f"sky.{frame:04d}.exr", near_white(), **header)
    sequence = open_sequence(tmp_path)
    sequence.read(2)
    message = (
        r"sky\.0003\.exr: frame 3 is in linear Rec\.709 \(assumed.*expected ACEScg \(AP1\) "
        r"\(chromaticities\) as frame 1 is\. .*--input-colorspace"
    )
    with pytest.raises(InputError, match=message):
        sequence.read(3)
    said = open_sequence(tmp_path, reading=ReadOptions(colorspace="ACEScg"))
    np.testing.assert_array_equal(said.read(1).radiance, said.read(3).radiance)


def test_a_frame_of_another_white_is_named(tmp_path: Path) -> None:
    for frame, nits in ((1, 100.0), (2, 50.0)):
        path = tmp_path / f"sky.{frame:04d}.exr"
        image_files.write_rgb(path, near_white(), whiteLuminance=nits)
    with pytest.raises(InputError, match=r"frame 2 has a whiteLuminance of 50; expected 100 as"):
        open_sequence(tmp_path).read(2)


def test_parts_share_the_chromaticities_of_the_first(tmp_path: Path) -> None:
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage, **header}, {"RGB": near_white()}, name)
        for name, header in (("depth", {"chromaticities": AP1}), ("beauty", {}))
    ]
    OpenEXR.File(parts).write(str(tmp_path / "p.exr"))
    assert read_header(tmp_path / "p.exr").colour.name == "ACEScg (AP1)"
