# SPDX-License-Identifier: Apache-2.0
"""Keys and rest of shots that are stitched or resampled: their light is that of the images."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from bench_scripts import module
from key_cases import corner_error
from keyed_stages import images, lamp_at, write
from pxr import Usd

from asglight.cli.main import main
from asglight.images import read_latlong, write_exr
from asglight.sphere import latlong
from asglight.usd import lint_stage, read_keys, write_usd
from asglight.usd.read.read_options import read_options

judge = module("keyed.seen")

FRAMES = (1001, 1002, 1003, 1004)


def run(*words: object) -> int:
    return main([str(word) for word in words])


def flux(image: torch.Tensor) -> np.ndarray:
    solid = latlong.texel_solid_angles(*image.shape[:2], dtype=torch.float64)[..., None]
    return (image.double() * solid).sum((0, 1)).numpy()


def shown_flux(stage: Path, frame: int) -> np.ndarray:
    """Return the flux of cards in closed form and of the rest, as USD says them."""
    opened = Usd.Stage.Open(str(stage))
    found = flux(read_latlong(judge.rest_image(opened, frame)).radiance)
    for light in judge.lights(opened, frame):
        found = found + light.radiance * judge.solid_angle(light) * judge.texture_mean(light)
    return found


@pytest.mark.parametrize("texture", [False, True])
def test_at_another_rate_the_light_goes_evenly_from_image_to_image(
    tmp_path: Path, texture: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    maps = images(tmp_path, FRAMES)
    write(tmp_path, frames=FRAMES, texture=texture, representations=("keys", "cards"))
    old, new = tmp_path / "shot.usda", tmp_path / "wall.usda"
    assert run("resample", old, "-o", new, "--fps", "60", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["keys"]["keys"]) == 1
    assert told["keys"]["keys"][0]["frames"] == [told["frames"][0], told["frames"][-1]]
    assert read_options(new).representations == ("keys", "cards")
    assert lint_stage(new) == []
    numbers = np.array(FRAMES, dtype=float)
    truth = np.stack([flux(maps[frame]) for frame in FRAMES])
    for frame in told["frames"]:
        time = min(FRAMES[0] + (frame - FRAMES[0]) * 24 / 60, FRAMES[-1])
        wanted = [np.interp(time, numbers, truth[:, k]) for k in range(3)]
        # what is asked of keys and rest at the frames of the images
        np.testing.assert_allclose(shown_flux(new, frame), wanted, rtol=1e-4)
    first, last = (read_keys(path) for path in (old, new))
    assert first is not None
    assert last is not None
    assert torch.equal(first.rest.radiance(2), last.rest.radiance(5))  # both are at 1003
    mixed = 0.6 * first.rest.radiance(2) + 0.4 * first.rest.radiance(3)
    torch.testing.assert_close(last.rest.radiance(6), mixed, rtol=2e-3, atol=1e-4)  # half floats


def parts(folder: Path, **options: object) -> tuple[Path, Path]:
    """Write two parts that have two frames in common."""
    write(folder, "part.1.usda", frames=FRAMES[:3], **options)
    write(folder, "part.2.usda", frames=FRAMES[1:], **options)
    return folder / "part.1.usda", folder / "part.2.usda"


@pytest.mark.parametrize("texture", [False, True])
def test_parts_are_one_shot_with_one_key_a_lamp_and_the_light_of_the_images(
    tmp_path: Path, texture: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    maps = images(tmp_path, FRAMES)
    one, two = parts(tmp_path, texture=texture)
    shot = tmp_path / "shot.usda"
    assert run("stitch", two, one, "-o", shot) == 0
    said = capsys.readouterr().out
    assert "keys: 1, with" in said
    assert " 1001-1004 " in said.split("keys: 1, with")[1]
    assert lint_stage(shot) == []
    found, before = read_keys(shot), read_keys(one)
    assert found is not None
    assert before is not None
    assert found.tracks is not None
    assert before.tracks is not None
    assert found.tracks.names == before.tracks.names
    for place, frame in enumerate(FRAMES):
        np.testing.assert_allclose(shown_flux(shot, frame), flux(maps[frame]), rtol=1e-4)
        if not texture:
            [light] = judge.lights(Usd.Stage.Open(str(shot)), frame)
            corners = judge.corners(light)
            assert corner_error(corners, lamp_at(frame).corners()) < np.radians(0.9)  # a tenth
        if frame < 1002:
            assert torch.equal(found.rest.radiance(place), before.rest.radiance(place))
    assert run("info", shot) == 0
    assert "keys: 1, with" in capsys.readouterr().out


def test_a_lamp_of_one_part_alone_fades_with_the_light_of_the_images(tmp_path: Path) -> None:
    maps = images(tmp_path, FRAMES)
    write(tmp_path, "part.1.usda", frames=FRAMES[:3])
    write(tmp_path, "part.2.usda", frames=FRAMES[1:], count=0)
    shot = tmp_path / "shot.usda"
    assert run("stitch", tmp_path / "part.*.usda", "-o", shot) == 0
    for frame in FRAMES:
        np.testing.assert_allclose(shown_flux(shot, frame), flux(maps[frame]), rtol=1e-4)
    lit = [judge.lights(Usd.Stage.Open(str(shot)), frame)[0].radiance.max() for frame in FRAMES]
    assert lit[1] == pytest.approx(lit[0] * 2 / 3, rel=0.05)
    assert lit[2] == pytest.approx(lit[0] / 3, rel=0.05)
    assert lit[3] == 0


def test_a_part_without_keys_leaves_them_out_and_it_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images(tmp_path, FRAMES)
    one, two = parts(tmp_path)
    tracks = read_keys(two)
    assert tracks is not None
    assert tracks.tracks is not None
    write_usd(tracks.tracks, tmp_path / "plain.usda")
    shot = tmp_path / "shot.usda"
    assert run("stitch", one, tmp_path / "plain.usda", "-o", shot) == 0
    assert "keys: none, for not every part has keys. Cut them with: asglight keys" in (
        capsys.readouterr().out
    )
    assert read_options(shot).representations == ("cards",)
    assert run("stitch", one, tmp_path / "plain.usda", "-o", shot, "--json") == 0
    assert json.loads(capsys.readouterr().out)["keys_left_out"] is True


def test_who_asks_for_other_lights_gets_no_keys(tmp_path: Path) -> None:
    images(tmp_path, FRAMES)
    one, _ = parts(tmp_path)
    for command in (["stitch", one], ["resample", one, "--fps", "48"]):
        assert run(*command, "-o", tmp_path / "shot.usda", "--representations", "distant") == 0
        assert read_options(tmp_path / "shot.usda").representations == ("distant",)


def test_rests_of_two_sizes_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images(tmp_path, FRAMES)
    one, two = parts(tmp_path)
    small = read_latlong(tmp_path / "part.2_dome" / "part.2.rest.1003.exr").radiance
    write_exr(tmp_path / "part.2_dome" / "part.2.rest.1003.exr", small[::2, ::2])
    assert run("stitch", one, two, "-o", tmp_path / "shot.usda") == 2
    assert "rest: images of several sizes at frame 1003" in capsys.readouterr().err
