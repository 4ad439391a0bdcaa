# SPDX-License-Identifier: Apache-2.0
"""The JSON track file: what is in it, that it comes back, and that damage is named in one line."""

import contextlib
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usd_tracks import moving, still

from asglight.errors import InputError
from asglight.export import read_json, track_file, write_json
from asglight.lobes import Form, Lobes, LobeTracks, asg

NAMES = ["lobe_00", "lobe_01", "lobe_02"]


def written(folder: Path, tracks: LobeTracks) -> Path:
    path = folder / "shot.json"
    write_json(path, tracks, NAMES[: tracks.lobes.count])
    return path


@pytest.fixture
def document(tmp_path: Path) -> dict[str, Any]:
    return json.loads(written(tmp_path, moving([1001, 1002, 1004])).read_text())


def test_file_says_what_it_holds(document: dict[str, Any]) -> None:
    assert document["format"] == "asglight lobes"
    assert document["version"] == 1
    assert document["form"] == "asg"
    assert document["fps"] == 24.0
    assert document["frames"] == [1001, 1002, 1004]
    assert "+Y up" in document["convention"]
    assert "max(z, 0) exp(-sx x^2 - sy y^2)" in document["convention"]
    assert [lobe["name"] for lobe in document["lobes"]] == NAMES


@pytest.mark.parametrize("form", list(Form))
def test_file_alone_gives_the_radiance(tmp_path: Path, form: Form) -> None:
    tracks = moving([1, 2, 3], form=form)
    document = json.loads(written(tmp_path, tracks).read_text())
    directions = Rotation.random(50, rng=np.random.default_rng(3)).as_matrix()[:, 2]
    expected = asg.evaluate(tracks.lobes.to(torch.float64), torch.from_numpy(directions)).numpy()
    for index in range(3):
        radiance = np.zeros((50, 3))
        for lobe in document["lobes"]:
            w, *xyz = lobe["quaternion"][index]
            x, y, z = Rotation.from_quat([*xyz, w]).inv().apply(directions).T
            sx, sy = lobe["sharpness"][index]
            value = {
                Form.ASG: np.maximum(z, 0) * np.exp(-sx * x**2 - sy * y**2),
                Form.BINGHAM: np.exp(-sx * x**2 - sy * y**2),
                Form.SG: np.exp(sx * (z - 1)),
                Form.FLAT: np.maximum(z, 0) * (1 - (1 - np.exp(-sx * x**2 - sy * y**2)) ** 3),
            }[form]
            radiance += value[:, None] * lobe["amplitude"][index]
        # A float32 quaternion is off by 1e-7 radians; at the largest slope, sharpness 130, 1e-5.
        np.testing.assert_allclose(radiance, expected[index], atol=3e-5 * expected.max())


@pytest.mark.parametrize("form", list(Form))
def test_tracks_come_back(tmp_path: Path, form: Form) -> None:
    tracks = moving([1001, 1002, 1004], form=form)
    found = read_json(written(tmp_path, tracks))
    assert found.frames == tracks.frames
    assert found.fps == tracks.fps
    assert found.lobes.form is form
    assert torch.equal(found.lobes.sharpness, tracks.lobes.sharpness)
    assert torch.equal(found.lobes.amplitude, tracks.lobes.amplitude)
    # Four rounded numbers stand for nine: a few roundings of float32.
    assert (found.lobes.axes - tracks.lobes.axes).abs().max() < 5e-7


def test_numbers_are_float32_in_the_fewest_digits(tmp_path: Path) -> None:
    lobes = replace(still([(5.0, 2.0)]).lobes, sharpness=torch.tensor([[[0.1, 1e7 / 3]]]))
    path = written(tmp_path, LobeTracks((1,), 23.976, lobes))
    assert '"sharpness":[0.1,3333333.2]' in path.read_text()


def test_what_does_not_change_is_written_once(tmp_path: Path) -> None:
    tracks = moving(range(1, 41))
    resting = replace(
        tracks.lobes,
        sharpness=tracks.lobes.sharpness[:1].expand(40, -1, -1),
        axes=torch.cat(
            [tracks.lobes.axes[:1, :1].expand(40, -1, -1, -1), tracks.lobes.axes[:, 1:]], 1
        ),
    )
    path = written(tmp_path, replace(tracks, lobes=resting))
    first, second, _ = json.loads(path.read_text())["lobes"]
    assert len(first["quaternion"]) == 4
    assert len(second["quaternion"]) == 40
    assert len(second["sharpness"]) == 2
    assert len(first["amplitude"]) == 40
    assert torch.equal(read_json(path).lobes.sharpness, resting.sharpness)


def test_quaternions_change_by_little_from_frame_to_frame(tmp_path: Path) -> None:
    lobes = json.loads(written(tmp_path, moving(range(1, 201))).read_text())["lobes"]
    for lobe in lobes:
        steps = np.diff(lobe["quaternion"], axis=0)
        assert np.linalg.norm(steps, axis=1).max() < 0.1  # at most 5.2 radians over 199 steps


