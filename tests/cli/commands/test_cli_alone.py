# SPDX-License-Identifier: Apache-2.0
"""Commands that write a stage, while a fit writes it: one of the two is refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import sky_files
from usd_tracks import contents

from asglight.cli.main import main
from asglight.shots.kept.checkpoint import Checkpoint, alone, header_of

BUSY = "another run is writing it; expected one run for each output."


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images, a stage of theirs, and an array of lights."""
    folder = tmp_path_factory.mktemp("alone")
    sky_files.write_sequence(folder / "in")
    words = ["--preset", "live", "--lobes", "2"]
    assert main(["fit", str(folder / "in"), "-o", str(folder / "sky.usda"), *words]) == 0
    lights = np.array([[0, 1, 0, 5, 1, 1, 1]], np.float32)
    np.save(folder / "lights.npy", lights)
    return folder


@pytest.fixture
def here(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


WRITERS = (
    "keys sky.usda --reference in -o out.usda",
    "stitch sky.usda -o out.usda",
    "resample sky.usda --fps 48 -o out.usda",
    "export sky.usda --to dome -o out.usda",
    "import lights.npy --from physg -o out.usda",
)


@pytest.mark.parametrize("command", WRITERS)
def test_what_a_fit_writes_is_written_by_no_other_command(here, capsys, command) -> None:
    with Checkpoint(here / "out.usda.checkpoint", header_of({"frames": [1]}), resume=False):
        before = contents(here)
        assert main(command.split()) == 2
        error = capsys.readouterr().err.splitlines()
        assert error[-1].startswith("asglight: out.usda: another run is writing it; expected one")
        assert contents(here) == before
    assert main(command.split()) == 0
    assert not (here / "out.usda.checkpoint").exists()


@pytest.mark.parametrize("command", ["keys sky.usda --reference in", "export sky.usda --to dome"])
def test_nor_is_the_stage_itself(here, capsys, command) -> None:
    with Checkpoint(here / "sky.usda.checkpoint", header_of({"frames": [1]}), resume=False):
        assert main(command.split()) == 2
        assert BUSY in capsys.readouterr().err


def test_a_fit_waits_for_no_other_command_either(here, capsys) -> None:
    with alone("sky.usda"):
        assert main(["fit", "in", "-o", "sky.usda"]) == 2
    assert BUSY in capsys.readouterr().err


def test_the_checkpoint_of_a_fit_that_was_killed_stays(here) -> None:
    checkpoint = here / "out.usda.checkpoint"
    checkpoint.write_bytes(b"kept")
    assert main(WRITERS[1].split()) == 0
    assert checkpoint.read_bytes() == b"kept"
    checkpoint.unlink()
    assert main(WRITERS[1].split()) == 0
    assert not checkpoint.exists()


@pytest.mark.parametrize("output", ["no/out.usda", "out\0.usda", "."])
def test_where_nothing_can_be_locked_the_write_says_why_it_cannot_be(here, output) -> None:
    before = contents(here)
    with alone(output):
        pass
    assert contents(here) == before
