# SPDX-License-Identifier: Apache-2.0
"""Small image files for the tests, written by OpenEXR or byte by byte, never by asglight."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR

# Every value is exact in half float, so that what is read can be compared with ==.
STEP = 1 / 8


def ramp(height: int = 4, width: int = 8, dtype: type = np.float32) -> np.ndarray:
    """Return an image in which every value differs.  [H, W, 3]."""
    values = np.arange(1, height * width * 3 + 1).reshape(height, width, 3)
    return values.astype(dtype) if dtype == np.uint32 else (values * STEP).astype(dtype)


def write(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    """Write a scanline or tiled file of one part."""
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))
    return path


def write_rgb(path: Path, values: np.ndarray, **header: object) -> Path:
    return write(path, {"RGB": values}, **header)


def constant(path: Path, value: float, height: int = 4) -> Path:
    return write_rgb(path, np.full((height, 2 * height, 3), value, dtype=np.float32))


def _attribute(name: str, kind: str, value: bytes) -> bytes:
    return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value


def raw_exr(
    path: Path,
    channels: dict[str, tuple[np.ndarray, int]],
    size: tuple[int, int],
    *,
    version: int = 2,
    compression: int = 0,
    attributes: Sequence[tuple[str, str, bytes]] = (),
) -> Path:
    """Write an uncompressed file as the OpenEXR format describes it, for what the API refuses.

    Args:
        path: The file.
        channels: Values and sampling step (both axes) by name.
        size: Columns and rows that the header claims.
        version: Version field.
        compression: Compression code; the pixels are stored raw whatever it says.
        attributes: More of them: name, type, value.
    """
    columns, rows = size
    kinds = {"uint32": 0, "float16": 1, "float32": 2}
    names = sorted(channels)
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", kinds[values.dtype.name], 0, step, step)
        for name, (values, step) in ((name, channels[name]) for name in names)
    )
    window = struct.pack("<4i", 0, 0, columns - 1, rows - 1)
    header = struct.pack("<ii", 20000630, version) + b"".join(
        [
            _attribute("channels", "chlist", listed + b"\0"),
            _attribute("compression", "compression", bytes([compression])),
            _attribute("dataWindow", "box2i", window),
            _attribute("displayWindow", "box2i", window),
            _attribute("lineOrder", "lineOrder", b"\0"),
            _attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            _attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            *(_attribute(*each) for each in attributes),
            b"\0",
        ]
    )
    stored = max((len(values) * step for values, step in channels.values()), default=0)
    lines = []
    for row in range(stored):
        data = b"".join(
            channels[name][0][row // channels[name][1]].tobytes()
            for name in names
            if row % channels[name][1] == 0
        )
        lines.append(struct.pack("<ii", row, len(data)) + data)
    offset, table = len(header) + 8 * stored, b""
    for line in lines:
        table += struct.pack("<Q", offset)
        offset += len(line)
    path.write_bytes(header + table + b"".join(lines))
    return path


def rgbe(height: int = 4, width: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Return random RGBE bytes and the radiance they mean (Ward 1991).  [H, W, 4], [H, W, 3]."""
    random = np.random.default_rng(7)
    pixels = random.integers(1, 255, (height, width, 4), dtype=np.uint8)
    pixels[..., 3] = random.integers(126, 134, (height, width))
    mantissa, exponent = pixels[..., :3].astype(np.float64), pixels[..., 3:].astype(np.float64)
    return pixels, mantissa * 2.0 ** (exponent - 136)


def hdr_bytes(pixels: np.ndarray, *, size: str, extra: str = "", run_length: bool = False) -> bytes:
    """Return a Radiance file, flat or with new-style run-length coding."""
    head = f"#?RADIANCE\n{extra}FORMAT=32-bit_rle_rgbe\n\n{size}\n".encode()
    if not run_length:
        return head + pixels.tobytes()
    body = b""
    for row in pixels:
        count = len(row)
        body += bytes([2, 2, count >> 8, count & 255])
        body += b"".join(bytes([count]) + row[:, channel].tobytes() for channel in range(4))
    return head + body
