# SPDX-License-Identifier: Apache-2.0
"""Keys that hang slanted, in stages: what pxr says of them, and what comes back after edits."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from bench_scripts import module
from key_cases import Rectangle, corner_error, with_lamps
from keyed_stages import FRAMES, ROWS, tracks_of
from pxr import Gf, Usd, UsdGeom
from scipy.spatial.transform import Rotation

from asglight.images import open_sequence, write_exr
from asglight.lobes import LobeTracks
from asglight.shots.keying import Keying
from asglight.usd import lint_stage, read_keys, write_key_edits, write_usd
from asglight.usd.lights import cards
from asglight.usd.options import KeyOptions

judge = module("keyed.seen")
rows = module("keyed.rows")

TENTH = np.radians(1.4)
"""Of the shorter side of the lamp as it is seen."""


def lamp_at(frame: int) -> Rectangle:
    return Rectangle(150 + 12 * (frame - 1001), 20, 15, 30, 22, slant=45, about=40)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the stage of a key for tests that only look at it."""
    return keyed(tmp_path_factory.mktemp("slanted"))


def keyed(folder: Path, **options: object) -> Path:
    """Write three frames of a slanted lamp that passes the seam, and the stage of its key."""
    for frame in FRAMES[:3]:
        write_exr(folder / f"sky.{frame}.exr", with_lamps(ROWS, lamp_at(frame), rays=4))
    keying = Keying(open_sequence(folder / "sky.####.exr"), KeyOptions(texture=False))
    path = folder / "shot.usda"
    write_usd(tracks_of(FRAMES[:3]), path, representations=("keys",), keys=keying, **options)
    return path


def corners_of(tracks: LobeTracks, place: int) -> np.ndarray:
    found = cards.rectangles_of(tracks.lobes[place].to(torch.float64))
    return found.corners()[0].numpy()


def read(path: Path) -> LobeTracks:
    keys = read_keys(path)
    assert keys is not None
    assert keys.tracks is not None
    return keys.tracks


@pytest.mark.parametrize("options", [{}, {"up_axis": "Z", "meters_per_unit": 0.01}])
def test_a_slanted_lamp_is_a_slanted_light_and_comes_back(
    tmp_path: Path, plain: Path, options: dict
) -> None:
    stage = keyed(tmp_path, **options) if options else plain
    assert lint_stage(stage) == []
    tracks = read(stage)
    for place, frame in enumerate(FRAMES[:3]):
        [light] = judge.lights(Usd.Stage.Open(str(stage)), frame)
        seen = judge.corners(light)
        if options:
            seen = np.stack([seen[:, 0], seen[:, 2], -seen[:, 1]], -1)  # +Z is up there
        assert corner_error(seen, lamp_at(frame).corners()) < TENTH
        assert corner_error(corners_of(tracks, place), seen) < 1e-5
        if not options:
            image = open_sequence(stage.parent / "sky.####.exr").read(frame).radiance
            errors = rows.frame_row(stage, frame, image)
            assert errors["flux"] < 1e-4
            assert errors["irr"] < 0.003
    keys = read_keys(stage)
    assert keys is not None
    assert keys.changes == ()


def test_between_frames_the_light_is_the_key_of_that_time(plain: Path) -> None:
    opened = Usd.Stage.Open(str(plain))
    ends = [judge.lights(opened, frame)[0] for frame in FRAMES[:2]]
    flux = [one.radiance * judge.solid_angle(one) for one in ends]
    for part in (0.25, 0.5, 0.75):
        [light] = judge.lights(opened, FRAMES[0] + part)
        wanted = (1 - part) * flux[0] + part * flux[1]
        # the light of samples between frames is right to a few thousandths (between.py)
        np.testing.assert_allclose(light.radiance * judge.solid_angle(light), wanted, rtol=5e-3)


def test_a_light_that_is_turned_where_it_hangs_is_read_as_it_hangs(plain: Path) -> None:
    stage = Usd.Stage.Open(str(plain))
    stage.SetEditTarget(stage.GetSessionLayer())
    [prim] = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    image = UsdGeom.Xformable(prim)
    turn = Gf.Matrix4d(Gf.Rotation(Gf.Vec3d(0.3, 1, 0), 25), Gf.Vec3d(0))
    matrices = {frame: image.GetLocalTransformation(frame) for frame in FRAMES[:3]}
    op = image.MakeMatrixXform()
    for frame, matrix in matrices.items():
        place = Gf.Matrix4d().SetTranslate(matrix.ExtractTranslation())
        op.Set(matrix * place.GetInverse() * turn * place, frame)
    keys = read_keys(stage)
    assert keys is not None
    assert keys.tracks is not None
    assert len(keys.changes) == 1
    for place, frame in enumerate(FRAMES[:3]):
        [light] = judge.lights(stage, frame)
        assert corner_error(corners_of(keys.tracks, place), judge.corners(light)) < 1e-4


def test_edits_of_a_slanted_key_turn_its_card_with_it(tmp_path: Path, plain: Path) -> None:
    stage = Path(shutil.copytree(plain.parent, tmp_path, dirs_exist_ok=True)) / plain.name
    tracks = read(stage)
    turn = Rotation.from_euler("YXZ", [80, 20, 10], degrees=True).as_matrix()
    axes = tracks.lobes.axes @ torch.from_numpy(turn.T).float()
    wanted = replace(tracks, lobes=replace(tracks.lobes, axes=axes))
    write_key_edits(tmp_path / "edits.usda", stage, wanted, [0])
    assert lint_stage(tmp_path / "edits.usda") == []
    found = read(tmp_path / "edits.usda")
    for place, frame in enumerate(FRAMES[:3]):
        moved = corners_of(tracks, place) @ turn.T
        assert corner_error(corners_of(found, place), moved) < 1e-4
        [light] = judge.lights(Usd.Stage.Open(str(tmp_path / "edits.usda")), frame)
        assert corner_error(judge.corners(light), moved) < 1e-4
