# SPDX-License-Identifier: Apache-2.0
"""Every line and coding of Radiance's file format is read as it is meant, or refused."""

from pathlib import Path

import image_files
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asglight.errors import InputError
from asglight.images import open_sequence, read_latlong
from asglight.images.decoding.radiance import unrolled
from asglight.images.options import ReadOptions

PIXELS, RADIANCE = image_files.rgbe(8, 16)
SIZE = "-Y 8 +X 16\n"
FORMAT = "FORMAT=32-bit_rle_rgbe\n"
XYZ_TO_RGB = np.linalg.inv(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)


def written(folder: Path, head: str, body: bytes = PIXELS.tobytes()) -> Path:
    path = folder / "a.hdr"
    path.write_bytes(head.encode() + body)
    return path


SPELLINGS = {
    "no format": f"#?RADIANCE\nSOFTWARE=x\n\n{SIZE}",
    "trailing blanks": f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe  \t\n\n{SIZE}",
    "blanks around": f"#?RADIANCE\nFORMAT = 32-bit_rle_rgbe\n\n{SIZE}",
    "carriage returns": "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 8 +X 16\n",
    "no empty line": f"#?RADIANCE\n{FORMAT}{SIZE}",
    "another program": f"#?PFSTOOLS\n{FORMAT}\n{SIZE}",
    "walter": f"#?RGBE\n{FORMAT}\n{SIZE}",
    "lines after": f"#?RADIANCE\n{FORMAT}SOFTWARE=x\n# a comment\n\n{SIZE}",
    "more blanks": f"#?RADIANCE\n{FORMAT}\n-Y  8  +X  16 \n",
    "lower case": f"#?RADIANCE\nformat=32-bit_rle_rgbe\n\n{SIZE}",
}


@pytest.mark.parametrize("name", SPELLINGS)
def test_every_spelling_of_the_header_is_read(tmp_path: Path, name: str) -> None:
    image = read_latlong(written(tmp_path, SPELLINGS[name]))
    np.testing.assert_array_equal(image.radiance, RADIANCE)
    assert ("no FORMAT" in str(image.header.warnings)) == (name == "no format")


@pytest.mark.parametrize("name", SPELLINGS)
def test_runs_of_channels_are_read_in_every_spelling(tmp_path: Path, name: str) -> None:
    coded = image_files.hdr_bytes(PIXELS, size="", run_length=True).partition(b"\n\n\n")[2]
    image = read_latlong(written(tmp_path, SPELLINGS[name], coded))
    np.testing.assert_array_equal(image.radiance, RADIANCE)


LINES = {
    "exposure": ("EXPOSURE=4\n", 4, 1),
    "exposures multiply": ("EXPOSURE= 2.0\nEXPOSURE=.25\nEXPOSURE=4e0\n", 2, 1),
    "of another picture": ("\tEXPOSURE=4\n EXPOSURE=8\n#EXPOSURE=2\n", 1, 1),
    "colour": ("COLORCORR=2 1 0.5\n", np.array([2, 1, 0.5]), 1),
    "both": ("EXPOSURE=2\nCOLORCORR=2 1 0.5\nCOLORCORR=1 1 4\n", np.array([4, 2, 4]), 1),
    "gamma": ("GAMMA=2.2\n", 1, 2.2),
    "no gamma": ("GAMMA=1.0\n", 1, 1),
    "gamma and exposure": ("GAMMA=2\nEXPOSURE=3\n", 3, 2),
}


@pytest.mark.parametrize("name", LINES)
def test_what_was_multiplied_in_is_divided_out(tmp_path: Path, name: str) -> None:
    line, multiplier, gamma = LINES[name]
    image = read_latlong(written(tmp_path, f"#?RADIANCE\n{line}{FORMAT}\n{SIZE}"))
    expected = RADIANCE**gamma / multiplier
    np.testing.assert_allclose(image.radiance, expected, rtol=1e-6)  # float32


def test_a_sequence_of_other_exposures_is_constant(tmp_path: Path) -> None:
    for frame, exposure in ((1, 1.0), (2, 0.5), (3, 4.0)):
        pixels = PIXELS.copy()
        pixels[..., 3] += int(np.log2(exposure)) % 256
        head = f"#?RADIANCE\nEXPOSURE={exposure}\n{FORMAT}\n{SIZE}"
        written(tmp_path, head, pixels.tobytes()).rename(tmp_path / f"s.{frame:04d}.hdr")
    for image in open_sequence(tmp_path):
        np.testing.assert_array_equal(image.radiance, RADIANCE)


def test_xyze_is_xyz(tmp_path: Path) -> None:
    pixels = np.full((8, 16, 4), 128, dtype=np.uint8)
    pixels[..., :3] = (122, 128, 139)  # D65
    path = written(tmp_path, f"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n{SIZE}", pixels.tobytes())
    expected = np.array([122, 128, 139]) / 256 @ XYZ_TO_RGB.T
    np.testing.assert_allclose(read_latlong(path).radiance[0, 0], expected, rtol=2e-3)
    as_rgb = read_latlong(path, reading=ReadOptions(colorspace="Rec.709")).radiance[0, 0]
    np.testing.assert_allclose(as_rgb, np.array([122, 128, 139]) / 256, rtol=1e-6)


