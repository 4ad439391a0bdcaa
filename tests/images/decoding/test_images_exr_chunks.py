# SPDX-License-Identifier: Apache-2.0
"""The quick decoder of OpenEXR files against OpenImageIO, on each kind of file."""

import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import OpenImageIO
import pytest
from numpy.typing import NDArray

from asglight.images.decoding import exr_chunks, strips
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.exr_chunks import ExrChunks, Unusual
from asglight.images.decoding.header import DamagedError

ROWS, COLUMNS = 75, 150
"""Beyond whole chunks of 16 and 32 rows, and beyond whole tiles."""

COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
NAMES = ("R", "G", "B")


@pytest.fixture(params=[1, 10**7], ids=["short strips", "whole"])
def strip_bytes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr_chunks, "STRIP_BYTES", request.param)


def values(kind: type = np.float16, seed: int = 3) -> NDArray:
    random = np.random.default_rng(seed)
    smooth = np.linspace(0.1, 3, ROWS * COLUMNS * 3).reshape(ROWS, COLUMNS, 3)
    return (smooth * random.uniform(0.9, 1.1, smooth.shape)).astype(kind)


def whole(path: Path, part: int = 0, *, first: int = 0) -> NDArray:
    """Return three channels as OpenImageIO decodes the whole part."""
    pixels = OpenImageIO.ImageBuf(str(path), part, 0).get_pixels(OpenImageIO.FLOAT)
    return pixels[..., first : first + 3]


def quick(path: Path, part: int = 0, names: tuple[str, str, str] = NAMES) -> NDArray:
    """Return the data window as the quick decoder reads it.  [H, W, 3] float32."""
    with closing(ExrChunks(path, part, names)) as chunks:
        rows = [np.stack(chunks.planes(*span), axis=-1) for span in chunks.spans()]
    return np.concatenate(rows).astype(np.float32)


def table(path: Path) -> list[int]:
    """Return where the chunks of the first part lie."""
    with closing(ExrChunks(path, 0, NAMES)) as chunks:
        return [int(place) for place in chunks._table]


def tiled(width: int, height: int, mode: object = OpenEXR.ONE_LEVEL) -> dict[str, object]:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize, tiles.mode = width, height, mode
    return {"type": OpenEXR.tiledimage, "tiles": tiles}


@pytest.mark.usefixtures("strip_bytes")
@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("header", [{}, tiled(32, 16), tiled(200, 100)], ids=["lines", "t", "T"])
@pytest.mark.parametrize("name", COMPRESSIONS)
def test_every_compression(
    tmp_path: Path, name: str, header: dict[str, object], kind: type
) -> None:
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    path = image_files.write_rgb(tmp_path / "a.exr", values(kind), compression=code, **header)
    np.testing.assert_array_equal(quick(path), whole(path))


def test_planes_are_of_the_type_that_is_stored(tmp_path: Path) -> None:
    for kind, found in (
        (np.float16, np.float16),
        (np.float32, np.float32),
        (np.uint32, np.float32),
    ):
        path = image_files.write_rgb(tmp_path / "a.exr", values(kind))
        with closing(ExrChunks(path, 0, NAMES)) as chunks:
            planes = chunks.planes(*next(chunks.spans()))
        assert {plane.dtype for plane in planes} == {np.dtype(found)}
        np.testing.assert_array_equal(quick(path), values(kind).astype(np.float32))


@pytest.mark.usefixtures("strip_bytes")
@pytest.mark.parametrize("name", ["NO", "ZIP"])
def test_channels_of_several_types_beside_others(tmp_path: Path, name: str) -> None:
    # in C order: OpenEXR writes the memory of an array and not its strides
    red, green, blue = np.moveaxis(values(np.float32), -1, 0).copy()
    planes = {"R": red.astype(np.float16), "G": green, "B": blue}
    others = {"A": np.ones((ROWS, COLUMNS), np.float16), "id.Z": planes["B"].astype(np.uint32)}
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    path = image_files.write(tmp_path / "a.exr", others | planes, compression=code)
    expected = np.stack([planes[one].astype(np.float32) for one in NAMES], -1)
    np.testing.assert_array_equal(quick(path), expected)
    np.testing.assert_array_equal(quick(path, 0, ("A", "A", "A")), np.ones((ROWS, COLUMNS, 3)))


