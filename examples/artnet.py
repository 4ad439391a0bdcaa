# SPDX-License-Identifier: Apache-2.0
"""Lobes as DMX over Art-Net: eight RGB fixtures in a ring, each with the flux of its eighth.

Fixture 1 stands at +Z, the others follow over +X. GAIN is the level of a flux of 1.

asglight follow incoming/ | python examples/artnet.py 192.168.0.20:6454 GAIN
"""

import json
import math
import socket
import struct
import sys

FIXTURES, UNIVERSE = 8, 0

host, _, port = sys.argv[1].rpartition(":")
gain = float(sys.argv[2])
channel = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for line in sys.stdin:
    ring = [[0.0, 0.0, 0.0] for _ in range(FIXTURES)]
    for lobe in json.loads(line)["lobes"]:
        x, _, z = lobe["direction"]
        fixture = ring[round(math.atan2(x, z) / (2 * math.pi) * FIXTURES) % FIXTURES]
        fixture[:] = [level + part for level, part in zip(fixture, lobe["flux"], strict=True)]
    levels = bytes(min(255, round(255 * gain * level)) for rgb in ring for level in rgb)
    head = b"Art-Net\0" + struct.pack("<H", 0x5000) + struct.pack(">HBB", 14, 0, 0)
    head += struct.pack("<H", UNIVERSE) + struct.pack(">H", len(levels))
    channel.sendto(head + levels, (host, int(port)))
