# SPDX-License-Identifier: Apache-2.0
"""Lobes as OSC messages over UDP, `/light/lobe_00` with direction, flux and width in degrees.

asglight follow incoming/ | python examples/osc.py 192.168.0.9:9000
"""

import json
import socket
import struct
import sys


def padded(text: str) -> bytes:
    """Return an OSC string: ended by a zero, filled up to a multiple of four bytes."""
    data = text.encode() + b"\0"
    return data + b"\0" * (-len(data) % 4)


host, _, port = sys.argv[1].rpartition(":")
channel = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for line in sys.stdin:
    for lobe in json.loads(line)["lobes"]:
        numbers = [*lobe["direction"], *lobe["flux"], lobe["width_deg"]]
        head = padded(f"/light/{lobe['name']}") + padded("," + "f" * len(numbers))
        channel.sendto(head + struct.pack(f">{len(numbers)}f", *numbers), (host, int(port)))