def test_primaries_are_converted(tmp_path: Path) -> None:
    ap1 = "0.713 0.293 0.165 0.830 0.128 0.044 0.32168 0.33767"
    path = written(tmp_path, f"#?RADIANCE\nPRIMARIES={ap1}\n{FORMAT}\n{SIZE}")
    image = read_latlong(path, reading=ReadOptions(repair=1))
    # ACES TB-2014-004 and the documents of ACEScg
    matrix = [
        [1.70505, -0.62179, -0.08326],
        [-0.13026, 1.1408, -0.01055],
        [-0.024, -0.12897, 1.15297],
    ]
    expected = (RADIANCE @ np.array(matrix).T).clip(0)
    np.testing.assert_allclose(image.radiance, expected, rtol=1e-3, atol=1e-3)


FAULTS = {
    "EXPOSURE=0\n": r"EXPOSURE=0 \(expected numbers above 0\)",
    "EXPOSURE=-1\n": "EXPOSURE=-1",
    "EXPOSURE=nan\n": "EXPOSURE=nan",
    "EXPOSURE=auto\n": "EXPOSURE=auto",
    "EXPOSURE=1e300\nEXPOSURE=1e300\n": "multiply to no number",
    "COLORCORR=1 1\n": "COLORCORR=1 1",
    "GAMMA=0\n": r"GAMMA=0 \(expected a number above 0\)",
    "PRIMARIES=1 2 3\n": "PRIMARIES=1 2 3 .expected eight numbers",
    "FORMAT=32-bit_rle_luv\n": "FORMAT=32-bit_rle_luv .expected 32-bit_rle_rgbe or",
}


@pytest.mark.parametrize("line", FAULTS)
def test_a_line_that_means_nothing_is_refused_and_may_be_overridden(
    tmp_path: Path, line: str
) -> None:
    head = f"#?RADIANCE\n{line}\n{SIZE}"
    path = written(tmp_path, head)
    with pytest.raises(InputError, match=rf"a\.hdr: its header has .*{FAULTS[line]}.*--input-col"):
        read_latlong(path)
    image = read_latlong(path, reading=ReadOptions(colorspace="Rec.709"))
    np.testing.assert_array_equal(image.radiance, RADIANCE)
    assert any(one.startswith("not used, as --input-colorspace") for one in image.header.warnings)


def test_a_view_of_a_camera_is_warned_of(tmp_path: Path) -> None:
    head = f"#?RADIANCE\nVIEW= -vtv -vp 0 0 0 -vh 90 -vv 45\n{FORMAT}\n{SIZE}"
    image = read_latlong(written(tmp_path, head))
    assert image.header.warnings == (
        "VIEW says that it is a perspective view; taken as a latlong, for it is 2:1",
    )


def old_runs(pixels: np.ndarray) -> bytes:
    """Code pixels as Radiance did before 1991: (1, 1, 1, n) repeats, by bytes of the count."""
    coded, place, flat = b"", 0, [tuple(pixel) for pixel in pixels.reshape(-1, 4).tolist()]
    while place < len(flat):
        count = 1
        while place + count < len(flat) and flat[place + count] == flat[place]:
            count += 1
        coded += bytes(flat[place])
        left = count - 1
        while left:
            coded += bytes([1, 1, 1, left & 255])
            left >>= 8
        place += count
    return coded


@given(st.lists(st.tuples(st.integers(2, 255), st.integers(1, 700)), min_size=1, max_size=6))
def test_old_runs_are_unrolled(runs: list[tuple[int, int]]) -> None:
    pixels = np.concatenate([np.full((count, 4), value, np.uint8) for value, count in runs])
    coded = np.frombuffer(old_runs(pixels), np.uint8)
    np.testing.assert_array_equal(unrolled(coded, len(pixels)), pixels.ravel())
    np.testing.assert_array_equal(unrolled(coded, 3), pixels.ravel()[:12])


def test_a_file_of_old_runs_is_read_and_a_cut_one_refused(tmp_path: Path) -> None:
    pixels = PIXELS.copy()
    pixels[2:5] = pixels[2, 0]
    radiance = RADIANCE.copy()
    radiance[2:5] = radiance[2, 0]
    path = written(tmp_path, f"#?RADIANCE\n{FORMAT}\n{SIZE}", old_runs(pixels))
    np.testing.assert_array_equal(read_latlong(path).radiance, radiance)
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match=r"a\.hdr: cannot be decoded"):
        read_latlong(path)


def test_runs_without_an_end_take_no_memory(tmp_path: Path) -> None:
    body = bytes([9, 9, 9, 128]) + bytes([1, 1, 1, 255]) * 4
    path = written(tmp_path, f"#?RADIANCE\n{FORMAT}\n{SIZE}", body)
    assert float(read_latlong(path).radiance.max()) == 9 / 256