@pytest.mark.usefixtures("strip_bytes")
@pytest.mark.parametrize("name", ["NO", "ZIP", "PIZ"])
def test_one_part_is_read_and_the_others_are_not_looked_at(tmp_path: Path, name: str) -> None:
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    kinds = ({}, tiled(32, 32), {"type": OpenEXR.scanlineimage})
    parts = [
        OpenEXR.Part(
            {"type": OpenEXR.scanlineimage, "compression": code, **kind},
            {"RGB": values(seed=index)},
            f"part{index}",
        )
        for index, kind in enumerate(kinds)
    ]
    path = tmp_path / "a.exr"
    OpenEXR.File(parts).write(str(path))
    for index in range(3):
        np.testing.assert_array_equal(quick(path, index), values(seed=index).astype(np.float32))
    # the pixels of the first part come first: without them the others are still read
    content = bytearray(path.read_bytes())
    first, *_, last = table(path)
    content[first:last] = bytes(last - first)
    path.write_bytes(content)
    np.testing.assert_array_equal(quick(path, 2), values(seed=2).astype(np.float32))


@pytest.mark.parametrize("mode", ["mipmap", "ripmap"])
def test_of_several_levels_the_largest_is_read(tmp_path: Path, mode: str) -> None:
    spec = OpenImageIO.ImageSpec(COLUMNS, ROWS, 3, "half")
    spec.tile_width, spec.tile_height = 32, 32
    source = OpenImageIO.ImageBuf(values(np.float32))
    source.set_write_tiles(32, 32)
    source.set_write_format("half")
    path = tmp_path / "a.exr"
    spec.attribute("maketx:filtername", "box")
    spec.attribute("maketx:resize", 0)
    assert OpenImageIO.ImageBufAlgo.make_texture(
        OpenImageIO.MakeTxTexture, source, str(path), spec
    ), OpenImageIO.geterror()
    assert OpenImageIO.ImageBuf(str(path)).nmiplevels > 1
    if mode == "ripmap":  # that is all that tells them apart before the chunks of other levels
        content = path.read_bytes()
        place = content.index(b"tiles\0tiledesc\0") + len(b"tiles\0tiledesc\0") + 4 + 8
        path.write_bytes(content[:place] + b"\x02" + content[place + 1 :])
    np.testing.assert_array_equal(quick(path), values(np.float32).astype(np.float16))


@pytest.mark.usefixtures("strip_bytes")
@pytest.mark.parametrize("name", ["NO", "ZIP"])
def test_chunks_may_lie_in_any_order(tmp_path: Path, name: str) -> None:
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    path = image_files.write_rgb(
        tmp_path / "a.exr", values(), compression=code, lineOrder=OpenEXR.DECREASING_Y
    )
    np.testing.assert_array_equal(quick(path), whole(path))
    path.write_bytes(with_chunks_reversed(path.read_bytes(), table(path)))
    np.testing.assert_array_equal(quick(path), values().astype(np.float32))


def with_chunks_reversed(content: bytes, table: list[int]) -> bytes:
    """Write the chunks of a file of lines in the opposite order."""
    start = min(table) - 8 * len(table)  # the table lies before the first chunk
    places, body = {}, b""
    for place in sorted(table, reverse=True):
        (size,) = struct.unpack_from("<i", content, place + 4)
        places[place] = min(table) + len(body)
        body += content[place : place + 8 + size]
    return content[:start] + struct.pack(f"<{len(table)}Q", *map(places.get, table)) + body


