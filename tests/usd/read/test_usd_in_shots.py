# SPDX-License-Identifier: Apache-2.0
"""A rig as shots use it is read as USD composes it: the lights give what the lobes give."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom, UsdUtils
from rigs_in_shots import (
    FRAMES,
    RIG,
    SHEARED,
    SHOTS,
    UNEVEN,
    assert_alike,
    refused,
    shot,
    under,
)
from shot_lights import irradiance, irradiance_of_lobes, relative_rms
from usd_tracks import of_every_kind
from written_stages import calm

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.lobes import LobeTracks, asg
from asglight.usd import read_stage, read_usd, write_edit_layer, write_usd
from asglight.usd.read.read_options import read_options

AS_WRITTEN = {"cards": 0.02, "distant": 0.12, "dome": 0.02}
"""Relative error of the lights of these three lobes, one of them broad, in a stage by itself; the
lights of a shot may add a hundredth."""


def gap(path: Path, tracks: LobeTracks | None = None) -> float:
    """Return the relative error of the lights against the lobes, the worst of the frames."""
    tracks, stage = tracks or read_usd(path), Usd.Stage.Open(str(path))
    worst = 0.0
    for frame in (tracks.frames[0], tracks.frames[2], tracks.frames[-1]):
        found = irradiance(stage, frame, RIG)
        wanted = irradiance_of_lobes(tracks.at(frame))
        if not found.any():
            assert not wanted.any()
            continue
        worst = max(worst, relative_rms(wanted, found))
    return worst


@pytest.mark.parametrize("name", SHOTS)
def test_the_lights_give_what_the_lobes_give(name, folder):
    assert gap(SHOTS[name](folder)) < AS_WRITTEN["cards"] + 0.01


@pytest.mark.parametrize("representation", ["distant", "dome"])
@pytest.mark.parametrize("name", ["turned", "mirrored", "z-up, corrected", "z-up, on its side"])
def test_they_do_so_in_every_other_representation(name, representation, folder):
    path = SHOTS[name](folder)
    text = path.read_text()
    chosen = f'variants = {{ string representation = "{representation}" }}\n'
    path.write_text(text.replace(" prepend references", f" {chosen} prepend references"))
    assert gap(path) < AS_WRITTEN[representation] + 0.01


@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_lights_of_a_rig_scaled_unevenly_are_read_as_they_are_seen(representation, tmp_path):
    tracks = of_every_kind(FRAMES)
    tracks.lobes.sharpness[:] = torch.tensor([[400.0, 150.0], [60.0, 90.0], [5000.0, 9000.0]])
    write_usd(tracks, tmp_path / "rig_y.usda", representations=(representation,))
    for body in (UNEVEN, SHEARED):
        path = shot(tmp_path, body=body)
        reading = read_stage(path)
        # three cards of a lobe are taken together, and each is sheared in another way
        assert gap(path, reading.tracks) < AS_WRITTEN["cards"] + 0.01
        assert any("is scaled unevenly" in line for line in reading.unread)


def test_a_layer_that_only_sublayers_a_rig_has_its_frames(folder):
    path = folder / "over.usda"
    path.write_text("#usda 1.0\n(\n subLayers = [@./rig_y.usda@ (offset = 10; scale = 2)]\n)\n")
    reading = read_stage(path)
    rig = read_usd(folder / "rig_y.usda")
    assert reading.tracks.frames == tuple(range(2012, 2021))
    assert reading.changes == reading.unread == ()
    for frame in FRAMES:
        found = reading.tracks.at(2 * frame + 10)
        np.testing.assert_allclose(found.amplitude, rig.at(frame).amplitude, rtol=1e-6)


def test_frames_that_a_rig_lists_are_moved_with_it(tmp_path):
    twos = (1001, 1003, 1005, 1009)
    write_usd(calm(of_every_kind, twos), tmp_path / "rig_y.usda", representations=("cards",))
    arc = "prepend references = @./rig_y.usda@ (offset = -1000)"
    path = shot(tmp_path, arc, start=2, end=20)
    assert read_usd(path).frames == (3, 5, 9)
    between = shot(tmp_path, "prepend references = @./rig_y.usda@ (offset = 0.5)")
    assert read_usd(between).frames == FRAMES  # none of its frames is whole: all of the shot's


def test_a_flattened_shot_is_the_same(folder):
    path = SHOTS["later and slower"](folder)
    flat = folder / "flat.usda"
    Usd.Stage.Open(str(path)).Flatten().Export(str(flat))
    assert_alike(read_usd(flat), read_usd(path))
    twos = calm(of_every_kind, (1001, 1003, 1005))
    write_usd(twos, folder / "rig_y.usda", representations=("cards",))
    Usd.Stage.Open(str(SHOTS["later and slower"](folder))).Flatten().Export(str(flat))
    assert read_usd(flat).frames == tuple(range(1000, 1013))  # its list is not moved with it


def test_a_package_of_a_shot_is_the_same(folder):
    path = SHOTS["z-up, corrected"](folder)
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(folder / "shot.usdz"))
    assert_alike(read_usd(folder / "shot.usdz"), read_usd(path))


def test_an_open_stage_is_read_as_it_is(folder):
    path = shot(folder, "prepend payload = @./rig_y.usda@")
    stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    assert refused(stage).endswith(
        "has a payload at /World/Env that is not loaded; expected lobes. Load it: stage.Load()."
    )
    stage.Load()
    assert_alike(read_usd(stage), read_usd(folder / "rig_y.usda"))
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath(RIG)).SetRotate((0, 90, 0))
    x, y, z = read_usd(folder / "rig_y.usda").lobes.axis_z.unbind(-1)
    np.testing.assert_allclose(read_usd(stage).lobes.axis_z, torch.stack([z, y, -x], -1), atol=1e-6)
    stage.MuteLayer(str(folder / "rig_y.usda"))
    assert "rig_y.usda is muted; expected them. Unmute the layer." in refused(stage)


def test_info_eval_and_export_agree(folder, capsys):
    path = SHOTS["z-up, on its side"](folder)
    lobes = folder / "lobes.json"
    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main(["export", str(path), "--to", "json", "-o", str(lobes)]) == 0
    tracks = read_usd(path)
    x, y, z = read_usd(folder / "rig_y.usda").lobes.axis_z.unbind(-1)
    wanted = torch.stack([x, z, -y], -1)
    np.testing.assert_allclose(tracks.lobes.axis_z, wanted, atol=1e-6)
    flux = asg.flux(tracks.lobes).sum(-1, keepdim=True)
    mean = torch.nn.functional.normalize((flux * tracks.lobes.axis_z).sum(0), dim=-1)
    for row, axis in zip(told["lobes"], mean, strict=True):
        np.testing.assert_allclose(row["direction"], axis, atol=1e-4)
    from asglight.export.track_file import read_json

    assert_alike(read_json(lobes), tracks)


@pytest.mark.parametrize("name", ["turned", "mirrored", "z-up, corrected", "z-up, on its side"])
def test_a_layer_of_edits_over_a_shot_is_what_was_edited(name, folder):
    path = SHOTS[name](folder)
    tracks = read_usd(path)
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 2] *= 3
    lobes.axes[:, 2] = lobes.axes[:, 1]
    edits = LobeTracks(tracks.frames, tracks.fps, lobes, tracks.metadata, tracks.names)
    write_edit_layer(folder / "edit.usda", path, edits, [2])
    found = read_usd(folder / "edit.usda")
    np.testing.assert_allclose(found.lobes.axis_z, lobes.axis_z, atol=1e-5)
    np.testing.assert_allclose(found.lobes.amplitude, lobes.amplitude, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "fault"),
    [("instance", "is an instance, in which USD heeds no edit"), ("uneven", "is scaled unevenly")],
)
def test_a_layer_of_edits_refuses_a_rig_that_takes_none(name, fault, folder):
    path = shot(folder, body=UNEVEN) if name == "uneven" else SHOTS[name](folder)
    tracks = read_usd(folder / "rig_y.usda")
    with pytest.raises(InputError, match=f"{RIG} {fault}.*Edit the stage that holds it"):
        write_edit_layer(folder / "edit.usda", path, tracks, [0])


def test_a_stage_made_of_a_shot_has_the_up_axis_of_the_shot(folder):
    path = SHOTS["z-up, corrected"](folder)
    assert read_options(path).up_axis == "Z"
    assert main(["stitch", str(path), "-o", str(folder / "anew.usda")]) == 0
    assert_alike(read_usd(folder / "anew.usda"), read_usd(path))


def test_colours_that_a_light_states_otherwise_are_converted(folder):
    path = shot(
        folder,
        body=under(
            "float inputs:intensity = 1\nfloat inputs:width = 50\nfloat inputs:height = 50\n"
            'color3f inputs:color = (1, 0.5, 0.25) (\ncolorSpace = "lin_ap1_scene"\n)'
        ),
    )
    amplitude = read_usd(path).lobes.amplitude[0, 2].double().numpy()
    # AP1 to Rec.709 with white adapted by Bradford, as the ACES documents list it
    matrix = np.array(
        [
            [1.70505, -0.62179, -0.08326],
            [-0.13026, 1.14080, -0.01055],
            [-0.02400, -0.12897, 1.15297],
        ]
    )
    wanted = matrix @ [1, 0.5, 0.25]
    np.testing.assert_allclose(amplitude / amplitude[0], wanted / wanted[0], rtol=1e-3)
