# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks as a binary glTF 2.0 file of directional lights (docs/reference/export.md).

A lobe is a directional light of KHR_lights_punctual, a `bingham` lobe two of opposite directions.
Its node turns; its intensity and colour are animated by KHR_animation_pointer. glTF interpolates
linearly and axes by slerp, so there are samples between frames, by the rule of `lobes/motion.py`.

Dimension letters: T times, L lights.
"""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from asglight.errors import InputError
from asglight.images.output import written_beside
from asglight.lobes import Form, Lobes, LobeTracks, asg, frames, motion

STEPS = 4
"""Samples from each frame to the next, however far apart their numbers are. Light and its colour do
not change linearly. What that leaves falls as the square of the step: with four it is within 0.2 %
of all light on the lobes of tests/export/test_export_gltf.py."""

PUNCTUAL, POINTER = "KHR_lights_punctual", "KHR_animation_pointer"

FLOAT = 5126
"""Of an accessor's `componentType`; the only one here."""

HALF_TURN = torch.tensor([0.0, 0.0, 1.0, 0.0], dtype=torch.float64)
"""About y, (w, x, y, z): for the other side of a `bingham` lobe."""

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
"""Of the file and of its two chunks (glTF 2.0, section 4.4)."""

Array = NDArray[np.float32]


def write_gltf(path: str | Path, tracks: LobeTracks, names: Sequence[str]) -> None:
    """Write tracks as a .glb file.

    Args:
        path: The target; its folder must exist.
        tracks: N lobes in F frames.
        names: Of the N lobes.

    Raises:
        InputError: The file cannot be written there, or cannot hold the times.
    """
    numbers = np.array(tracks.frames, dtype=np.float64)
    parts = np.arange(numbers.size * STEPS - STEPS + 1) / STEPS
    times = np.interp(parts, np.arange(numbers.size), numbers)
    with np.errstate(over="ignore"):  # told of below
        seconds = ((times - times[0]) / tracks.fps).astype(np.float32)
    if not np.isfinite(seconds).all():
        raise InputError(
            f"fps: {tracks.fps:g}; expected a rate whose seconds a glTF can hold, such as 24."
        )
    if (np.diff(seconds) <= 0).any():  # glTF 2.0, section 3.11: strictly increasing
        raise InputError(
            f"frames: {tracks.frames[0]} to {tracks.frames[-1]} at {tracks.fps:g} fps; expected "
            "quarters of a frame that a glTF's float32 seconds tell apart. Export fewer frames."
        )
    lights = lights_of(motion.at(tracks, times.tolist()), names)
    document, data = _document(lights, seconds)
    with written_beside(Path(path)) as place:
        place.write_bytes(_binary(document, data))


class PunctualLight:
    """A directional light over time.

    Attributes:
        name: Of its lobe.
        rotation: Turns +Z to the light, (x, y, z, w).  [T, 4]
        intensity: Irradiance that a patch facing it receives, of its brightest channel: lux, where
            the images are in nits.  [T]
        color: Linear Rec.709, the brightest channel 1. Where the light is off, that of the sample
            beside it that is lit, for a reader mixes both; white, if none is.  [T, 3]
    """

    def __init__(self, name: str, rotation: torch.Tensor, irradiance: torch.Tensor) -> None:
        """Take what changes.

        Args:
            name: Of its lobe.
            rotation: (w, x, y, z).  [T, 4]
            irradiance: On a patch that faces it.  [T, 3]
        """
        peak = irradiance.amax(-1)
        shown = motion.light_of(peak <= 0)
        color = torch.where(peak[shown, None] > 0, irradiance[shown] / peak[shown, None], 1.0)
        self.name = name
        self.rotation: Array = rotation[:, [1, 2, 3, 0]].float().numpy()
        self.intensity: Array = peak.float().numpy()
        self.color: Array = color.float().numpy()


