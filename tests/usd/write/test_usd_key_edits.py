# SPDX-License-Identifier: Apache-2.0
"""Layers of edited keys, over the stage that was edited."""

import subprocess
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
from asglight.lobes.data import Lobes
from asglight.sphere import latlong
from asglight.usd import lint_stage, read_keys, read_usd, write_key_edits, write_usd
from asglight.usd.options import KeyLights
from asglight.usd.write.kept_keys import KeptKeys
from dcc import renderers

judge = module("keyed.seen")

# a quarter turn about +Y and half a turn about +X make (x, y, z) (-z, -y, -x)
TURN = torch.tensor([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])

SPACES = [
    {},
    {"lights": KeyLights.DISTANT, "representations": ("cards", "keys")},
    {
        "up_axis": "Z",
        "meters_per_unit": 0.01,
        "colorspace": "ACEScg",
        "representations": ("keys", "cards"),
        "texture": True,
    },
]


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


@pytest.mark.parametrize("options", SPACES)
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


@pytest.mark.parametrize("options", SPACES[:2], ids=["cards", "distant"])
def test_what_was_the_width_of_a_key_remains_it_however_wide_it_becomes(
    tmp_path: Path, options: dict
) -> None:
    stage = keyed(tmp_path, **options)
    tracks = read(stage)
    lobes = replace(tracks.lobes, sharpness=tracks.lobes.sharpness.flip(-1))
    write_key_edits(tmp_path / "edits.usda", stage, replace(tracks, lobes=lobes), [0])
    found = read(tmp_path / "edits.usda").lobes
    torch.testing.assert_close(found.axes, lobes.axes, rtol=0, atol=2e-6)
    torch.testing.assert_close(found.sharpness, lobes.sharpness, rtol=1e-5, atol=0)


def with_one_more(tracks: LobeTracks, name: str) -> LobeTracks:
    """Add a blue square key at +X, 20 degrees wide or so, with an up axis of +Y."""
    count = len(tracks.frames)
    axes = torch.tensor([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]).expand(count, 1, 3, 3)
    sharpness = torch.full((count, 1, 2), 40.0)
    amplitude = torch.tensor([0.5, 1.0, 4.0]).expand(count, 1, 3)
    old = tracks.lobes
    lobes = Lobes(
        torch.cat([old.axes, axes], 1),
        torch.cat([old.sharpness, sharpness], 1),
        torch.cat([old.amplitude, amplitude], 1),
    )
    return replace(tracks, lobes=lobes, names=(*tracks.names, name))


@pytest.mark.parametrize("options", SPACES)
def test_a_key_that_is_added_is_a_light_as_those_that_were_cut(
    tmp_path: Path, options: dict
) -> None:
    stage = keyed(tmp_path, **options)
    before = stage.read_bytes()
    wanted = with_one_more(read(stage), "key_07")
    wanted = replace(wanted, display_names={"key_07": "The bounce, blue"})
    write_key_edits(tmp_path / "edits.usda", stage, wanted, [1], muted=())
    found = read(tmp_path / "edits.usda")
    assert found.names == wanted.names
    assert found.display_names == wanted.display_names
    torch.testing.assert_close(found.lobes.axes, wanted.lobes.axes, rtol=0, atol=2e-6)
    torch.testing.assert_close(asg.flux(found.lobes), asg.flux(wanted.lobes), rtol=1e-4, atol=1e-7)
    assert lint_stage(tmp_path / "edits.usda") == []
    assert stage.read_bytes() == before


def test_a_key_that_is_added_gives_its_light_from_its_place(tmp_path: Path) -> None:
    stage = keyed(tmp_path)
    wanted = with_one_more(read(stage), "key_07")
    write_key_edits(tmp_path / "edits.usda", stage, wanted, [1], muted=())
    old, new = (
        judge.seen(Usd.Stage.Open(str(path)), FRAMES[1], ROWS, 2 * ROWS)
        for path in (stage, tmp_path / "edits.usda")
    )
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64).numpy()
    more = (new - old) * weight[..., None]
    flux = asg.flux(wanted.lobes.to(torch.float64))[1, 1].numpy()
    np.testing.assert_allclose(more.sum((0, 1)), flux, rtol=0.02)  # of rays that meet edges
    seen = latlong.directions(ROWS, 2 * ROWS).numpy()
    middle = (more.sum(-1)[..., None] * seen).sum((0, 1))
    np.testing.assert_allclose(middle / np.linalg.norm(middle), [1, 0, 0], atol=0.01)


