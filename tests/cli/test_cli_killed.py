# SPDX-License-Identifier: Apache-2.0
"""A fit that is killed at any moment, and resumed, writes the bytes of an unbroken one."""

import os
import signal
import time
from pathlib import Path

import pytest
import sky_files
from forked import Forks

from asglight.cli.main import main

OPTIONS = ("--lobes", "2", "--representations", "cards,dome", "--dome-height", "16")

KILL = (
    "import os, signal\nfrom asglight.shots.kept import checkpoint\nseen = []\n"
    # a shell's background jobs ignore it, and their children do
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
)
AFTER_FRAME = KILL + (
    "append = checkpoint.Checkpoint.append\n"
    "def kill(self, record):\n"
    "    append(self, record)\n"
    "    if len(self.records) == {frames}: os.kill(os.getpid(), signal.{signal})\n"
    "checkpoint.Checkpoint.append = kill"
)
WITHIN_LINE = KILL + (
    "write = checkpoint.write_all\n"
    "def kill(stream, data):\n"
    "    seen.append(data)\n"
    "    if len(seen) == {frames}:\n"
    "        stream.write(data[:{bytes}])\n"
    "        os.kill(os.getpid(), signal.SIGKILL)\n"
    "    write(stream, data)\n"
    "checkpoint.write_all = kill"
)
BEFORE_RENAME = KILL + (
    "replace = os.replace\n"
    "def kill(source, target):\n"
    "    if str(target) == sys.argv[4]: os.kill(os.getpid(), signal.SIGKILL)\n"
    "    replace(source, target)\n"
    "os.replace = kill"
)
BEFORE_REMOVAL = KILL + (
    "checkpoint.Checkpoint.remove = lambda self: os.kill(os.getpid(), signal.SIGKILL)"
)
MOMENTS = {
    "after the first frame": AFTER_FRAME.format(frames=1, signal="SIGKILL"),
    "after the second frame": AFTER_FRAME.format(frames=2, signal="SIGKILL"),
    "after the last frame": AFTER_FRAME.format(frames=3, signal="SIGKILL"),
    "within the header": WITHIN_LINE.format(frames=1, bytes=30),
    "within the second frame": WITHIN_LINE.format(frames=2, bytes=100),
    "before the newline": WITHIN_LINE.format(frames=3, bytes=-1),
    "before the stage is renamed": BEFORE_RENAME,
    "before the checkpoint is removed": BEFORE_REMOVAL,
}


@pytest.fixture(scope="module")
def forks(tmp_path_factory: pytest.TempPathFactory) -> Forks:
    """Return what starts the fits that are killed."""
    return Forks(tmp_path_factory.mktemp("said"))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sky_files.write_sequence(tmp_path_factory.mktemp("source") / "in", range(1, 4))


@pytest.fixture(scope="module")
def unbroken(source: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return every file of an unbroken run by its path."""
    folder = tmp_path_factory.mktemp("unbroken")
    assert main(["fit", str(source), "-o", str(folder / "shot.usda"), *OPTIONS]) == 0
    return files(folder)


def files(folder: Path) -> dict[str, bytes]:
    """Return every file by its path, but for the hidden folders of writers that were killed."""
    names = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in names.items() if name[0] != "."}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_killed_and_resumed_fit_is_the_unbroken_one(
    forks: Forks, source: Path, unbroken: dict[str, bytes], tmp_path: Path, moment: str
) -> None:
    fit = ("fit", source, "-o", tmp_path / "shot.usda", *OPTIONS)
    killed = forks.run(*fit, hook=MOMENTS[moment])
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert main([str(word) for word in (*fit, "--resume")]) == 0
    assert files(tmp_path) == unbroken


def test_a_fit_killed_from_outside_and_resumed_is_the_unbroken_one(
    forks: Forks, tmp_path: Path
) -> None:
    source = sky_files.write_sequence(tmp_path / "in", range(1, 7))
    outputs = [tmp_path / name / "shot.usda" for name in ("whole", "killed")]
    for output in outputs:
        output.parent.mkdir()
    words = [["fit", str(source), "-o", str(output), "--lobes", "2"] for output in outputs]
    assert main(words[0]) == 0
    process = forks.begin(*words[1])
    checkpoint = outputs[1].with_name("shot.usda.checkpoint")
    give_up = time.monotonic() + 60
    while not (checkpoint.exists() and checkpoint.read_bytes().count(b"\n") > 2):
        assert time.monotonic() < give_up
        assert not outputs[1].exists()
        time.sleep(0.002)
    os.kill(process, signal.SIGKILL)
    assert forks.end().returncode == -signal.SIGKILL
    assert not outputs[1].exists()
    assert main([*words[1], "--resume"]) == 0
    assert outputs[1].read_bytes() == outputs[0].read_bytes()


def test_an_interrupted_fit_keeps_its_checkpoint(
    forks: Forks, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit = ("fit", source, "-o", tmp_path / "shot.usda", *OPTIONS)
    hook = AFTER_FRAME.format(frames=2, signal="SIGINT")
    stopped = forks.run(*fit, hook=hook)
    assert stopped.returncode == 130
    assert stopped.stderr.splitlines()[-1] == "asglight: interrupted; resume with --resume."
    assert "Traceback" not in stopped.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["shot.usda.checkpoint"]
    assert main([str(word) for word in (*fit, "--resume")]) == 0
    assert "resumed: 2 frames from an earlier run" in capsys.readouterr().out


def test_a_disk_that_fills_up_is_one_line_and_the_fit_resumes(
    forks: Forks, source: Path, unbroken: dict[str, bytes], tmp_path: Path
) -> None:
    fit = ("fit", source, "-o", tmp_path / "shot.usda", *OPTIONS)
    # bytes a file may have: the header and the first frame fit, the second frame does not
    hook = (
        "import resource\nfrom asglight.shots.kept import checkpoint\n"
        "append = checkpoint.Checkpoint.append\n"
        "def limited(self, record):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (1200, 1200))\n"
        "    append(self, record)\n"
        "checkpoint.Checkpoint.append = limited"
    )
    stopped = forks.run(*fit, hook=hook)
    assert stopped.returncode == 2
    *frames, last = stopped.stderr.splitlines()
    assert all(line.startswith("frame ") for line in frames)
    assert "shot.usda.checkpoint: cannot be written (File too large)" in last
    assert main([str(word) for word in (*fit, "--resume")]) == 0
    assert files(tmp_path) == unbroken


def test_a_second_fit_of_the_same_output_is_refused(
    forks: Forks, source: Path, tmp_path: Path
) -> None:
    from asglight.shots.kept.checkpoint import Checkpoint, header_of

    with Checkpoint(tmp_path / "shot.usda.checkpoint", header_of({}), resume=False):
        second = forks.run("fit", source, "-o", tmp_path / "shot.usda")
    assert second.returncode == 2
    assert "shot.usda: another run is writing it" in second.stderr
    assert second.stderr.count("\n") == 1