@pytest.mark.usefixtures("strip_bytes")
@pytest.mark.parametrize("header", [{}, tiled(32, 16)], ids=["lines", "tiles"])
@pytest.mark.parametrize("place", [(0, 0), (-20, -11), (7, 30), (3, -40)])
def test_a_data_window_is_placed_in_the_display(
    tmp_path: Path, place: tuple[int, int], header: dict[str, object]
) -> None:
    low = np.array(place, dtype=np.int32)
    size = np.array([COLUMNS - 1, ROWS - 1], dtype=np.int32)
    windows = {"dataWindow": (low, low + size), "displayWindow": (0 * low, size)}
    path = image_files.write_rgb(tmp_path / "a.exr", values(), **windows, **header)
    found = list(strips.read_strips(read_header(path), is_quiet=True))
    slowly = strips.read_pixels(read_header(path))
    np.testing.assert_array_equal(np.concatenate([np.stack(one, -1) for one in found]), slowly)
    assert slowly.any()


def test_long_names_and_layers(tmp_path: Path) -> None:
    name = "a_very_long_name_of_a_layer_of_light_from_the_left"
    channels = {f"{name}.{one}": values()[..., k].copy() for k, one in enumerate(NAMES)}
    path = image_files.write(tmp_path / "a.exr", channels)
    found = quick(path, 0, (f"{name}.R", f"{name}.G", f"{name}.B"))
    np.testing.assert_array_equal(found, values().astype(np.float32))


def damaged(content: bytes, count: int) -> Iterator[bytes]:
    """Yield a file with a few bytes of its pixels changed, so many times."""
    random = np.random.default_rng(5)
    for _ in range(count):
        changed = bytearray(content)
        for place in random.integers(600, len(content), 3):
            changed[place] = random.integers(256)
        yield bytes(changed)


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIP", "PIZ", "DWAA"])
def test_what_openimageio_refuses_is_refused_and_the_rest_is_the_same(
    tmp_path: Path, name: str
) -> None:
    code = getattr(OpenEXR, f"{name}_COMPRESSION")
    path = image_files.write_rgb(tmp_path / "a.exr", values(), compression=code)
    for content in damaged(path.read_bytes(), 40):
        path.write_bytes(content)
        outcomes = []
        for is_quiet in (False, True):
            try:
                planes = list(strips.read_strips(read_header(path), is_quiet=is_quiet))
            except DamagedError as error:
                outcomes.append(str(error))
            else:
                pixels = np.concatenate([np.stack(one, -1) for one in planes])
                outcomes.append(pixels.astype(np.float32).tobytes())
        assert outcomes[0] == outcomes[1]


def test_a_strip_that_is_damaged_raises_instead_of_leaving_zeros(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    content, place = bytearray(path.read_bytes()), table(path)[2]
    content[place + 8 : place + 40] = b"\xff" * 32
    path.write_bytes(content)
    with pytest.raises(Unusual):
        quick(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content[: len(content) // 2],
        lambda content: content[:200],
        lambda content: content.replace(b"compression\0", b"compressiom\0"),
        lambda content: content[:4] + struct.pack("<I", 2 | 0x800) + content[8:],
        lambda content: content[:4] + struct.pack("<I", 3) + content[8:],
    ],
    ids=["half", "header", "no compression", "deep", "version"],
)
def test_what_it_does_not_know_is_unusual(tmp_path: Path, change: object) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(Unusual):
        quick(path)


def test_other_channels_than_the_file_has_are_unusual(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    with pytest.raises(Unusual):
        ExrChunks(path, 0, ("X", "Y", "Z"))
    with pytest.raises(Unusual):
        ExrChunks(path, 1, NAMES)


def test_the_quick_decoder_is_the_one_that_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = image_files.write_rgb(tmp_path / "a.exr", values())
    monkeypatch.setattr(strips, "_rows", lambda *_: pytest.fail("OpenImageIO was asked"))
    found = list(strips.read_strips(read_header(path), is_quiet=True))
    np.testing.assert_array_equal(np.concatenate([np.stack(one, -1) for one in found]), values())