def test_too_many_samples_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(GOOD | {"lobes": [LOBE] * 5}))
    monkeypatch.setattr(track_file, "SAMPLES_MAX", 8)
    with pytest.raises(InputError, match="3 lobes in 3 frames; expected at most 8 together"):
        written(tmp_path, moving([1, 2, 3]))
    assert list(tmp_path.iterdir()) == [path]  # nothing was written
    assert "5 lobes in 2 frames; expected at most 8 together" in refused(path)


LOBE = {"quaternion": [1, 0, 0, 0], "sharpness": [5, 2.5], "amplitude": [0, 1, 2]}
GOOD = {
    "format": "asglight lobes",
    "version": 1,
    "form": "asg",
    "fps": 24,
    "frames": [1, 2],
    "lobes": [LOBE],
}
DAMAGE = [
    ({"format": "other"}, 'is no lobe track file; expected "format"'),
    ({"version": 2}, "version 2; expected a number up to 1"),
    ({"version": True}, "version True"),
    ({"form": "cube"}, "form 'cube'; expected one of asg, bingham, sg, flat"),
    ({"form": {"a": 1}}, "form {'a': 1}"),
    ({"fps": 0}, "fps 0; expected a number above 0"),
    ({"fps": "24"}, "fps '24'"),
    ({"fps": float("nan")}, "fps nan"),
    ({"fps": 10**400}, "fps 1000"),
    ({"frames": []}, "frames are damaged; expected ascending whole numbers"),
    ({"frames": [2, 1]}, "frames are damaged"),
    ({"frames": [1, 2.5]}, "frames are damaged"),
    ({"frames": [1, 2**40]}, "frames are damaged"),
    ({"lobes": []}, "lobes are damaged; expected a list of objects"),
    ({"lobes": [1]}, "lobes are damaged"),
]
LOBE_DAMAGE = [
    ("quaternion", None),
    ("quaternion", [1, 0, 0]),
    ("quaternion", [0.9, 0, 0, 0]),
    ("quaternion", [[1, 0, 0, 0]]),
    ("quaternion", [[1, 0, 0, 0], [1, 0, 0, "0"]]),
    ("quaternion", [[1, 0, 0, 0], 1]),
    ("sharpness", []),
    ("sharpness", [5, 0]),
    ("sharpness", [5, 1e-60]),  # 0 as float32
    ("sharpness", [5, float("inf")]),
    ("sharpness", [5, True]),
    ("amplitude", [0, 1, -1]),
    ("amplitude", [0, 1, float("nan")]),
    ("amplitude", [0, 1, 1e39]),  # infinite as float32
    ("amplitude", [0, 1, 10**400]),
]


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_json(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    assert len(message) < 300
    return message


def test_the_least_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(GOOD))
    assert read_json(path).lobes.amplitude.tolist() == [[[0, 1, 2]], [[0, 1, 2]]]


@pytest.mark.parametrize(("change", "message"), DAMAGE, ids=[text[:30] for _, text in DAMAGE])
def test_damage_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(GOOD | change))
    assert message in refused(path)


@pytest.mark.parametrize(("key", "value"), LOBE_DAMAGE)
def test_damage_of_a_lobe_is_named(tmp_path: Path, key: str, value: Any) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(GOOD | {"lobes": [LOBE, LOBE | {key: value}]}))
    assert f"{key} of lobe 1 is damaged; expected" in refused(path)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"[1]", b"null", b"9" * 5000]
)
def test_what_is_no_object_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(content)
    assert "is no whole JSON object; expected a lobe track file" in refused(path)


def test_no_file_a_folder_and_a_huge_file_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "cannot be read (No such file or directory)" in refused(tmp_path / "none.json")
    assert "cannot be read (Is a directory)" in refused(tmp_path)
    os.mkfifo(tmp_path / "pipe.json")  # reading it would wait for ever
    assert "is a pipe or a device; expected a lobe track file" in refused(tmp_path / "pipe.json")
    path = written(tmp_path, moving([1, 2]))
    monkeypatch.setattr(track_file, "BYTES_MAX", 100)
    assert "bytes; expected at most 100" in refused(path)


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@pytest.mark.thorough
@given(
    key=st.sampled_from(sorted(GOOD)),
    lobe_key=st.sampled_from([None, *sorted(LOBE)]),
    value=JSON_VALUES,
    cut=st.integers(0, 40),
)
@settings(max_examples=tries(100), deadline=None)  # a slow machine is no failure
def test_any_damage_is_refused_or_gives_sound_lobes(
    tmp_path_factory: pytest.TempPathFactory,
    key: str,
    lobe_key: str | None,
    value: Any,
    cut: int,
) -> None:
    changed = {key: value} if lobe_key is None else {"lobes": [LOBE | {lobe_key: value}]}
    text = json.dumps(GOOD | changed)
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(text[: len(text) - cut] if cut > 20 else text)
    with contextlib.suppress(InputError):
        assert_sound(read_json(path).lobes)


def assert_sound(lobes: Lobes) -> None:
    assert bool(torch.isfinite(lobes.axes).all() & torch.isfinite(lobes.amplitude).all())
    assert bool((lobes.sharpness > 0).all() & (lobes.amplitude >= 0).all())