@pytest.mark.parametrize("options", SPACES)
def test_a_muted_key_keeps_its_light_and_a_deleted_one_leaves_its_hole(
    tmp_path: Path, options: dict
) -> None:
    stage = keyed(tmp_path, **options)
    held = with_one_more(read(stage), "key_07")
    added, muted, gone = (tmp_path / f"{name}.usda" for name in ("added", "muted", "gone"))
    write_key_edits(added, stage, held, [1], muted=())
    held = read(added)
    write_key_edits(muted, added, held, [0], muted=[0])
    keys = read_keys(muted)
    assert keys is not None
    assert keys.tracks is not None
    assert keys.unmuted is not None
    assert keys.muted == {0}
    assert not keys.tracks.lobes.amplitude[:, 0].any()
    assert torch.equal(keys.unmuted.lobes.amplitude, held.lobes.amplitude)
    [said] = keys.changes
    assert said == f"/AsgRig/Keys/{held.names[0]}: invisible"
    assert "inputs:intensity" not in muted.read_text()  # the light is as it was
    # seen again, the added one deleted: by layers over layers
    write_key_edits(gone, muted, keys.unmuted, [0, 1], (), [1])
    keys = read_keys(gone)
    assert keys is not None
    assert keys.tracks is not None
    assert keys.muted == frozenset()
    assert keys.tracks.names == held.names[:1]
    assert keys.changes == ("/AsgRig/Keys/key_07: switched off",)
    # a new one gets a name that no key has had
    write_key_edits(tmp_path / "more.usda", gone, with_one_more(keys.tracks, "key_07"), [1])
    keys = read_keys(tmp_path / "more.usda")
    assert keys is not None
    assert keys.tracks is not None
    assert keys.tracks.names == (held.names[0], "key_08")
    assert keys.tracks.display_names == {"key_08": "key_07"}


BLENDER = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=sys.argv[1])
for one in bpy.data.objects:
    if one.type == "LIGHT":
        print("light", one.name, one.hide_render, *one.matrix_world.translation)
"""


@pytest.mark.slow
@pytest.mark.blender
@pytest.mark.skipif(not renderers.PYTHON.is_file(), reason="no Blender: make setup-dcc")
def test_blender_shows_the_keys_that_are_left_and_the_one_that_was_added(tmp_path: Path) -> None:
    stage = keyed(tmp_path)
    wanted = with_one_more(read(stage), "key_07")
    write_key_edits(tmp_path / "edits.usda", stage, wanted, [0, 1], (), [0])
    line = [str(renderers.PYTHON), "-c", BLENDER, str(tmp_path / "edits.usda")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    lights = [one.split() for one in done.stdout.splitlines() if one.startswith("light ")]
    assert [one[1:3] for one in lights] == [["key_07", "False"]]  # the rest is its world
    # +X of a stage with +Y up, from which it is turned as Blender has +Z up
    place = np.array(lights[0][3:], dtype=float)
    np.testing.assert_allclose(place / np.linalg.norm(place), [1, 0, 0], atol=1e-5)


def test_without_any_key_one_can_be_added_and_all_can_be_deleted(tmp_path: Path) -> None:
    stage = keyed(tmp_path, count=0)
    keys = read_keys(stage)
    assert keys is not None
    assert keys.tracks is None
    none = read_usd(stage)
    none = LobeTracks(none.frames, none.fps, none.lobes.split(0)[0], {}, ())
    layer, bare = tmp_path / "edits.usda", tmp_path / "none.usda"
    write_key_edits(layer, stage, with_one_more(none, "key_00"), [0], muted=())
    assert read(layer).names == ("key_00",)
    write_key_edits(bare, layer, read(layer), [0], (), [0])
    keys = read_keys(bare)
    assert keys is not None
    assert keys.tracks is None
    assert keys.changes == ("/AsgRig/Keys/key_00: switched off",)


def test_what_a_key_is_called_stays_when_the_stage_gets_more_representations(
    tmp_path: Path,
) -> None:
    stage, layer, back = keyed(tmp_path), tmp_path / "edits.usda", tmp_path / "back.usda"
    [name] = read(stage).names
    called = replace(read(stage), display_names={name: "Window"})
    write_key_edits(layer, stage, called, [0], muted=())
    assert "inputs:intensity" not in layer.read_text()
    assert read(layer).display_names == {name: "Window"}
    write_usd(
        read_usd(layer),
        tmp_path / "more.usda",
        representations=("keys", "cards"),
        keys=KeptKeys(layer),
    )
    assert read(tmp_path / "more.usda").display_names == {name: "Window"}
    write_key_edits(back, layer, replace(read(layer), display_names={}), [0], muted=())
    assert read(back).display_names == {}


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
