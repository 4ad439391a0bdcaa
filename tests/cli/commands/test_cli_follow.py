# SPDX-License-Identifier: Apache-2.0
"""`asglight follow`: a line of JSON a frame, from files and from raw frames; what it refuses."""

import json
import os
import re
import types
from pathlib import Path

import numpy as np
import pytest
import sky_files

import asglight
from asglight.cli.main import main
from asglight.export.frame_line import frame_line


def feed(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    reads, writes = os.pipe()
    os.write(writes, data)  # of some frames it holds all
    os.close(writes)
    monkeypatch.setattr("sys.stdin", types.SimpleNamespace(fileno=lambda: reads))


def without_times(line: str) -> dict:
    document = json.loads(line)
    assert 0 < document.pop("seconds") < 600
    return document


def expected(frames: dict[int, np.ndarray], lobes: int) -> list[dict]:
    follower = asglight.Follower(lobes)
    found = []
    for number, values in frames.items():
        followed = follower.follow(values)
        line = frame_line(followed, follower.names, frame=number, dropped=0, repair=None)
        found.append(json.loads(line))
    return found


@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_raw_frames_become_lines(
    kind: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = {n: sky_files.sky(n, 16).astype(kind) for n in (1, 2, 3)}
    little = np.dtype(kind).newbyteorder("<")
    feed(monkeypatch, b"".join(one.astype(little).tobytes() for one in frames.values()))
    line = ["follow", "-", "--size", "32x16", "--type", kind, "--every", "--lobes", "2"]
    assert main(line) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert [without_times(one) for one in out.splitlines()] == expected(frames, 2)


def test_images_become_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = sky_files.write_sequence(tmp_path / "in")
    line = ["follow", f"{folder}/sky.####.exr", "--every", "--lobes", "2", "--idle", "0.5"]
    assert main(line) == 0
    found = [without_times(one) for one in capsys.readouterr().out.splitlines()]
    assert found == expected({n: sky_files.sky(n) for n in range(1001, 1005)}, 2)


def test_what_was_repaired_is_in_the_line_and_a_lost_frame_is_passed_over(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = np.stack([sky_files.sky(n, 16) for n in (1, 2, 3)])
    frames[0, 3, 3] = np.nan
    frames[1] = np.nan
    feed(monkeypatch, frames.tobytes())
    assert main(["follow", "-", "--size", "32x16", "--every", "--lobes", "2"]) == 0
    out, err = capsys.readouterr()
    first, third = map(without_times, out.splitlines())
    assert (first["frame"], first["repair"]) == (1, "1 NaN texel set to 0")
    assert (third["frame"], third["repair"]) == (3, None)
    assert err == (
        "asglight: frame 2: passed over: holds nothing but NaN; expected light. Render it again.\n"
    )


def test_a_stream_that_ends_within_a_frame_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    feed(monkeypatch, sky_files.sky(1, 16).tobytes()[:-4])
    assert main(["follow", "-", "--size", "32x16"]) == 2
    assert "standard input: ends 6,140 bytes into frame 1" in capsys.readouterr().err


FAULTS = [
    ("-", "size: none of the raw frames; expected one. Add --size, such as 512x256"),
    ("- --size 32x32", "size: 32x32; expected twice as many columns as rows"),
    ("- --size 32", "--size: '32'; expected columns and rows such as 512x256"),
    ("- --size 32x16 --type int8", "--type: invalid choice: 'int8'"),
    ("- --size 32x16 --idle 3", "--idle: given with raw frames; expected it with images only"),
    ("- --size 32x16 --layer a", "--layer: given with raw frames; expected it with images only"),
    ("in --size 32x16", "--size: given with images; expected it with raw frames only"),
    ("in --type float16", "--type: given with images; expected it with raw frames only"),
    ("in --idle 0", "idle: 0; expected a number of seconds above 0"),
    ("in --repair 2", "repair: 2; expected a share from 0 to 1"),
    ("in --lobes 0 --idle 1", "lobes: 0"),
    ("in --idle 0.1", "in: no image came; expected some. Is it the folder that is written?"),
    ("none/sky.####.exr --idle 1", "none/sky.####.exr: there is no folder none"),
    ("none", "none: is not there; expected the folder that is written, or a pattern such as"),
]


@pytest.mark.parametrize(("words", "message"), FAULTS, ids=[one for one, _ in FAULTS])
def test_a_fault_is_one_line(
    words: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in").mkdir()
    feed(monkeypatch, b"")
    assert main(["follow", *words.split()]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.search(re.escape(message), err)
