# SPDX-License-Identifier: Apache-2.0
"""Damaged and wrong files are refused in one line that names the file."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import image_files
import numpy as np
import OpenEXR
import OpenImageIO
import pytest
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st

from asglight.errors import InputError
from asglight.images import read_latlong

COMPRESSIONS = [name for name in OpenEXR.Compression.__members__ if name.endswith("_COMPRESSION")]
PLANE = np.ones((4, 8), dtype=np.float32)
PLANES = {channel: (PLANE, 1) for channel in "RGB"}


def starting_with(start: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(start + bytes(64))


def of_size(width: int, height: int) -> Callable[[Path], object]:
    return lambda path: image_files.write_rgb(path, np.ones((height, width, 3), dtype=np.float32))


def radiance(
    size: str, *, start: str = "#?RADIANCE\n", keep: int = 10_000
) -> Callable[[Path], int]:
    pixels, _ = image_files.rgbe()
    data = image_files.hdr_bytes(pixels, size=size).replace(b"#?RADIANCE\n", start.encode())
    return lambda path: path.write_bytes(data[:keep])


def planes(names: str) -> Callable[[Path], object]:
    return lambda path: image_files.write(path, {name: PLANE for name in names.split()})


def deep(path: Path) -> None:
    spec = OpenImageIO.ImageSpec(8, 4, 3, "float")
    spec.deep = True
    data = OpenImageIO.DeepData()
    data.init(32, 3, ("float",) * 3, ("R", "G", "B"))
    output = OpenImageIO.ImageOutput.create(str(path))
    assert output is not None
    assert output.open(str(path), spec)
    assert output.write_deep_image(data)
    output.close()


def outside(path: Path) -> None:
    low, high = np.array([20, 20], dtype=np.int32), np.array([27, 23], dtype=np.int32)
    image_files.write_rgb(
        path,
        image_files.ramp(),
        dataWindow=(low, high),
        displayWindow=(low - 20, high - 20),
    )


def too_wide(path: Path) -> None:
    low, high = np.array([0, 0], dtype=np.int32), np.array([39_999, 19_999], dtype=np.int32)
    image_files.write_rgb(path, image_files.ramp(), displayWindow=(low, high))


FAULTS: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "empty": ("a.exr", lambda path: path.touch(), "is empty; expected an OpenEXR"),
    "text": ("a.exr", lambda path: path.write_text("frame 1 failed\n" * 9), "is text; "),
    "zeros": ("a.exr", starting_with(b"\0"), "is of an unknown kind"),
    "folder": ("a.exr", lambda path: path.mkdir(), "is a folder; expected an image file"),
    "pipe": ("a.exr", lambda path: os.mkfifo(path), "is not a regular file"),
    "absent": ("a.exr", lambda path: None, "cannot be opened .No such file"),
    "link to nowhere": ("a.exr", lambda path: path.symlink_to("gone"), "cannot be opened"),
    "link to itself": ("a.exr", lambda path: path.symlink_to(path), "cannot be opened"),
    "cut png": ("a.exr", starting_with(b"\x89PNG\r\n"), "cannot be decoded"),
    "cut jpeg": ("a.hdr", starting_with(b"\xff\xd8\xff\xe0"), "cannot be decoded"),
    "cut tiff": ("a.tif", starting_with(b"II*\0"), "cannot be decoded"),
    "dpx": ("a.exr", starting_with(b"SDPX"), "is a DPX image"),
    "cut pfm": ("a.pfm", starting_with(b"PF\n8 4\n-1.0\n"), "cannot be decoded"),
    "gif": ("a.gif", starting_with(b"GIF89a"), "is a GIF image"),
    "zip": ("a.exr", starting_with(b"PK\x03\x04"), "is a zip archive"),
    "gzip": ("a.exr.gz", starting_with(b"\x1f\x8b"), "is a gzip archive"),
    "magic only": ("a.exr", lambda p: p.write_bytes(b"\x76\x2f\x31\x01"), "cannot be decoded"),
    "future version": (
        "a.exr",
        lambda path: image_files.raw_exr(path, PLANES, (8, 4), version=9),
        r"cannot be decoded \(.*unsupported version: 9",
    ),
    "no channels": ("a.exr", lambda p: image_files.raw_exr(p, {}, (8, 4)), "cannot be decoded"),
    "far too large": (
        "a.exr",
        lambda path: image_files.raw_exr(path, PLANES, (2_000_000, 1_000_000)),
        "cannot be decoded .*exceeds",
    ),
    "claims more than it holds": (
        "a.exr",
        lambda path: image_files.raw_exr(path, PLANES, (32768, 16384)),
        "cannot be decoded .*claims a",
    ),
    "negative size": (
        "a.exr",
        lambda path: image_files.raw_exr(path, PLANES, (-8, -4)),
        "cannot be decoded",
    ),
    "deep": ("a.exr", deep, "holds deep data; expected a flat image"),
    "depth": ("a.exr", planes("Z"), "has channels Z; expected R, G, B; X, Y, Z; Y, RY, BY; or Y"),
    "no blue": ("a.exr", planes("R G A"), "has channels R, G, A; expected"),
    "many mattes": ("a.exr", planes(" ".join(f"m{i:02}" for i in range(20))), "m07 and 12 more; "),
    "cropped away": ("a.exr", outside, "its data window lies outside its display window"),
    "too wide": ("a.exr", too_wide, "declares 40000 x 20000 texels; expected at most 32768 a side"),
    "one texel": ("a.exr", of_size(1, 1), "is 1 x 1; expected a 2:1 latlong. .* angular map"),
    "square": ("a.exr", of_size(8, 8), "is 8 x 8; .*1:1: probably an angular map, a mirror ball"),
    "cross": ("a.exr", of_size(12, 9), "is 12 x 9; .*4:3: probably a cube cross"),
    "upright cross": ("a.exr", of_size(9, 12), "is 9 x 12; .*3:4: probably a cube cross"),
    "strip": ("a.exr", of_size(24, 4), "is 24 x 4; .*6:1: probably a strip of cube faces"),
    "upright strip": ("a.exr", of_size(4, 24), "is 4 x 24; .*1:6: probably a strip of cube faces"),
    "turned": ("a.exr", of_size(4, 8), "is 4 x 8; .*1:2: probably a latlong turned by 90 degrees"),
    "plate": ("a.exr", of_size(32, 18), "is 32 x 18; .*16:9: probably a camera plate"),
    "padded plate": ("a.exr", of_size(240, 136), "is 240 x 136; .*16:9: probably a camera plate"),
    "almost": ("a.exr", of_size(128, 63), "is 128 x 63; .*almost 2:1: probably .* cropped"),
    "odd": ("a.exr", of_size(50, 20), "is 50 x 20; expected a 2:1 latlong. Is it a camera plate"),
    "square hdr": ("a.hdr", radiance("-Y 4 +X 4"), "is 4 x 4; .*1:1"),
    "cut hdr": ("a.hdr", radiance("-Y 4 +X 8", keep=100), "cannot be decoded .Read error"),
    "cut hdr header": ("a.hdr", radiance("-Y 4 +X 8", keep=20), "cannot be decoded .*end of file"),
    "negative hdr": ("a.hdr", radiance("-Y -4 +X 8"), "cannot be decoded .*at least 1x1"),
    "huge hdr": ("a.hdr", radiance("-Y 20000 +X 40000"), "declares 20000 x 40000 texels"),
    "pic without magic": ("a.pic", radiance("-Y 4 +X 8", start="PICTURE\n"), "is text; "),
    "line break in its name": ("a\nb.exr", of_size(8, 8), r"a\?b\.exr: is 8 x 8"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_file_is_refused_in_one_line_that_names_it(tmp_path: Path, fault: str) -> None:
    name, make, message = FAULTS[fault]
    make(tmp_path / name)
    with pytest.raises(InputError, match=message) as caught:
        read_latlong(tmp_path / name, height=2)
    text = str(caught.value)
    assert text.isprintable()
    assert name.replace("\n", "?") in text
    assert "; expected " in text


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("name", COMPRESSIONS)
def test_cut_file_of_every_compression_is_refused(tmp_path: Path, name: str, keep: float) -> None:
    values = 1 + np.random.default_rng(3).random((64, 128, 3)).astype(np.float16)
    path = image_files.write_rgb(tmp_path / "cut.exr", values, compression=getattr(OpenEXR, name))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(InputError, match=r"cut\.exr: cannot be decoded \(.*interrupted\?$"):
        read_latlong(path)


def test_tile_that_is_missing_is_not_read_as_black(tmp_path: Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    values = 1 + np.random.default_rng(3).random((32, 64, 3)).astype(np.float32)
    path = image_files.write_rgb(tmp_path / "t.exr", values, type=OpenEXR.tiledimage, tiles=tiles)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"t\.exr: cannot be decoded \(Some tiles were missing"):
        read_latlong(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_file_without_permission_is_refused(tmp_path: Path) -> None:
    path = image_files.constant(tmp_path / "p.exr", 1)
    path.chmod(0)
    with pytest.raises(InputError, match=r"p\.exr: cannot be opened \(Permission denied\)"):
        read_latlong(path)


def test_channel_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = image_files.raw_exr(tmp_path / "n.exr", PLANES, (8, 4))
    path.write_bytes(path.read_bytes().replace(b"R\0" + struct.pack("<i", 2), b"\xff\0\2\0\0\0"))
    with pytest.raises(InputError, match=r"n\.exr: ") as caught:
        read_latlong(path)
    assert str(caught.value).isprintable()


def specimens() -> list[bytes]:
    """Return one small file of several kinds, to be damaged."""
    with TemporaryDirectory() as folder:
        files = [
            image_files.write_rgb(
                Path(folder) / f"{name}.exr",
                image_files.ramp(8, 16),
                compression=getattr(OpenEXR, name),
            ).read_bytes()
            for name in ("NO_COMPRESSION", "ZIP_COMPRESSION", "PIZ_COMPRESSION", "DWAA_COMPRESSION")
        ]
    pixels, _ = image_files.rgbe(8, 16)
    return [*files, image_files.hdr_bytes(pixels, size="-Y 8 +X 16", run_length=True)]


SPECIMENS = specimens()


@pytest.mark.thorough
@given(
    specimen=st.sampled_from(range(len(SPECIMENS))),
    damage=st.lists(st.tuples(st.integers(0, 600), st.integers(0, 255)), min_size=1, max_size=5),
    cut=st.integers(0, 2000),
)
@settings(max_examples=tries(300), deadline=None)
def test_damaged_file_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory,
    specimen: int,
    damage: list[tuple[int, int]],
    cut: int,
) -> None:
    data = bytearray(SPECIMENS[specimen])
    for place, byte in damage:
        data[place % len(data)] = byte
    path = tmp_path_factory.mktemp("damage") / "d.exr"
    path.write_bytes(data[: len(data) - cut] if cut < 1000 else data)
    try:
        outcome = read_latlong(path, height=2)
    except InputError as error:
        outcome = str(error)
    if isinstance(outcome, str):
        assert outcome.isprintable()
        assert "d.exr: " in outcome
    else:
        assert bool((outcome.radiance >= 0).all())
