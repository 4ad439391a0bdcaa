# SPDX-License-Identifier: Apache-2.0
"""Layers of edited keys, over the stage that was edited."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from bench_scripts import module
from keyed_stages import FRAMES, ROWS, images, write
from pxr import Sdf, Usd

from asglight.errors import InputError
from asglight.lobes import LobeTracks, asg
from asglight.sphere import latlong
from asglight.usd import lint_stage, read_keys, write_key_edits
from asglight.usd.options import KeyLights

judge = module("keyed.seen")

# a quarter turn about +Y and half a turn about +X make (x, y, z) (-z, -y, -x)
TURN = torch.tensor([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])


def edited(tracks: LobeTracks) -> LobeTracks:
    """Turn the key, halve it and make it warmer."""
    lobes = tracks.lobes
    axes, amplitude = lobes.axes @ TURN, lobes.amplitude * torch.tensor([0.5, 0.4, 0.25])
    return replace(tracks, lobes=replace(lobes, axes=axes, amplitude=amplitude))


def read(path: Path) -> LobeTracks:
    keys = read_keys(path)
    assert keys is not None
    assert keys.tracks is not None
    assert keys.changes == ()
    return keys.tracks


def keyed(folder: Path, **options) -> Path:
    images(folder, FRAMES[:2])
    write(folder, frames=FRAMES[:2], **options)
    return folder / "shot.usda"


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"lights": KeyLights.DISTANT},
        {"up_axis": "Z", "meters_per_unit": 0.01, "colorspace": "ACEScg"},
        {"representations": ("cards", "keys")},
    ],
)
def test_edited_keys_come_back_from_their_layer(tmp_path: Path, options: dict) -> None:
    stage = keyed(tmp_path, **options)
    before = stage.read_bytes()
    wanted = edited(read(stage))
    write_key_edits(tmp_path / "edits.usda", stage, wanted, [0])
    found = read(tmp_path / "edits.usda")
    assert found.names == wanted.names
    torch.testing.assert_close(found.lobes.axes, wanted.lobes.axes, rtol=0, atol=2e-6)
    torch.testing.assert_close(found.lobes.sharpness, wanted.lobes.sharpness, rtol=1e-5, atol=0)
    flux, of_wanted = asg.flux(found.lobes), asg.flux(wanted.lobes)
    torch.testing.assert_close(flux, of_wanted, rtol=1e-4, atol=1e-7)
    assert lint_stage(tmp_path / "edits.usda") == []
    assert stage.read_bytes() == before


def test_what_the_layer_changes_of_the_light_is_the_edit_and_nothing_else(tmp_path: Path) -> None:
    stage = keyed(tmp_path)
    write_key_edits(tmp_path / "edits.usda", stage, edited(read(stage)), [0])
    frame = FRAMES[0]
    old, new = (
        judge.seen(Usd.Stage.Open(str(path)), frame, ROWS, 2 * ROWS)
        for path in (stage, tmp_path / "edits.usda")
    )
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64).numpy()[..., None]
    [light] = judge.lights(Usd.Stage.Open(str(stage)), frame)
    key = np.zeros((ROWS, 2 * ROWS, 3))
    judge.add(key, light)
    # what the key gave is gone from its place, and is shown dimmer elsewhere
    place = key.sum(-1) > 0
    assert (new - old)[place].max() <= 1e-6 * old.max()
    change = ((new - old) * weight).sum((0, 1)) / (key * weight).sum((0, 1))
    np.testing.assert_allclose(change, [-0.5, -0.6, -0.75], rtol=0.02)  # of rays that meet edges
    said: list[Sdf.Path] = []
    Sdf.Layer.FindOrOpen(str(tmp_path / "edits.usda")).Traverse("/", said.append)
    prims = {str(path) for path in said if path.IsPrimPath()}
    assert prims == {"/AsgRig", "/AsgRig/Keys", str(read_path(stage))}


def read_path(stage: Path) -> Sdf.Path:
    opened = Usd.Stage.Open(str(stage))
    [prim] = opened.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    return prim.GetPath()


def test_a_layer_lies_over_a_layer(tmp_path: Path) -> None:
    stage = keyed(tmp_path)
    once = edited(read(stage))
    write_key_edits(tmp_path / "a.usda", stage, once, [0])
    twice = edited(read(tmp_path / "a.usda"))
    write_key_edits(tmp_path / "b.usda", tmp_path / "a.usda", twice, [0])
    found = read(tmp_path / "b.usda")
    torch.testing.assert_close(found.lobes.amplitude, twice.lobes.amplitude, rtol=1e-4, atol=1e-7)


def test_keys_of_another_stage_and_files_of_the_stage_are_refused(tmp_path: Path) -> None:
    stage = keyed(tmp_path)
    tracks = read(stage)
    other = replace(tracks, names=("key_77",))
    with pytest.raises(InputError, match=r"does not hold the keys that were edited"):
        write_key_edits(tmp_path / "edits.usda", stage, other, [0])
    with pytest.raises(InputError, match=r"does not hold the keys"):
        write_key_edits(tmp_path / "edits.usda", stage, edited(tracks), [])
    with pytest.raises(InputError, match=r"would replace files of .*shot.usda"):
        write_key_edits(stage, stage, edited(tracks), [0])
    assert not (tmp_path / "edits.usda").exists()
