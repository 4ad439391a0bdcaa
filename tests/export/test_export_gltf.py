# SPDX-License-Identifier: Apache-2.0
"""The glTF file, read by the letter of glTF 2.0: where its lights are, how bright, and when."""

import json
import os
import struct
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from places import ROOT, SUPPORT
from scipy.spatial.transform import Rotation, Slerp
from usd_tracks import moving

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.export import write_gltf
from asglight.lobes import Form, LobeTracks, asg, motion
from asglight.sphere import latlong
from asglight.usd import write_usd

FRAMES = range(1001, 1006)
BETWEEN = 2e-3
"""Of all light: what linear interpolation of four samples a frame may be off; it is 1.1e-3. One
sample a frame would be sixteen times as far off."""


class Read:
    """A .glb file."""

    def __init__(self, path: Path) -> None:
        raw = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", raw)
        assert (magic, version, length) == (b"glTF", 2, len(raw))
        size, kind = struct.unpack_from("<I4s", raw, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.document: dict[str, Any] = json.loads(raw[20 : 20 + size])
        rest, kind = struct.unpack_from("<I4s", raw, 20 + size)
        assert kind == b"BIN\0"
        assert rest % 4 == 0
        self._data = raw[28 + size :]
        assert len(self._data) == rest
        self.lights = self.document["extensions"]["KHR_lights_punctual"]["lights"]

    def accessor(self, index: int) -> np.ndarray:
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert accessor["componentType"] == 5126  # float
        values = np.frombuffer(self._data, "<f4", accessor["count"] * width, view["byteOffset"])
        assert view["byteLength"] == values.nbytes
        return values.reshape(-1, width)

    def at(self, seconds: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return where each light comes from, and its intensity times colour."""
        found = []
        for node in self.document["nodes"][1:]:
            index = node["extensions"]["KHR_lights_punctual"]["light"]
            light = self.lights[index]
            assert light["type"] == "directional"
            place = f"/extensions/KHR_lights_punctual/lights/{index}"
            number = self.document["nodes"].index(node)
            turn = self._animated(seconds, lambda target, n=number: target.get("node") == n)
            intensity = self._animated(seconds, _points_at(f"{place}/intensity"))
            color = self._animated(seconds, _points_at(f"{place}/color"))
            rotation = Rotation.from_quat(node["rotation"]) if turn is None else turn
            value = light["intensity"] if intensity is None else intensity
            found.append(
                (
                    rotation.apply([0, 0, 1]),  # it shines along the node's -Z
                    value * np.array(light["color"] if color is None else color),
                )
            )
        return found

    def _animated(self, seconds: float, is_meant: Callable[[dict[str, Any]], bool]) -> Any:
        for animation in self.document.get("animations", []):
            for channel in animation["channels"]:
                if is_meant(channel["target"]):
                    sampler = animation["samplers"][channel["sampler"]]
                    times = self.accessor(sampler["input"])[:, 0].astype(float)
                    values = self.accessor(sampler["output"]).astype(float)
                    if channel["target"]["path"] == "rotation":
                        return Slerp(times, Rotation.from_quat(values))(seconds)
                    return np.array([np.interp(seconds, times, one) for one in values.T])
        return None


def _points_at(place: str) -> Callable[[dict[str, Any]], bool]:
    def is_meant(target: dict[str, Any]) -> bool:
        pointer = target.get("extensions", {}).get("KHR_animation_pointer", {}).get("pointer")
        return target["path"] == "pointer" and pointer == place

    return is_meant


def written(folder: Path, tracks: LobeTracks) -> Read:
    path = folder / "lights.glb"
    write_gltf(path, tracks, tracks.names)
    return Read(path)


@pytest.mark.parametrize("form", Form)
def test_a_light_gives_a_patch_that_faces_it_what_its_lobe_does(form: Form, tmp_path: Path) -> None:
    tracks = moving(FRAMES, 3, form)
    tracks.lobes.sharpness.clamp_(max=200)  # broad beside a texel
    read = written(tmp_path, tracks)
    sides = 2 if form is Form.BINGHAM else 1
    directions = latlong.directions(256, 512, dtype=torch.float64).flatten(0, 1)
    weights = latlong.texel_solid_angles(256, 512, dtype=torch.float64).flatten()
    for place, frame in enumerate(FRAMES):
        found = read.at((frame - FRAMES[0]) / tracks.fps)
        assert len(found) == 3 * sides
        for index in range(3):
            lobe = tracks.lobes[place][index : index + 1].to(torch.float64)
            radiance = asg.evaluate(lobe, directions)  # [P, 3]
            for side in range(sides):
                towards, light = found[sides * index + side]
                axis = (-1) ** side * lobe.axes[0, 2].numpy()
                np.testing.assert_allclose(towards, axis, atol=1e-6)
                cosine = (directions @ torch.from_numpy(axis)).clamp(min=0)
                wanted = (radiance * (cosine * weights)[:, None]).sum(0)
                # by texels of 0.7 degrees
                np.testing.assert_allclose(light, wanted, rtol=2e-3)


def test_light_between_frames_is_that_of_the_tracks(tmp_path: Path) -> None:
    tracks = moving(FRAMES, 5)
    read = written(tmp_path, tracks)
    for time in np.arange(FRAMES[0], FRAMES[-1], 0.125):
        lobes = motion.at(tracks, [float(time)])[0]
        wanted = asg.facing_irradiance(lobes).numpy()
        found = read.at((time - FRAMES[0]) / tracks.fps)
        off = [np.abs(light - one).max() for (_, light), one in zip(found, wanted, strict=True)]
        assert sum(off) < BETWEEN * wanted.max(-1).sum()
        for (towards, _), axis in zip(found, lobes.axes[:, 2].numpy(), strict=True):
            np.testing.assert_allclose(towards, axis, atol=2e-6)


def test_a_gap_has_as_many_samples_as_a_frame(tmp_path: Path) -> None:
    tracks = moving([-7, -6, 90_000], 3)
    read = written(tmp_path, tracks)
    assert read.document["accessors"][0]["count"] == 9
    for time in [-7, -6.5, -6, 30_000, 45_001, 90_000]:
        lobes = motion.at(tracks, [float(time)])[0]
        wanted = asg.facing_irradiance(lobes).numpy()
        found = read.at(min((time + 7) / tracks.fps, read.document["accessors"][0]["max"][0]))
        off = [np.abs(light - one).max() for (_, light), one in zip(found, wanted, strict=True)]
        assert sum(off) < BETWEEN * wanted.max(-1).sum()
        for (towards, _), axis in zip(found, lobes.axes[:, 2].numpy(), strict=True):
            np.testing.assert_allclose(towards, axis, atol=1e-5)


@pytest.mark.parametrize(("last", "fps"), [(10_000_000, 24.0), (1, 1e45)])
def test_times_that_no_file_can_tell_apart_are_refused(
    last: int, fps: float, tmp_path: Path
) -> None:
    tracks = replace(moving([0, last, last + 1]), fps=fps)
    with pytest.raises(InputError, match=r"frames: 0 to \d+ at .* fps; expected quarters of a"):
        write_gltf(tmp_path / "far.glb", tracks, tracks.names)
    assert list(tmp_path.iterdir()) == []


def test_a_lamp_that_comes_and_goes_keeps_its_colour(tmp_path: Path) -> None:
    tracks = moving(range(1, 7), 1)
    tracks.lobes.amplitude[:, 0] = torch.tensor([4.0, 1.0, 0.0])
    tracks.lobes.amplitude[[0, 1, 3, 4], 0] = 0
    read = written(tmp_path, tracks)
    for time in np.arange(1, 6, 0.125):
        _, light = read.at((time - 1) / tracks.fps)[0]
        np.testing.assert_allclose(light, light[0] * np.array([1, 0.25, 0]), atol=1e-6)


def test_a_still_has_no_animation_and_a_dark_lobe_is_white_and_off(tmp_path: Path) -> None:
    tracks = moving(FRAMES, 2)
    lobes = tracks.lobes[:1]
    lobes.amplitude[0, 1] = 0
    read = written(tmp_path, replace(tracks, frames=(1001,), lobes=lobes))
    assert "animations" not in read.document
    assert read.document["extensionsUsed"] == ["KHR_lights_punctual"]
    assert (read.lights[1]["intensity"], read.lights[1]["color"]) == (0, [1, 1, 1])
    assert [node["name"] for node in read.document["nodes"]] == ["AsgRig", *tracks.names]


def test_times_have_bounds_and_start_at_nought(tmp_path: Path) -> None:
    read = written(tmp_path, moving(FRAMES, 2))
    accessor = read.document["accessors"][0]
    assert (accessor["min"], accessor["max"]) == ([0], [pytest.approx(4 / 24)])
    assert read.document["extensionsUsed"] == ["KHR_lights_punctual", "KHR_animation_pointer"]


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage, target = tmp_path / "shot.usda", tmp_path / "lights.glb"
    write_usd(moving(FRAMES, 3), stage)
    assert main(["export", str(stage), "--to", "gltf", "-o", str(target)]) == 0
    assert "lights.glb: 3 lobes of form asg, 5 frames (1001-1005)" in capsys.readouterr().out
    assert len(Read(target).lights) == 3
    assert main(["export", str(stage), "--to", "gltf", "-o", str(tmp_path / "lights.gltf")]) == 2
    assert "expected a name that ends in .glb, such as lights.glb" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.blender
def test_blender_reads_direction_intensity_and_colour_over_time(tmp_path: Path) -> None:
    python = ROOT / ".venv-dcc" / "bin" / "python"
    if not python.is_file():
        pytest.skip("no Blender: make setup-dcc")
    tracks = moving(FRAMES, 4)
    write_gltf(tmp_path / "lights.glb", tracks, tracks.names)
    times = [1001, 1002.5, 1003, 1005]
    line = [python, SUPPORT / "blender_gltf.py", tmp_path / "lights.glb", tmp_path / "found.json"]
    line += [str(time - FRAMES[0]) for time in times]
    done = subprocess.run(list(map(str, line)), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found.json").read_text())
    for time, lights in zip(times, found, strict=True):
        lobes = motion.at(tracks, [time])[0]
        wanted = asg.facing_irradiance(lobes).numpy()
        for index, name in enumerate(tracks.names):
            x, y, z = lobes.axes[index, 2].tolist()
            np.testing.assert_allclose(lights[name]["towards"], [x, -z, y], atol=1e-5)
            np.testing.assert_allclose(lights[name]["light"], wanted[index], rtol=2e-3)


def test_a_rate_whose_seconds_no_file_can_hold_is_refused(tmp_path: Path) -> None:
    tracks = replace(moving([1, 2]), fps=1e-300)
    with pytest.raises(InputError, match="fps: 1e-300; expected a rate whose seconds"):
        write_gltf(tmp_path / "slow.glb", tracks, tracks.names)
    assert list(tmp_path.iterdir()) == []


def test_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    pipe, tracks = tmp_path / "pipe.glb", moving([1])
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"pipe\.glb: is a pipe or a device; expected a file"):
        write_gltf(pipe, tracks, tracks.names)
    assert pipe.is_fifo()
    stage = tmp_path / "pipe.usda"
    os.mkfifo(stage)
    with pytest.raises(InputError, match=r"pipe\.usda: is a pipe or a device; expected a file"):
        write_usd(tracks, stage)
    assert stage.is_fifo()
