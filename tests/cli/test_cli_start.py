# SPDX-License-Identifier: Apache-2.0
"""What a command loads before it has something to do: no fitter to read, no library to wait for."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import sky_files
from usd_tracks import moving

from asglight.usd import write_usd

MODULES = """\
import json, sys
from asglight.cli.main import main
status = main(sys.argv[2:])
open(sys.argv[1], "w").write(json.dumps([status, sorted(sys.modules)]))
"""
FITTER = ("asglight.fitting", "asglight.shots.job", "scipy.optimize")


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "shot.usda"
    write_usd(moving((1001, 1002)), path)
    return path


def loaded(folder: Path, *words: str) -> set[str]:
    """Run a command in a process of its own and return the modules that it loaded."""
    answer = folder / "modules.json"
    subprocess.run([sys.executable, "-c", MODULES, str(answer), *words], check=True)
    status, modules = json.loads(answer.read_text())
    assert status == 0
    return set(modules)


def begins(modules: set[str], *names: str) -> set[str]:
    return {name for name in modules if name.startswith(names)}


@pytest.mark.parametrize("said", [None, "ACTIVE"])
def test_threads_that_wait_sleep_unless_the_user_says_otherwise(
    said: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenMP reads it when torch is loaded; it prints what it goes by."""
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    if said:
        monkeypatch.setenv("OMP_WAIT_POLICY", said)
    monkeypatch.setenv("OMP_DISPLAY_ENV", "TRUE")
    code = "from asglight.cli.main import main; main(['info', 'x.usda']); import torch"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert f"OMP_WAIT_POLICY = '{said or 'PASSIVE'}'" in run.stderr


@pytest.mark.parametrize(("said", "threads"), [(None, 1), ("2", 2)])
def test_matrices_of_numpy_are_on_one_thread_unless_the_user_says_otherwise(
    said: str | None, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenBLAS reads it when NumPy is loaded, and says how many it goes by."""
    libraries = [*Path(np.__file__).parents[1].glob("numpy.libs/libscipy_openblas64_*")]
    if not libraries or len(os.sched_getaffinity(0)) < 2:
        pytest.skip("NumPy without its own OpenBLAS, or one core")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    if said:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", said)
    code = (
        "import ctypes, sys\nfrom asglight.cli.main import main\n"
        "main(['info', 'x.usda'])\nimport numpy\n"
        "print(ctypes.CDLL(sys.argv[1]).scipy_openblas_get_num_threads64_())"
    )
    words = [sys.executable, "-c", code, str(libraries[0])]
    run = subprocess.run(words, capture_output=True, text=True, check=True)
    assert run.stdout.split() == [str(threads)]


def test_help_of_all_loads_no_numbers(tmp_path: Path) -> None:
    modules = loaded(tmp_path, "--help")
    assert not begins(modules, "torch", "numpy", "scipy", "pxr", "OpenImageIO", "rich", "fileseq")


@pytest.mark.parametrize(
    "words",
    [
        ["info", "STAGE"],
        ["export", "STAGE", "--to", "json", "-o", "OUT.json"],
        ["export", "STAGE", "--to", "glsl", "-o", "OUT.glsl"],
        ["export", "STAGE", "--to", "nerd", "-o", "OUT.npy"],
        ["export", "STAGE", "--to", "distant", "-o", "OUT.usda"],
        ["view", "--help"],
    ],
    ids=lambda words: "-".join(words[:4:2]),
)
def test_who_reads_a_stage_loads_no_fitter(words: list[str], stage: Path, tmp_path: Path) -> None:
    put = {"STAGE": str(stage)}
    names = [put.get(word, word.replace("OUT", str(tmp_path / "out"))) for word in words]
    assert begins(loaded(tmp_path, *names), *FITTER, "moderngl", "matplotlib") == set()


def test_the_session_of_a_stage_loads_no_fitter(stage: Path) -> None:
    code = (
        "import sys; from asglight.cli.sources.opening import Request, opened; "
        f"opened(Request(input={str(stage)!r})).close(); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.split())
    assert "asglight.viewer.state.session" in modules
    assert begins(modules, *FITTER) == set()


def test_the_options_of_a_fit_load_neither_scipy_nor_usd() -> None:
    code = "import asglight.cli.commands.fit, sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.split())
    assert "torch" in modules
    late = ("scipy", "pxr", "rich", "matplotlib", "torch._dynamo")
    assert begins(modules, *late) == set()


def test_a_fit_starts_its_decoder_before_it_loads_torch(tmp_path: Path) -> None:
    source = sky_files.write_frame(tmp_path / "a.exr", sky_files.sky(0))
    code = (
        "import sys\n"
        "from asglight.images.decoding import decoders\n"
        "start = decoders.Apart\n"
        "def noted(module):\n"
        "    print('torch' in sys.modules)\n"
        "    return start(module)\n"
        "decoders.Apart = noted\n"
        "from asglight.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    words = ["fit", str(source), "-o", str(tmp_path / "a.usda"), "--lobes", "2"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
    )
    # one process for the whole fit
    assert [line for line in done.stdout.splitlines() if line in ("True", "False")] == ["False"]
    assert done.stderr.count("\n") == 1  # the frame, and nothing about leaks at the end


def test_the_command_says_nothing_at_its_end(tmp_path: Path) -> None:
    """What is loaded without collections is collected in the end: OpenImageIO tells what is not."""
    source = sky_files.write_frame(tmp_path / "a.exr", sky_files.sky(0))
    words = ["fit", str(source), "-o", str(tmp_path / "a.usda"), "--lobes", "2"]
    code = "import sys; from asglight.cli.main import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
    )
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("frame 1 (1/1)")
