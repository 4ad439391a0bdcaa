# SPDX-License-Identifier: Apache-2.0
"""Lines of a checkpoint: one JSON record each, with a checksum, and lobes exact to the bit.

A line is `{"record":<JSON>,"crc32":"<8 hex digits>"}`; the CRC-32 is that of the bytes of <JSON>.
Lobes are stored as base64 of little-endian float32: axes, sharpness and amplitude of each lobe one
after the other, 14 numbers a lobe. A line is data only; reading one runs no code.
"""

import base64
import dataclasses
import json
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from asglight.images import Repair
from asglight.lobes import Form, Lobes

_HEAD = b'{"record":'
_TAIL = b',"crc32":"%08x"}\n'
_TAIL_LENGTH = len(_TAIL % 0)
_NUMBERS_A_LOBE = 9 + 2 + 3


@dataclass(frozen=True)
class FrameRecord:
    """One fitted frame.

    Attributes:
        frame: Frame number.
        lobes: Its lobes, float32 on the CPU.  [N, .]
        loss: The preset's own loss.
        flux_error: Flux of the lobes over that of the map, minus 1.
        repair: What was changed in the image.
        stamp: Size in bytes and modification time in ns of the image file.
        seconds: Time the frame took, reading included.
        repeats: The earlier frame with the same pixels, whose lobes these are; None for its own.
    """

    frame: int
    lobes: Lobes
    loss: float
    flux_error: float
    repair: Repair
    stamp: tuple[int, int]
    seconds: float
    repeats: int | None = None


def line_from(record: dict[str, Any]) -> bytes:
    """Return a record as a line with its checksum."""
    body = json.dumps(record, separators=(",", ":")).encode()
    return _HEAD + body + _TAIL % zlib.crc32(body)


def parse_line(line: bytes) -> dict[str, Any] | None:
    """Return the record of a line; None for a line that is cut off or damaged."""
    body = line[len(_HEAD) : -_TAIL_LENGTH]
    if line != _HEAD + body + _TAIL % zlib.crc32(body):
        return None
    try:
        record = json.loads(body)
    except (ValueError, RecursionError):  # whoever damages a line on purpose mends its checksum
        return None
    return record if isinstance(record, dict) else None


def to_json(record: FrameRecord) -> dict[str, Any]:
    """Return a frame as JSON values."""
    return {
        "frame": record.frame,
        "form": str(record.lobes.form),
        "lobes": _text_from_lobes(record.lobes),
        "loss": record.loss,
        "flux_error": record.flux_error,
        "repair": dataclasses.asdict(record.repair),
        "stamp": list(record.stamp),
        "seconds": record.seconds,
        "repeats": record.repeats,
    }


def from_json(record: dict[str, Any]) -> FrameRecord:
    """Return the frame that `to_json` made JSON values of.

    Raises:
        KeyError, TypeError, ValueError: The values are not such a frame.
    """
    size, time = (whole(value) for value in record["stamp"])
    repeats = record["repeats"]
    return FrameRecord(
        frame=whole(record["frame"]),
        lobes=_lobes_from_text(record["lobes"], Form(record["form"])),
        loss=number(record["loss"]),
        flux_error=number(record["flux_error"]),
        repair=_repair(record["repair"]),
        stamp=(size, time),
        seconds=number(record["seconds"]),
        repeats=None if repeats is None else whole(repeats),
    )


def _repair(values: dict[str, Any]) -> Repair:
    first = values["first"]
    if first is not None:
        row, column = map(whole, first)
        first = (row, column)
    return Repair(
        negative=whole(values["negative"]),
        nonfinite=whole(values["nonfinite"]),
        infinite=whole(values["infinite"]),
        negative_flux_ratio=number(values["negative_flux_ratio"]),
        first=first,
        filled_from=tuple(map(whole, values["filled_from"])),
        fault=str(values["fault"]),
    )


def whole(value: Any) -> int:
    """Return a whole number of 64 bits; what is none is a fault of the line."""
    if type(value) is not int or abs(value) >= 2**63:
        raise ValueError(value)
    return value


def number(value: Any) -> float:
    """Return a float; JSON writes one without a fraction as a whole number."""
    if type(value) is float:
        return value
    return float(whole(value))


def repeated_by(last: FrameRecord) -> int:
    """Return which frame one repeats that shows what the last one shows."""
    return last.frame if last.repeats is None else last.repeats


def own_frames(records: list[FrameRecord]) -> list[FrameRecord]:
    """Return the frames that repeat no other."""
    return [record for record in records if record.repeats is None]


def places_of(records: list[FrameRecord]) -> list[int]:
    """Return for each frame which of `own_frames` holds its lobes."""
    places: list[int] = []
    for record in records:
        places.append((places[-1] if places else -1) + (record.repeats is None))
    return places


def _text_from_lobes(lobes: Lobes) -> str:
    assert lobes.axes.dtype == torch.float32, lobes.axes.dtype
    parts = [lobes.axes.flatten(-2), lobes.sharpness, lobes.amplitude]
    numbers = torch.cat(parts, dim=-1).numpy()  # [N, 14]
    return base64.b64encode(numbers.astype("<f4").tobytes()).decode()


def _lobes_from_text(text: str, form: Form) -> Lobes:
    data = base64.b64decode(text, validate=True)
    numbers = np.frombuffer(data, "<f4").reshape(-1, _NUMBERS_A_LOBE)
    if not len(numbers) or not np.isfinite(numbers).all():
        raise ValueError(text)
    # Each tensor is copied into memory of its own, aligned as the tensors of an unbroken run are:
    # the results of vectorised sums may depend on it.
    axes, sharpness, amplitude = (
        torch.from_numpy(part.astype(np.float32, order="C"))
        for part in np.split(numbers, [9, 11], axis=1)
    )
    return Lobes(axes.reshape(-1, 3, 3).clone(), sharpness.clone(), amplitude.clone(), form)
