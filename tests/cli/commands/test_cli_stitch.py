# SPDX-License-Identifier: Apache-2.0
"""`asglight stitch`: parts on disk to one stage, and everything that parts can have wrong."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import sky_files
import torch
import usd_tracks
from places import SHARED

from asglight import read_usd
from asglight.cli.main import main
from asglight.lobes import Form, LobeTracks, asg
from asglight.usd import write_usd

TURNING = usd_tracks.moving(range(1001, 1061), 3)
"""Slow enough that no lobe jumps from one frame to the next."""

WHOLE = replace(
    TURNING,
    frames=TURNING.frames[:12],
    lobes=TURNING.lobes[:12],
    metadata={
        "preset": "live",
        "source": "sky.####.exr",
        "loss": [0.5] * 12,
        "repairs": {
            "negative_texels": 2,
            "nonfinite_texels": 1,
            "frames": [1001],
            "frames_filled": [],
        },
    },
)
BOUNDS = {"part.1.usda": (0, 6), "part.2.usda": (4, 9), "part.3.usda": (9, 12)}

DAY = SHARED / "sequences" / "day"


def write_part(path: Path, start: int, stop: int, **changes: object) -> Path:
    frames, lobes = WHOLE.frames[start:stop], WHOLE.lobes[start:stop]
    tracks = replace(WHOLE, frames=frames, lobes=lobes)
    write_usd(replace(tracks, **changes), path, representations=("distant", "cards"))
    return path


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with parts of a shot, and with stages that are no parts of it."""
    folder = tmp_path_factory.mktemp("parts")
    for name, bounds in BOUNDS.items():
        write_part(folder / name, *bounds)
    write_part(folder / "late.usda", 8, 12)
    write_part(folder / "fast.usda", 4, 9, fps=30.0)
    bingham = replace(WHOLE.lobes, form=Form.BINGHAM)[4:9]
    write_part(folder / "form.usda", 4, 9, lobes=bingham)
    write_part(folder / "inside.usda", 1, 4)
    good = (folder / "part.2.usda").read_bytes()
    (folder / "cut.usda").write_bytes(good[: len(good) // 2])
    return folder


@pytest.fixture
def here(written: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(written)
    return written


def one_lobe_radiance(tracks: LobeTracks) -> torch.Tensor:
    """Return the flux of each lobe times its direction, which names a lobe.  [F, N, 3]."""
    return asg.flux(tracks.lobes).sum(-1, keepdim=True) * tracks.lobes.axis_z


@pytest.mark.parametrize("words", [["part.?.usda"], ["part.3.usda", "part.1.usda", "part.[2].*"]])
def test_parts_become_one_stage(
    words: list[str], here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The program expands patterns itself: the shells of Windows do not."""
    before = usd_tracks.contents(here)
    output = tmp_path / "shot.usda"
    assert main(["stitch", *words, "-o", str(output)]) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{output}: 3 lobes, 12 frames (1001-1012) at 24 fps, ")
    assert first.endswith(", from 3 parts")
    repaired = "repaired: 1 NaN and 2 negative texels set to 0 in 1 frame (1001)"
    assert rest[:2] == ["part part.1.usda: 1001-1006, 3 lobes", f"part part.1.usda: {repaired}"]
    assert usd_tracks.contents(here) == before
    tracks = read_usd(output)
    assert (tracks.frames, tracks.fps) == (WHOLE.frames, WHOLE.fps)
    expected = one_lobe_radiance(WHOLE)
    # two writes, each with samples left out that interpolation gives to 1e-6
    assert (one_lobe_radiance(tracks) - expected).abs().max() < 1e-5 * expected.abs().max()


def test_the_stage_remembers_its_parts(
    here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = str(tmp_path / "shot.usda")
    assert main(["stitch", "part.?.usda", "-o", output, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["output"], document["lobes"]) == (output, 3)
    assert document["frames"] == list(range(1001, 1013))
    assert document["bytes"] >= Path(output).stat().st_size
    names = [(part["name"], part["frames"], part["lobes"]) for part in document["parts"]]
    assert names == [
        (name, list(WHOLE.frames[slice(*bounds)]), 3) for name, bounds in BOUNDS.items()
    ]
    metadata = read_usd(output).metadata
    assert (metadata["preset"], metadata["source"]) == ("live", "sky.####.exr")
    assert metadata["parts"] == document["parts"]
    assert metadata["parts"][0]["repairs"] == WHOLE.metadata["repairs"]
    assert not {"loss", "repairs"} & metadata.keys()  # true of a part only
    assert main(["info", output]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "representation: distant (also cards)" in lines
    assert "part part.3.usda: 1010-1012, 3 lobes" in lines


def test_a_stitched_part_counts_as_its_parts(here: Path, tmp_path: Path) -> None:
    half, whole = str(tmp_path / "half.usda"), str(tmp_path / "whole.usda")
    assert main(["stitch", "part.1.usda", "part.2.usda", "-o", half]) == 0
    assert main(["stitch", "part.3.usda", half, "-o", whole]) == 0
    parts = read_usd(whole).metadata["parts"]
    assert [part["name"] for part in parts] == list(BOUNDS)


def test_one_part_is_copied(here: Path, tmp_path: Path) -> None:
    output = tmp_path / "shot.usda"
    assert main(["stitch", "part.2.usda", "-o", str(output)]) == 0
    found, expected = read_usd(output), read_usd(here / "part.2.usda")
    assert found.frames == expected.frames
    assert torch.allclose(found.lobes.axes, expected.lobes.axes, atol=1e-6)  # samples left out
    assert torch.allclose(found.lobes.amplitude, expected.lobes.amplitude, rtol=1e-5)


FAULTS = [
    ("stitch", "required: STAGE, -o/--output"),
    ("stitch part.1.usda", "required: -o/--output"),
    ("stitch -o x.usda", "required: STAGE"),
    ("stitch none.*.usda -o x.usda", "none.*.usda: no file matches; expected the stages"),
    ("stitch none.usda -o x.usda", "none.usda: no such file"),
    ("stitch part.1.usda cut.usda -o x.usda", "cut.usda: "),
    ("stitch part.1.usda late.usda -o x.usda", "part.1.usda and late.usda: between them frames"),
    ("stitch part.1.usda late.usda -o x.usda", "are missing (1007-1008); expected"),
    ("stitch part.1.usda fast.usda -o x.usda", "fast.usda: 30 fps, but part.1.usda has 24"),
    ("stitch part.1.usda form.usda -o x.usda", "form.usda: lobes of form bingham, but part.1"),
    ("stitch part.1.usda inside.usda -o x.usda", "inside.usda: frames 1002-1004 beside 1001-1006"),
    ("stitch part.?.usda -o part.2.usda", "part.2.usda: would overwrite the part part.2.usda"),
    ("stitch part.?.usda -o ./part.3.usdc", "would overwrite the part part.3.usda or the images"),
    ("stitch part.?.usda -o x.txt", "x.txt: extension '.txt'"),
    ("stitch part.?.usda -o none/x.usda", "no folder none"),
]


@pytest.mark.parametrize(("words", "message"), FAULTS)
def test_a_fault_is_one_line(
    words: str, message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = usd_tracks.contents(here)
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("asglight: ")
    assert message in line
    assert usd_tracks.contents(here) == before


def test_the_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stitch", "--help"]) == 0
    assert "example: asglight stitch part.*.usdc -o shot.usdc" in capsys.readouterr().out


def test_chunks_that_were_fitted_apart_are_one_shot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sky_files.write_sequence(tmp_path / "in", range(1001, 1005))
    options = ["--lobes", "2", "--preset", "fast"]
    for number, frames in enumerate(("1001-1003", "1002-1004"), 1):
        part = str(tmp_path / f"part.{number}.usdc")
        assert main(["fit", str(source), "-o", part, "--frames", frames, *options]) == 0
        first, last = map(int, frames.split("-"))
        assert read_usd(part).frames == tuple(range(first, last + 1))
    shot = str(tmp_path / "shot.usdc")
    assert main(["stitch", str(tmp_path / "part.*.usdc"), "-o", shot]) == 0
    assert read_usd(shot).frames == tuple(range(1001, 1005))
    errors: dict[str, dict[int, float]] = {}
    for name in ("part.1", "part.2", "shot"):
        capsys.readouterr()
        stage = str(tmp_path / f"{name}.usdc")
        assert main(["eval", stage, "--reference", str(source), "--json"]) == 0
        rows = json.loads(capsys.readouterr().out)["frames"]
        errors[name] = {row["frame"]: row["flux"] for row in rows}
    for frame, error in errors["shot"].items():
        of_parts = [errors[name][frame] for name in ("part.1", "part.2") if frame in errors[name]]
        # the maps have 8 rows, so the shape of a narrow lobe shows in the flux of the texels
        slack = 1e-5 if len(of_parts) == 1 else 1e-3
        assert min(of_parts) - slack < error < max(of_parts) + slack


@pytest.mark.skipif(not DAY.is_dir(), reason="needs ../shared/sequences/day")
def test_the_sun_is_one_track(tmp_path: Path) -> None:
    options = ["--lobes", "6", "--preset", "live"]
    for frames in ("1012-1014", "1013-1015"):
        part = str(tmp_path / f"part.{frames}.usdc")
        assert main(["fit", str(DAY), "-o", part, "--frames", frames, *options]) == 0
    shot = str(tmp_path / "shot.usdc")
    assert main(["stitch", str(tmp_path / "part.*.usdc"), "-o", shot]) == 0
    lobes = read_usd(shot).lobes
    flux = asg.flux(lobes).sum(-1)
    brightest = flux.argmax(-1)
    assert (brightest == brightest[0]).all()
    sun = lobes.axis_z[:, int(brightest[0])]
    # the sun crosses 180 degrees in 48 frames
    assert (sun[1:] * sun[:-1]).sum(-1).min() > 0.995
