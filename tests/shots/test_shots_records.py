# SPDX-License-Identifier: Apache-2.0
import base64
import json
import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
import shot_files
import torch

from asglight.images import Repair
from asglight.lobes import Form
from asglight.shots.kept.records import (
    from_json,
    line_from,
    own_frames,
    parse_line,
    places_of,
    to_json,
)


def test_a_line_is_json_with_the_crc_of_its_record() -> None:
    line = line_from({"frame": 7, "text": "ß\n"})
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    parsed = json.loads(line)
    assert parsed["record"] == {"frame": 7, "text": "ß\n"}
    body = line[line.index(b":") + 1 : line.index(b',"crc32"')]
    assert int(parsed["crc32"], 16) == zlib.crc32(body)


def test_lobes_are_little_endian_floats_in_the_order_axes_sharpness_amplitude() -> None:
    record = shot_files.record(5)
    data = base64.b64decode(to_json(record)["lobes"])
    numbers = struct.unpack("<28f", data)
    second = record.lobes[1:]
    expected = [*second.axes.flatten(), *second.sharpness.flatten(), *second.amplitude.flatten()]
    assert numbers[14:] == tuple(float(value) for value in expected)


def test_a_frame_comes_back_to_the_bit() -> None:
    tiny = 1.401298464324817e-45  # the smallest float32
    record = shot_files.record(5)
    record.lobes.amplitude[0, 0] = tiny
    again = from_json(json.loads(json.dumps(to_json(record))))
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(again.lobes, name), getattr(record.lobes, name))
    assert (again.loss, again.flux_error) == (record.loss, record.flux_error)
    assert (again.repair, again.stamp) == (record.repair, record.stamp)
    assert again.repeats is None
    assert float(again.lobes.amplitude[0, 0]) == tiny


def test_a_repeated_frame_comes_back() -> None:
    record = shot_files.record(5, repeats=3)
    assert from_json(json.loads(json.dumps(to_json(record)))).repeats == 3


def test_frames_that_repeat_another_have_its_place() -> None:
    records = [
        shot_files.record(frame, repeats=repeats)
        for frame, repeats in ((1, None), (2, 1), (3, 1), (4, None), (5, None), (6, 5))
    ]
    assert [record.frame for record in own_frames(records)] == [1, 4, 5]
    assert places_of(records) == [0, 0, 0, 1, 2, 2]


def test_a_clean_repair_and_an_infinite_loss_come_back() -> None:
    record = shot_files.record(1, repair=Repair(), loss=math.inf)
    parsed = parse_line(line_from(to_json(record)))
    assert parsed is not None
    again = from_json(parsed)
    assert again.repair == Repair()
    assert again.loss == math.inf
    assert again.lobes.form is record.lobes.form


@pytest.mark.parametrize("form", list(Form))
def test_a_frame_names_its_form(form: Form) -> None:
    record = shot_files.record(2)
    record = replace(record, lobes=replace(record.lobes, form=form))
    assert from_json(to_json(record)).lobes.form is form


@pytest.mark.parametrize("position", [0, 12, 60, -20, -2, -1])
def test_a_changed_byte_is_seen_anywhere_in_a_line(position: int) -> None:
    line = bytearray(line_from(to_json(shot_files.record(1))))
    line[position] ^= 1
    assert parse_line(bytes(line)) is None


def test_a_line_cut_off_anywhere_is_no_record() -> None:
    line = line_from({"frame": 1})
    assert parse_line(line) == {"frame": 1}
    assert [parse_line(line[:end]) for end in range(len(line))] == [None] * len(line)


def test_a_record_that_is_no_object_is_refused() -> None:
    body = b"[1,2]"
    assert parse_line(b'{"record":%s,"crc32":"%08x"}\n' % (body, zlib.crc32(body))) is None


@pytest.mark.parametrize("body", [b"no json", b'{"a":', b"[" * 100_000, b'"\xff"', b"[1]", b"3"])
def test_a_line_whose_checksum_fits_and_whose_content_does_not_is_damaged(body: bytes) -> None:
    assert parse_line(b'{"record":%s,"crc32":"%08x"}\n' % (body, zlib.crc32(body))) is None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("frame", value) for value in (1.0, "1", None, True, 2**63)),
        *(("loss", value) for value in ("0", None, [], False)),
        *(("stamp", value) for value in ([1], [1, 2, 3], [1, 2.5], 7)),
        *(("repair", value) for value in ({}, 3, None)),
        *(("lobes", value) for value in ("", "AAAA", 3, "not base64!")),
        ("lobes", base64.b64encode(np.full(14, np.nan, "<f4").tobytes()).decode()),
        ("repeats", "1"),
    ],
)
def test_a_value_that_no_frame_has_is_a_fault_of_the_line(name: str, value: object) -> None:
    values = to_json(shot_files.record(1)) | {name: value}
    with pytest.raises((KeyError, TypeError, ValueError)):
        from_json(values)