def lights_of(lobes: Lobes, names: Sequence[str]) -> list[PunctualLight]:
    """Return the directional lights of lobes.

    Args:
        lobes: In float64.  [T, N, .]
        names: Of the N lobes.
    """
    irradiance = asg.facing_irradiance(lobes)
    # how a light turns about its direction is not seen; if it does not, slerp goes straight
    axes = frames.transported(lobes.axes)
    turns = frames.continuous_quaternions(frames.quaternion_from_axes(axes))
    lights = []
    for index, name in enumerate(names):
        lights.append(PunctualLight(name, turns[:, index], irradiance[:, index]))
        if lobes.form is Form.BINGHAM:
            back = _product(turns[:, index], HALF_TURN)
            lights.append(PunctualLight(f"{name}_back", back, irradiance[:, index]))
    return lights


def _product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Return Hamilton's product of quaternions, (w, x, y, z).  [T, 4], [4]."""
    real = a[:, :1] * b[0] - (a[:, 1:] * b[1:]).sum(-1, keepdim=True)
    cross = torch.linalg.cross(a[:, 1:], b[1:].expand_as(a[:, 1:]))
    return torch.cat([real, a[:, :1] * b[1:] + b[0] * a[:, 1:] + cross], dim=-1)


def _document(lights: Sequence[PunctualLight], seconds: Array) -> tuple[dict[str, Any], bytes]:
    """Return the JSON of a file and its binary part."""
    buffer = _Buffer()
    time = buffer.put(seconds, bounds=True)
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []

    def animate(values: Array, target: dict[str, Any]) -> None:
        if (values != values[0]).any():
            channels.append({"sampler": len(samplers), "target": target})
            samplers.append({"input": time, "output": buffer.put(values)})

    for index, light in enumerate(lights):
        place = f"/extensions/{PUNCTUAL}/lights/{index}"
        animate(light.rotation, {"node": index + 1, "path": "rotation"})
        animate(light.intensity, _pointer(f"{place}/intensity"))
        animate(light.color, _pointer(f"{place}/color"))
    animations = [{"name": "asglight", "channels": channels, "samplers": samplers}]
    return {
        "asset": {"version": "2.0", "generator": "asglight"},
        "extensionsUsed": [PUNCTUAL, POINTER] if channels else [PUNCTUAL],
        "extensions": {PUNCTUAL: {"lights": [_light(light) for light in lights]}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "AsgRig", "children": list(range(1, len(lights) + 1))},
            *(_node(index, light) for index, light in enumerate(lights)),
        ],
        **({"animations": animations} if channels else {}),
        **buffer.document(),
    }, bytes(buffer.data)


def _light(light: PunctualLight) -> dict[str, Any]:
    return {
        "type": "directional",
        "name": light.name,
        "intensity": float(light.intensity[0]),
        "color": light.color[0].tolist(),
    }


def _node(index: int, light: PunctualLight) -> dict[str, Any]:
    return {
        "name": light.name,
        "rotation": light.rotation[0].tolist(),
        "extensions": {PUNCTUAL: {"light": index}},
    }


def _pointer(place: str) -> dict[str, Any]:
    return {"path": "pointer", "extensions": {POINTER: {"pointer": place}}}


class _Buffer:
    """Arrays of a file: a view and an accessor each."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def put(self, values: Array, *, bounds: bool = False) -> int:
        """Add an array, [T] or [T, K], and return its accessor; times have bounds."""
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[1 if values.ndim == 1 else values.shape[-1]]
        raw = np.ascontiguousarray(values, dtype="<f4").tobytes()
        self._views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)})
        self.data += raw
        accessor: dict[str, Any] = {
            "bufferView": len(self._views) - 1,
            "componentType": FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            accessor |= {"min": [float(values.min())], "max": [float(values.max())]}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def document(self) -> dict[str, Any]:
        """Return what the JSON says of them."""
        return {
            "buffers": [{"byteLength": len(self.data)}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }


def _binary(document: dict[str, Any], data: bytes) -> bytes:
    """Return a .glb file: a header and two chunks, each of a multiple of four bytes."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    chunks += struct.pack("<II", len(data), _BIN) + data
    return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks
