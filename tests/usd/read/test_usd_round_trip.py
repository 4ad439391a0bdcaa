# SPDX-License-Identifier: Apache-2.0
"""What is written comes back: the same function of direction, the same frames and metadata."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd
from usd_tracks import METADATA, assert_same, edited, moving, still, write_every
from written_stages import calm

from asglight.lobes import Form, LobeTracks
from asglight.usd import read_stage, read_usd, write_usd


@pytest.mark.parametrize(
    ("form", "extension"),
    [(Form.ASG, "usda"), (Form.BINGHAM, "usdc"), (Form.SG, "usd"), (Form.FLAT, "usdc")],
)
def test_moving_tracks_come_back(form, extension, tmp_path):
    tracks = moving(range(1001, 1017), form=form)
    path = tmp_path / f"shot.{extension}"
    write_every(tracks, path, dome_height=2)
    assert_same(read_usd(path), tracks)


@pytest.mark.parametrize("form", Form)
def test_noisy_tracks_come_back(form, tmp_path):
    tracks = moving(range(4), form=form, jitter=0.5)
    write_usd(tracks, tmp_path / "shot.usdc", representations=("cards",))
    assert_same(read_usd(tmp_path / "shot.usdc"), tracks)


@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_light_without_digits_reads_as_no_edit(representation, tmp_path):
    tracks = still([(3.0, 2.0), (40.0, 5.0), (900.0, 900.0)])
    brightness = torch.tensor([1e-38, 1e-41, 5e-44])[:, None]  # float32 ends at 1.4e-45
    amplitude = tracks.lobes.amplitude / tracks.lobes.amplitude.amax(-1, keepdim=True) * brightness
    tracks = replace(tracks, lobes=replace(tracks.lobes, amplitude=amplitude))
    write_usd(tracks, tmp_path / "shot.usda", representations=(representation,))
    reading = read_stage(tmp_path / "shot.usda")
    assert reading.changes == ()
    assert bool((reading.tracks.lobes.amplitude == amplitude).all())


def test_one_frame_comes_back(tmp_path):
    tracks = still()
    write_every(tracks, tmp_path / "shot.usda", dome_height=2)
    assert_same(read_usd(tmp_path / "shot.usda"), tracks)


@pytest.mark.thorough
@settings(max_examples=tries(15), deadline=None)
@given(
    frames=st.lists(st.integers(-50, 3000), min_size=1, max_size=6, unique=True).map(sorted),
    fps=st.sampled_from([23.976, 24.0, 29.97, 120.0]),
)
def test_any_frames_and_rate_come_back(frames, fps, tmp_path_factory):
    moved = calm(moving, frames)
    tracks = LobeTracks(moved.frames, fps, moved.lobes, {})
    path = tmp_path_factory.mktemp("frames") / "shot.usda"
    write_usd(tracks, path, representations=("distant", "dome"), dome_height=2)
    assert_same(read_usd(path), tracks)


def test_frames_without_a_gap_are_not_listed(tmp_path):
    for name, frames in (("whole", range(1001, 1005)), ("step", [1001, 1003, 1005])):
        write_usd(calm(moving, frames), tmp_path / f"{name}.usda", representations=("distant",))
    assert "frames = " not in (tmp_path / "whole.usda").read_text()
    assert "int[] frames = [1001, 1003, 1005]" in (tmp_path / "step.usda").read_text()


def test_a_shortened_range_leaves_the_listed_frames_within_it(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(moving, [1001, 1003, 1005, 1007]), path, representations=("distant",))
    edited(path, lambda layer: setattr(layer, "endTimeCode", 1005))
    assert read_usd(path).frames == (1001, 1003, 1005)


def test_metadata_is_json_on_the_rig(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(moving, range(3)), path, representations=("distant",))
    stage = Usd.Stage.Open(str(path))
    data = stage.GetDefaultPrim().GetCustomDataByKey("asglight")
    assert json.loads(data["metadata"]) == METADATA


def test_a_lobe_that_was_switched_off_is_not_read(tmp_path):
    path = tmp_path / "shot.usda"
    tracks = calm(moving, range(3))
    write_usd(tracks, path, representations=("cards",))

    def switch_off(layer: Sdf.Layer) -> None:
        layer.GetPrimAtPath("/AsgRig/Lobes/lobe_01").active = False

    back = read_usd(edited(path, switch_off))
    np.testing.assert_allclose(back.lobes.amplitude, tracks.lobes.amplitude[:, [0, 2]], rtol=2e-6)


def test_an_override_in_a_stronger_layer_is_read(tmp_path):
    write_every(still(), tmp_path / "shot.usda", dome_height=2)
    (tmp_path / "lighting.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "AsgRig"\n startTimeCode = 1001\n endTimeCode = 1001\n'
        " subLayers = [@./shot.usda@]\n)\n"
        'over "AsgRig"\n{\nover "Lobes"\n{\nover "lobe_00"\n{\n'
        "color3f asg:amplitude = (7, 8, 9)\n}\n}\n}\n"
    )
    assert read_usd(tmp_path / "lighting.usda").lobes.amplitude[0, 0].tolist() == [7, 8, 9]


def test_a_file_rewritten_while_a_stage_holds_it_is_read_anew(tmp_path):
    path = tmp_path / "shot.usdc"
    write_usd(calm(moving, range(5)), path, representations=("distant",))
    held = Usd.Stage.Open(str(path))
    tracks = calm(moving, range(10, 14), seed=1)
    write_usd(tracks, path, representations=("distant",))
    assert_same(read_usd(path), tracks)
    assert held.GetDefaultPrim()


def test_lobes_beyond_a_hundred_keep_their_order(tmp_path):
    tracks = moving([1], lobes=101)
    write_usd(tracks, tmp_path / "shot.usda", representations=("distant",))
    assert_same(read_usd(tmp_path / "shot.usda"), tracks)
