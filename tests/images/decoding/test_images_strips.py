# SPDX-License-Identifier: Apache-2.0
"""Images that are larger than a strip are read as if they were decoded at once."""

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import OpenImageIO
import pytest
from places import ROOT

from asglight.errors import InputError
from asglight.images import read_latlong
from asglight.images.decoding import decode, strips
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.header import DamagedError
from asglight.images.options import ReadOptions

ROWS, COLUMNS = 24, 48
COMPRESSIONS = ("NO", "ZIP", "PIZ", "DWAB")  # chunks of 1, 16, 32 and 256 rows


@pytest.fixture(params=[1, 5, 16, 24])
def short(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Make strips so short that a small image has several, whole chunks or not."""
    monkeypatch.setattr(strips, "STRIP_ROWS", request.param)
    return request.param


def values() -> np.ndarray:
    return np.random.default_rng(2).random((ROWS, COLUMNS, 3)).astype(np.float16)


def whole(path: Path) -> np.ndarray:
    """Return what OpenImageIO decodes at once, with other functions than the strips use."""
    return OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)[..., :3]


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_strips_are_the_rows_of_the_whole(tmp_path: Path, short: int, name: str) -> None:
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    path = image_files.write_rgb(tmp_path / "a.exr", values(), compression=code)
    found = [np.stack(planes, -1) for planes in strips.read_strips(read_header(path))]
    assert [len(strip) for strip in found[:-1]] == [short] * (len(found) - 1)
    np.testing.assert_array_equal(np.concatenate(found), whole(path))


def test_strips_of_a_tiled_file_are_its_rows(tmp_path: Path, short: int) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 7, 10
    path = image_files.write_rgb(tmp_path / "t.exr", values(), type=OpenEXR.tiledimage, tiles=tiles)
    np.testing.assert_array_equal(strips.read_pixels(read_header(path)), values())


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("place", [(3, 2), (-3, -2), (0, 9), (-20, -11)])
def test_a_data_window_lands_in_the_strips_that_show_it(
    tmp_path: Path, short: int, place: tuple[int, int], tiled: bool
) -> None:
    left, top = place
    low = np.array([left, top], dtype=np.int32)
    size = np.array([COLUMNS - 1, ROWS - 1], dtype=np.int32)
    header: dict[str, object] = {"dataWindow": (low, low + size), "displayWindow": (0 * low, size)}
    if tiled:
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        header["tiles"].xSize = header["tiles"].ySize = 8
    path = image_files.write_rgb(tmp_path / "w.exr", values(), **header)
    canvas = np.zeros((3 * ROWS, 3 * COLUMNS, 3), np.float32)  # the display in the middle
    canvas[ROWS + top : 2 * ROWS + top, COLUMNS + left : 2 * COLUMNS + left] = values()
    expected = canvas[ROWS : 2 * ROWS, COLUMNS : 2 * COLUMNS]
    np.testing.assert_array_equal(strips.read_pixels(read_header(path)), expected)


@pytest.mark.parametrize("size", ["-Y 8 +X 16", "+Y 8 -X 16", "-X 16 +Y 8"])
def test_strips_of_a_turned_radiance_file_are_upright(
    tmp_path: Path, short: int, size: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows, columns = (16, 8) if size.startswith("-X") else (8, 16)
    pixels, _ = image_files.rgbe(rows, columns)
    path = tmp_path / "a.hdr"
    path.write_bytes(image_files.hdr_bytes(pixels, size=size))
    in_strips = strips.read_pixels(read_header(path))
    monkeypatch.setattr(strips, "STRIP_ROWS", 1000)
    np.testing.assert_array_equal(in_strips, strips.read_pixels(read_header(path)))


def turned_exr(
    path: Path,
    values: np.ndarray,
    corner: tuple[int, int],
    display: tuple[int, int],
    orientation: int,
) -> Path:
    """Write stored rows at a place of a display window, which Orientation says how to turn."""
    spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], 3, OpenImageIO.FLOAT)
    spec.x, spec.y = corner
    spec.full_width, spec.full_height = display
    spec.attribute("Orientation", orientation)
    output = OpenImageIO.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(values.astype(np.float32)), output.geterror()
    output.close()
    return path


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ((4, 2, 20, 10), [0, 0, 0, 0, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0]),
        ((-4, -2, 40, 20), [18, 17, 16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3]),
        ((-4, 2, 40, 30), [14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0]),
    ],
)
def test_a_data_window_is_placed_before_it_is_turned(
    tmp_path: Path, short: int, window: tuple[int, int, int, int], expected: list[int]
) -> None:
    left, top, width, height = window
    values = np.broadcast_to(np.arange(1, height + 1)[:, None, None], (height, width, 3))
    path = turned_exr(tmp_path / "t.exr", values, (left, top), (32, 16), 3)
    found = read_latlong(path).radiance.numpy()
    np.testing.assert_array_equal(found[:, 16, 1], expected)
    # turned by 180 degrees, columns 4 to 23 of 32 are 8 to 27
    lit = np.flatnonzero(found[6, :, 0])
    assert (lit[0], lit[-1]) == ((8, 27) if left == 4 else (0, 31))


@pytest.mark.parametrize("eye", [None, "left", "right"])
def test_a_data_window_lands_where_a_quarter_turn_brings_it(
    tmp_path: Path, short: int, eye: str | None
) -> None:
    """TIFF 6.0, orientation 6: row 0 is the right side, column 0 the top."""
    rows, columns = (32, 32 if eye else 16)  # with eyes, one over the other
    values = np.random.default_rng(5).random((20, 9, 3)).astype(np.float32)
    left, top = 12 if eye else 2, 5
    path = turned_exr(tmp_path / "q.exr", values, (left, top), (columns, rows), 6)
    expected = np.zeros((columns, rows, 3), np.float32)
    for row in range(20):
        for column in range(9):
            expected[left + column, rows - 1 - (top + row)] = values[row, column]
    if eye:
        expected = expected[:16] if eye == "left" else expected[16:]
    reading = ReadOptions(eye=eye)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(read_latlong(path, reading=reading).radiance, expected)


def test_a_turned_data_window_outside_the_display_is_refused(tmp_path: Path) -> None:
    path = turned_exr(tmp_path / "out.exr", values(), (40, 0), (32, 16), 3)
    with pytest.raises(InputError, match=r"out\.exr: its data window lies outside its display"):
        read_latlong(path)


@pytest.mark.parametrize("rows", [3, 5])
def test_other_rows_than_the_header_says_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    def reduced(*_: object) -> Iterator[np.ndarray]:
        yield np.ones((rows, 8, 3), np.float32)

    monkeypatch.setattr(strips, "reduced_strips", reduced)
    path = image_files.constant(tmp_path / "a.exr", 1)
    with pytest.raises(DamagedError, match=rf"a\.exr: cannot be decoded \({rows} of 4 rows came\)"):
        read_latlong(path)


def test_repair_counts_over_all_strips(tmp_path: Path, short: int) -> None:
    image = np.ones((ROWS, COLUMNS, 3), dtype=np.float32)
    image[3, 5, 0] = np.nan
    image[20, 7] = -1
    path = image_files.write_rgb(tmp_path / "a.exr", image)
    account = read_latlong(path, height=4).repair
    assert (account.nonfinite, account.negative, account.first) == (1, 1, (3, 5))
    edges = np.sin(np.pi / 2 - np.pi * np.arange(ROWS + 1) / ROWS)
    bands = 3 * (edges[:-1] - edges[1:])
    above = COLUMNS * bands.sum() - bands[20] - bands[3] / 3
    # float32 texels, added up to the reduced map's
    assert account.negative_flux_ratio == pytest.approx(bands[20] / above, rel=1e-6)


def test_a_large_image_takes_the_memory_of_strips(tmp_path: Path) -> None:
    image = np.zeros((2048, 4096, 3), np.float16)
    path = image_files.write_rgb(tmp_path / "a.exr", image)
    del image
    tracemalloc.start()
    read_latlong(path, height=64)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # numpy's own: the strip that is used, the one that follows and its planes, of 2048 rows an
    # eighth each
    assert peak <= 3.5 / 8 * 2048 * 4096 * 3 * 4


def test_a_bomb_is_refused_by_its_declared_size(tmp_path: Path) -> None:
    plane = np.ones((4, 8), dtype=np.float32)
    planes = {channel: (plane, 1) for channel in "RGB"}
    path = image_files.raw_exr(tmp_path / "bomb.exr", planes, (32768, 16384), compression=9)
    with pytest.raises(InputError, match=r"bomb\.exr: ") as caught:
        read_header(path)
    assert "32768 x 16384" in str(caught.value) or "claims a" in str(caught.value)


def test_a_real_bomb_is_refused_before_a_pixel_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decode, "TEXELS_TRUSTED", 1024 * 512)
    black = np.zeros((1024, 2048, 3), np.float16)
    path = image_files.write_rgb(
        tmp_path / "black.exr", black, compression=OpenEXR.DWAB_COMPRESSION
    )
    bytes_there = path.stat().st_size
    assert bytes_there < 1024 * 2048 / decode.TEXELS_A_BYTE_MAX  # that is what makes it one
    message = (
        rf"black\.exr: declares 2048 x 1024 texels in {bytes_there} bytes; expected a file of at "
        r"least 2097 bytes\. Is the header damaged\?$"
    )
    with pytest.raises(InputError, match=message):
        read_latlong(path)


def test_an_openexr_that_files_can_take_over_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    decode.check_decoder.__wrapped__()  # the one that is installed will do
    for libraries, found in (("openexr:OpenEXR 3.4.9;tiff:x", "OpenEXR 3.4.9"), ("", "no OpenEXR")):
        monkeypatch.setattr(OpenImageIO, "get_string_attribute", lambda _, said=libraries: said)
        with pytest.raises(InputError, match=rf"holds {found}; expected OpenEXR 3\.4\.10 or later"):
            decode.check_decoder.__wrapped__()


def test_the_package_requires_an_openexr_that_files_cannot_take_over() -> None:
    import tomllib

    root = ROOT
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    (wanted,) = [line for line in project["dependencies"] if line.startswith("OpenEXR")]
    name, _, version = wanted.partition(">=")
    assert name == "OpenEXR"
    assert tuple(map(int, version.split("."))) >= decode.OPENEXR_MIN
    pinned = dict(
        line.strip().split("==")
        for line in (root / "constraints.txt").read_text().splitlines()
        if "==" in line
    )
    assert tuple(map(int, pinned["OpenEXR"].split("."))) >= decode.OPENEXR_MIN
