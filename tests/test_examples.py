# SPDX-License-Identifier: Apache-2.0
"""The scripts of examples/: what they send, decoded as the protocols' specifications have it."""

import json
import math
import socket
import struct
import subprocess
import sys

import pytest
from places import ROOT
from usd_tracks import moving

from asglight.export.frame_line import frame_line

EXAMPLES = ROOT / "examples"
SHOT = moving(range(1001, 1003))
LINES = [frame_line(SHOT.at(frame), SHOT.names, frame=frame) for frame in SHOT.frames]


@pytest.fixture
def listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as channel:
        channel.bind(("127.0.0.1", 0))
        channel.settimeout(10)
        yield channel


def run(script: str, listener: socket.socket, *words: str) -> None:
    address = f"127.0.0.1:{listener.getsockname()[1]}"
    subprocess.run(
        [sys.executable, str(EXAMPLES / script), address, *words],
        input="\n".join(LINES) + "\n",
        text=True,
        check=True,
    )


def osc_text(data: bytes) -> tuple[str, bytes]:
    """Take an OSC-string off (OSC 1.0: ends in 1 to 4 zeros, at a multiple of 32 bits)."""
    end = data.index(b"\0")
    return data[:end].decode(), data[(end // 4 + 1) * 4 :]


def test_osc_messages_hold_the_lobes_of_each_frame(listener: socket.socket) -> None:
    run("osc.py", listener)
    for line in LINES:
        for lobe in json.loads(line)["lobes"]:
            address, rest = osc_text(listener.recv(2048))
            tags, rest = osc_text(rest)
            assert (address, tags) == (f"/light/{lobe['name']}", ",fffffff")
            numbers = [*lobe["direction"], *lobe["flux"], lobe["width_deg"]]
            assert list(struct.unpack(">7f", rest)) == pytest.approx(numbers, rel=1e-6)


def test_art_net_packets_light_the_fixture_on_the_side_of_each_lobe(
    listener: socket.socket,
) -> None:
    run("artnet.py", listener, "0.05")
    for line in LINES:
        packet = listener.recv(2048)
        name, code, version, _, _, universe, length = struct.unpack("<8sH2sBBH2s", packet[:18])
        assert (name, code, universe) == (b"Art-Net\0", 0x5000, 0)  # ArtDmx, Art-Net 4
        assert (version, length) == (b"\0\x0e", b"\0\x18")  # high byte first
        levels = packet[18:]
        assert len(levels) == 24
        wanted = [0.0] * 24
        for lobe in json.loads(line)["lobes"]:
            x, _, z = lobe["direction"]
            eighth = math.floor((math.degrees(math.atan2(x, z)) + 22.5) / 45) % 8
            for channel in range(3):
                wanted[3 * eighth + channel] += lobe["flux"][channel]
        for level, flux in zip(levels, wanted, strict=True):
            assert level == pytest.approx(min(255.0, 255 * 0.05 * flux), abs=0.51)
        assert 0 < max(levels) < 255
