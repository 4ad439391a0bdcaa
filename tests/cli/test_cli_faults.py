# SPDX-License-Identifier: Apache-2.0
"""Everything a user can get wrong ends with exit status 2 and one line on standard error."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import sky_files
import torch

from asglight.cli.main import main
from asglight.shots.kept.checkpoint import Checkpoint, header_of


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the bytes of a good stage of frames 1001 to 1004."""
    folder = tmp_path_factory.mktemp("good")
    sky_files.write_sequence(folder / "in")
    output = str(folder / "good.usda")
    assert main(["fit", str(folder / "in"), "-o", output, "--lobes", "2"]) == 0
    return Path(output).read_bytes()


@pytest.fixture
def here(tmp_path: Path, stage: bytes, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Fill a folder with good and bad things and go there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    sky_files.write_sequence(tmp_path / "in")
    sky_files.write_frame(tmp_path / "still.exr", sky_files.sky(0))
    sky_files.write_frame(tmp_path / "square.exr", np.ones((8, 8, 3), np.float32))
    sky_files.write_sequence(tmp_path / "gap")
    (tmp_path / "gap" / "sky.1002.exr").unlink()
    sky_files.write_sequence(tmp_path / "two")
    sky_files.write_frame(tmp_path / "two" / "other.exr", sky_files.sky(0))
    good = (tmp_path / "still.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(good[: len(good) // 2])
    (tmp_path / "text.exr").write_text("no image")
    (tmp_path / "zero.exr").touch()
    (tmp_path / "empty").mkdir()
    (tmp_path / "folder.usda").mkdir()
    (tmp_path / "blocked.usda.checkpoint").mkdir()
    (tmp_path / "foreign.usda.checkpoint").write_text("my notes")
    (tmp_path / "good.usda").write_bytes(stage)
    (tmp_path / "cut.usda").write_bytes(stage[: len(stage) // 2])
    (tmp_path / "text.usda").write_text("no stage")
    (tmp_path / "bare.usda").write_text("#usda 1.0\n")
    with Checkpoint(tmp_path / "busy.usda.checkpoint", header_of({}), resume=False):
        yield tmp_path


FIT = "fit still.exr -o x.usda"
FAULTS = [
    ("", "arguments are required: COMMAND"),
    ("polish a.exr", "invalid choice: 'polish'"),
    ("fit", "required: INPUT, -o/--output"),
    ("fit still.exr", "required: -o/--output"),
    ("fit -o x.usda", "required: INPUT"),
    (f"{FIT} --polish", "unrecognized arguments: --polish"),
    (
        f"{FIT} --lob 3",
        r"unrecognized arguments: --lob 3. Did you mean --lobes\? See asglight fit --help",
    ),
    (
        f"{FIT} --refrence a.exr",
        r"unrecognized arguments: --refrence a.exr. See asglight fit --help",
    ),
    (f"{FIT} --presett=live", r"--presett=live. Did you mean --preset\?"),
    ("figures lobes a.exr --frame 3", r"--frame 3. Did you mean --frames\? See asglight figures"),
    ("fit good.usda -o x.usda", "good.usda: is a USD stage; expected an OpenEXR"),
    ("fit nothing.exr -o x.usda", "nothing.exr: is not there; expected a file"),
    ("fit nowhere/sky.####.exr -o x.usda", "there is no folder nowhere"),
    ("fit empty -o x.usda", "empty: holds no image"),
    ("fit two -o x.usda", "two: holds 2 images or sequences"),
    ("fit gap -o x.usda", r"1 frame missing \(1002\).* Use --missing hold"),
    ("fit square.exr -o x.usda", "square.exr: is 8 x 8; expected a 2:1 latlong"),
    ("fit text.exr -o x.usda", "text.exr: "),
    ("fit zero.exr -o x.usda", "zero.exr: "),
    ("fit cut.exr -o x.usda", "cut.exr: "),
    (f"{FIT} --frames x-y", "frames: x-y; expected whole frames"),
    ("fit in -o x.usda --frames 5-7", "has none of the frames 5, 6, 7"),
    ("fit in -o x.usda --frames 1003-1006", r"2 frames missing \(1005, 1006\)"),
    (f"{FIT} --layer diffuse", "still.exr: .*diffuse"),
    (f"{FIT} --input-colorspace sRBG", "input colorspace: sRBG; expected a name that OpenColorIO"),
    (f"{FIT} --eye right", "still.exr: has no right eye: it is "),
    (f"{FIT} --eye up", "argument --eye: invalid choice: 'up'"),
    (f"{FIT} --repair 2", "repair: 2; expected a share from 0 to 1"),
    (f"{FIT} --missing guess", "--missing: invalid choice: 'guess'"),
    (f"{FIT} --lobes 0", "lobes: 0; expected 1 to 512"),
    (f"{FIT} --lobes 100000", "lobes: 100000; expected 1 to 512"),
    (f"{FIT} --lobes many", "--lobes: invalid int value: 'many'"),
    (f"{FIT} --preset slow", "--preset: invalid choice: 'slow'"),
    (f"{FIT} --form cube", "--form: invalid choice: 'cube'"),
    (f"{FIT} --seed -1", "seed: -1; expected 0 to"),
    (f"{FIT} --fps 0", "fps: 0; expected a number above 0"),
    (f"{FIT} --fps fast", "--fps: 'fast' is no frame rate; expected a number such as 24"),
    (f"{FIT} --fps 1/0", "--fps: '1/0' is no frame rate"),
    (f"{FIT} --device tpu", "device: tpu; expected cpu, cuda"),
    (f"{FIT} --device cuda", "device: cuda, but torch finds no CUDA device here"),
    (f"{FIT} --paper-steps 3", "--paper-steps: '3'; expected two whole numbers such as 24000,6000"),
    (f"{FIT} --paper-steps 3,2", "paper steps: given with --preset fast, which has none"),
    (f"{FIT} --preset paper --paper-steps 0,2", "paper steps: 0,2; expected two whole numbers"),
    (f"{FIT} --representations cubes", "--representations: cubes; expected some of cards, distant"),
    ("fit still.exr -o x.exr", "x.exr: its extension is .exr; expected .usda"),
    ("fit still.exr -o x", "x: its extension is missing"),
    ("fit still.exr -o folder.usda", "folder.usda: is a folder"),
    ("fit still.exr -o x.usda/", "x.usda/: names a folder; expected a file to write. Leave out"),
    ("fit still.exr -o x.usda/ --scheduler local", "x.usda/: names a folder; expected a file"),
    ("stitch good.usda -o x.usda/", "-o/--output: x.usda/: names a folder; expected a file"),
    ("resample good.usda --fps 48 -o x.usda/", "x.usda/: names a folder; expected a file"),
    ("keys good.usda --reference in -o x.usda/", "x.usda/: names a folder; expected a file"),
    ("export good.usda --to dome -o x.usda/", "x.usda/: names a folder; expected a file"),
    ("import a.npy --from physg -o x.usda/", "x.usda/: names a folder; expected a file"),
    ("fit still.exr -o nowhere/x.usda", "there is no folder nowhere; .* Make it first"),
    ("fit still.exr -o text.exr/x.usda", "there is no folder text.exr"),
    ("fit still.exr -o blocked.usda", r"blocked.usda.checkpoint: cannot be written"),
    ("fit still.exr -o foreign.usda", "foreign.usda.checkpoint: is no checkpoint of asglight"),
    ("fit still.exr -o busy.usda", "busy.usda: another run is writing it"),
    ("info", "required: INPUT"),
    ("info nothing.usda", "nothing.usda: "),
    ("info text.usda", "text.usda: "),
    ("info cut.usda", "cut.usda: "),
    ("info bare.usda", "bare.usda: "),
    ("info empty", "empty: holds no image"),
    ("info good.usda --frames 7", "--frames: given with a stage; expected it with images only."),
    ("info good.usda --layer a", "--layer: given with a stage; expected it with images only."),
    ("eval good.usda", "required: --reference"),
    ("eval nothing.usda --reference in", "nothing.usda: "),
    ("eval good.usda --reference nothing.exr", "nothing.exr: is not there"),
    ("eval good.usda --reference gap", r"gap: lacks 1002 of good.usda; expected an image"),
    ("eval good.usda --reference still.exr", r"still.exr: lacks 1001, 1002, 1003, 1004"),
    ("eval good.usda --reference in/sky.1001-1002#.exr", "its range is 1001, 1002; expected 1001,"),
    ("eval good.usda --reference in --frames 1004-1006", "frames: 1005, 1006 not in good.usda"),
    ("eval good.usda --reference in --frames later", "frames: later; expected whole frames"),
    ("demo -o text.usda", "text.usda: cannot be made"),
]


@pytest.mark.parametrize(("line", "message"), FAULTS, ids=[line or "none" for line, _ in FAULTS])
def test_a_fault_is_one_line_and_exit_status_2(
    here: Path, capfd: pytest.CaptureFixture[str], line: str, message: str
) -> None:
    before = sorted(here.rglob("*"))
    assert main(line.split()) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("asglight: ")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert sorted(here.rglob("*")) == before


def test_an_empty_and_an_unprintable_name_are_one_line(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("", "a\nb.exr", "a\x1b[2J.exr", "\udcff.exr"):
        assert main(["fit", name, "-o", "x.usda"]) == 2
        assert capfd.readouterr().err.count("\n") == 1


def test_a_checkpoint_of_other_settings_is_refused_with_what_differs(
    here: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = ["fit", "in", "-o", "x.usda", "--frames", "1001-1002", "--lobes", "2"]
    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "remove", lambda self: None)
        assert main(fit) == 0
    capfd.readouterr()
    assert main([*fit[:-1], "3", "--resume"]) == 2
    err = capfd.readouterr().err
    assert "x.usda.checkpoint: was made with lobes 2, this run has 3" in err
    lines = Path("x.usda.checkpoint").read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(b'"loss"', b'"lost"')
    Path("x.usda.checkpoint").write_bytes(b"".join(lines))
    assert main([*fit, "--resume"]) == 2
    assert "x.usda.checkpoint: line 2 is damaged" in capfd.readouterr().err
