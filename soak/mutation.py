# SPDX-License-Identifier: Apache-2.0
"""Ways to damage a file: blindly, at the fields of its format, and by splicing in another one."""

import json
import random
import re
import zlib
from collections.abc import Callable

NUMBERS = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 2**20, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS_WIDE = (*NUMBERS, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
TEXTS = (
    *(b"-1", b"0", b"1e999", b"-1e999", b"nan", b"inf", b"99999999999999999999", b"0.0001", b""),
    *(b"null", b"[]", b"{}", b'""', b"true", b"[" * 2000, b'"\\ud800"', b"\xff", b"\0"),
)
"""What a number of a text file is replaced by."""

FIELDS = {
    ".exr": (
        *(b"channels\0", b"compression\0", b"dataWindow\0", b"displayWindow\0", b"lineOrder\0"),
        *(b"tiles\0", b"chunkCount\0", b"type\0", b"envmap\0", b"v2f\0", b"box2i\0", b"chlist\0"),
        *(b"chromaticities\0", b"colorInteropID\0", b"whiteLuminance\0", b"multiView\0", b"view\0"),
    ),
    ".hdr": (
        *(b"FORMAT=", b"\n\n-Y ", b" +X ", b"\n\n+X ", b"EXPOSURE=", b"COLORCORR=", b"GAMMA="),
        *(b"PRIMARIES=", b"VIEW="),
    ),
    ".tif": (b"II*\0", b"MM\0*"),
    ".pfm": (b"PF\n",),
    ".png": (b"IHDR", b"IDAT", b"IEND"),
    ".jpg": (b"\xff\xc0", b"\xff\xc4", b"\xff\xda", b"\xff\xdb"),
    ".webp": (b"RIFF", b"WEBP", b"VP8"),
    ".usda": (b"timeSamples", b"variantSet", b"rel ", b"customData", b"apiSchemas", b"def "),
    ".usdc": (b"TOKENS\0", b"STRINGS\0", b"FIELDS\0", b"FIELDSETS\0", b"PATHS\0", b"SPECS\0"),
    ".usdz": (b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"TOKENS\0", b"PATHS\0", b"SPECS\0"),
    ".npy": (b"descr", b"fortran_order", b"shape", b"NUMPY"),
    ".json": (b'"frames"', b'"fps"', b'"form"', b'"lobes"', b'"quaternion"', b'"version"'),
    ".checkpoint": (b'"lobes"', b'"form"', b'"repair"', b'"frame"', b'"stamp"', b'"frames"'),
}
"""Where the fields of a format begin, by suffix: damage is done near them."""

REACH = 48
"""Bytes after such a place that count as near it."""

Mutate = Callable[[bytearray, random.Random], None]


def mutated(data: bytes, others: list[bytes], suffix: str, rng: random.Random) -> bytes:
    """Return a damaged copy of a file.

    Args:
        data: The file.
        others: Files of the same kind, of which parts may come.
        suffix: Its kind.
        rng: Decides.
    """
    result = bytearray(data)
    # mostly little, so that what is damaged is met late; sometimes a lot
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4, 8, 16))):
        if not result:
            break
        choice = rng.random()
        if choice < 0.3:
            _near_field(result, suffix, rng)
        elif choice < 0.4:
            _splice(result, rng.choice(others), rng)
        elif choice < 0.5:
            _text_number(result, rng)
        else:
            rng.choice(_BLIND)(result, rng)
    if suffix == ".checkpoint" and rng.random() < 0.7:
        return signed(bytes(result))
    return bytes(result)


def signed(data: bytes) -> bytes:
    """Give the damaged lines of a checkpoint checksums that fit."""
    lines = []
    for line in data.split(b"\n"):
        match = re.match(rb'\{"record":(.*),"crc32":"[0-9a-f]{8}"\}$', line, re.DOTALL)
        if match:
            line = b'{"record":%s,"crc32":"%08x"}' % (match[1], zlib.crc32(match[1]))
        lines.append(line)
    return b"\n".join(lines)


def _near_field(data: bytearray, suffix: str, rng: random.Random) -> None:
    places = [m.start() for field in FIELDS[suffix] for m in re.finditer(re.escape(field), data)]
    if not places:
        _overwrite(data, rng)
        return
    place = rng.choice(places) + rng.randrange(REACH)
    if rng.random() < 0.5:
        _put_number(data, min(place, len(data) - 1), rng)
    else:
        data[min(place, len(data) - 1)] = rng.randrange(256)


def _put_number(data: bytearray, place: int, rng: random.Random) -> None:
    width = rng.choice((1, 2, 4, 4, 8))
    number = rng.choice(NUMBERS_WIDE) % 2 ** (8 * width)
    data[place : place + width] = number.to_bytes(width, "little")


def _overwrite(data: bytearray, rng: random.Random) -> None:
    _put_number(data, rng.randrange(len(data)), rng)


def _flip(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _byte(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] = rng.randrange(256)


def _truncate(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _delete(data: bytearray, rng: random.Random) -> None:
    place = rng.randrange(len(data))
    del data[place : place + rng.randrange(1, 64)]


def _repeat(data: bytearray, rng: random.Random) -> None:
    place = rng.randrange(len(data))
    data[place:place] = data[place : place + rng.randrange(1, 256)] * rng.choice((1, 1, 2, 8))


def _fill(data: bytearray, rng: random.Random) -> None:
    place, length = rng.randrange(len(data)), rng.randrange(1, 64)
    data[place : place + length] = bytes([rng.choice((0, 255, 32))]) * length


def _splice(data: bytearray, other: bytes, rng: random.Random) -> None:
    place, start = rng.randrange(len(data)), rng.randrange(max(len(other), 1))
    length = rng.randrange(1, 512)
    data[place : place + length] = other[start : start + length]


def _text_number(data: bytearray, rng: random.Random) -> None:
    """Replace a number that is written out; in a binary file there is mostly none."""
    matches = list(re.finditer(rb"-?\d+(\.\d+)?", data))
    if not matches:
        _byte(data, rng)
        return
    match = rng.choice(matches)
    new = rng.choice((*TEXTS, json.dumps(rng.choice(NUMBERS_WIDE)).encode()))
    data[match.start() : match.end()] = new


_BLIND: tuple[Mutate, ...] = (_flip, _flip, _byte, _byte, _overwrite, _truncate, _delete, _repeat)
_BLIND += (_fill,)
