# SPDX-License-Identifier: Apache-2.0
"""`asglight export` to arrays of PhySG and NeRD, and `asglight import` of them."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from usd_tracks import contents, moving

from asglight.cli.main import main
from asglight.export import SgLayout, read_sg_array
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, texels
from asglight.usd import read_usd, write_usd

FRAMES = [1001, 1002, 1004]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a stage of asg and one of sg lobes, and an array."""
    folder = tmp_path_factory.mktemp("written")
    write_usd(moving(FRAMES), folder / "shot.usda")
    write_usd(moving(FRAMES, form=Form.SG), folder / "sg.usda")
    np.save(folder / "lights.npy", np.ones((2, 3, 7), np.float32))
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a copy of what was written."""
    monkeypatch.chdir(shutil.copytree(written, tmp_path, dirs_exist_ok=True))
    return tmp_path


def test_a_shot_is_an_array_of_its_frames(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "sg.usda", "--to", "physg", "-o", "out.npy"]) == 0
    found, expected = np.load("out.npy"), read_usd("sg.usda").lobes
    assert found.shape == (3, 3, 7)
    np.testing.assert_array_equal(found[..., :3], expected.axis_z)
    np.testing.assert_array_equal(found[..., 3], expected.sharpness[..., 0])
    np.testing.assert_array_equal(found[..., 4:], expected.amplitude)
    # Nothing is lost, so there is no second line.
    size = (folder / "out.npy").stat().st_size
    assert capsys.readouterr().out == (
        f"out.npy: 3 lobes of form sg, 3 frames (1001-1002,1004) at 24 fps, {size} B\n"
    )


def test_a_frame_is_an_array_of_its_lobes(folder: Path) -> None:
    line = "export sg.usda --to nerd --frame 1004 -o out.npy"
    assert main(line.split()) == 0
    found = np.load(folder / "out.npy")
    assert found.shape == (3, 7)
    expected = read_usd("sg.usda").lobes[2]
    np.testing.assert_array_equal(found[:, 3:6], expected.axis_z * torch.tensor([1, 1, -1]))


def test_what_anisotropic_lobes_lose_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "shot.usda", "--to", "physg", "-o", "out.npy"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    match = re.fullmatch(
        r"3 of 3 lobes lost their anisotropy: irradiance changes by (\S+) % in the mean, "
        r"(\S+) % in the worst frame",
        lines[1],
    )
    assert match is not None
    # As `eval` has it on a map of the usual size.
    every, back = read_usd("shot.usda").lobes, read_sg_array("out.npy", SgLayout.PHYSG).lobes
    errors = [
        100 * frame_errors(back[k], texels.texel_means(every[k], 128, 256)).values["irr"]
        for k in range(3)
    ]
    # Two digits are printed; maps of 64 rows are enough for the first three.
    assert float(match[1]) == pytest.approx(np.mean(errors), rel=0.01, abs=0.005)
    assert float(match[2]) == pytest.approx(max(errors), rel=0.01, abs=0.005)
    assert max(errors) > 1


def test_what_nerd_does_not_show_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tracks = moving([1], form=Form.SG)
    tracks.lobes.sharpness[0, :, :] = torch.tensor([[10.0], [20.0], [500.0]])
    write_usd(tracks, "sun.usda")
    assert main(["export", "sun.usda", "--to", "nerd", "-o", "out.npy"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(
        r"1 of 3 lobes held to NeRD's sharpness, 0\.5 to 30: irradiance changes by \d\.\d\d %",
        lines[1],
    )
    assert np.load("out.npy")[2, 6] == 30
    assert lines[2] == (
        "NeRD's training takes arrays of 24 lobes, not of 3; for it, fit with --form sg --lobes 24"
    )


def test_nothing_is_said_of_an_array_that_nerd_trains_with(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = moving([1], 24, form=Form.SG)
    tracks.lobes.sharpness[:] = tracks.lobes.sharpness.clamp(1, 25)
    write_usd(tracks, "soft.usda")
    assert main(["export", "soft.usda", "--to", "nerd", "-o", "out.npy"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("layout", ["physg", "nerd"])
def test_import_makes_a_stage_of_an_array(
    folder: Path, layout: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = moving(FRAMES, form=Form.SG)
    tracks.lobes.sharpness[:] = tracks.lobes.sharpness.clamp(1, 25)
    write_usd(tracks, "soft.usda")
    assert main(f"export soft.usda --to {layout} -o a.npy".split()) == 0
    line = f"import a.npy --from {layout} -o back.usda --first-frame 7 --fps 25 --up-axis Z"
    assert main(line.split()) == 0
    assert re.fullmatch(
        r"back\.usda: 3 lobes of form sg, 3 frames \(7-9\) at 25 fps, [\d.]+ kB",
        capsys.readouterr().out.splitlines()[-1],
    )
    back = read_usd("back.usda")
    assert back.frames == (7, 8, 9)
    torch.testing.assert_close(back.lobes.axis_z, tracks.lobes.axis_z, rtol=0, atol=1e-6)
    # To 1e-6 of themselves, as every stage keeps values in time.
    torch.testing.assert_close(back.lobes.sharpness, tracks.lobes.sharpness, rtol=2e-6, atol=0)
    torch.testing.assert_close(back.lobes.amplitude, tracks.lobes.amplitude, rtol=2e-6, atol=0)
    assert main(["info", "back.usda"]) == 0
    assert f"imported: {layout} array, from a.npy, asglight " in capsys.readouterr().out


def test_import_as_json_is_one_document(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "lights.npy", "--from", "nerd", "-o", "a.usda", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document.pop("bytes") > 1000
    assert document == {
        "output": "a.usda",
        "lobes": 3,
        "form": "sg",
        "fps": 24,
        "frames": [1, 2],
    }


FAULTS = [
    ("export shot.usda --to physg -o out.json", r"out\.json: expected a name that ends in \.npy"),
    ("export shot.usda --to nerd -o none/a.npy", r"none/a\.npy: cannot be written \(no folder"),
    ("import", "required: ARRAY, --from, -o/--output"),
    ("import lights.npy --from mjp -o a.usda", "--from: invalid choice: 'mjp'"),
    ("import none.npy --from physg -o a.usda", r"none\.npy: cannot be read \(No such file"),
    ("import shot.usda --from physg -o a.usda", r"shot\.usda: is no whole \.npy array"),
    ("import lights.npy --from nerd -o a.json", r"a\.json: extension '\.json'; expected \.usd"),
    ("import lights.npy --from nerd -o a.usda --fps x", "'x' is no frame rate"),
    ("import lights.npy --from nerd -o a.usda --fps 0", "fps: 0.*; expected a finite number"),
    ("import lights.npy --from nerd -o a.usda --first-frame x", "--first-frame: invalid int"),
    (
        "import lights.npy --from nerd -o a.usda --first-frame 2147483648",
        "first frame: 2147483648; expected frames of 32 bits",
    ),
]


@pytest.mark.parametrize(("line", "message"), FAULTS, ids=[line for line, _ in FAULTS])
def test_a_fault_is_one_line_and_changes_nothing(
    folder: Path, capfd: pytest.CaptureFixture[str], line: str, message: str
) -> None:
    before = contents(folder)
    assert main(line.split()) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("asglight: ")
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert contents(folder) == before
