# SPDX-License-Identifier: Apache-2.0
"""What a command loads before it has something to do: no fitter to read, no library to wait for.

What is loaded stays, so one process answers for a whole row of commands.
"""

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import sky_files
import torch
from usd_tracks import moving

from asglight.usd import write_usd

FITTER = ("asglight.fitting", "asglight.shots.job", "scipy.optimize")
VARIABLES = ("OMP_NUM_THREADS", "OMP_WAIT_POLICY", "OPENBLAS_NUM_THREADS")
GOMP = [*Path(torch.__file__).parent.glob("lib/libgomp*")]
OPENBLAS = [*Path(np.__file__).parents[1].glob("numpy.libs/libscipy_openblas64_*")]

READERS = {
    "info": ["info", "STAGE"],
    "export-json": ["export", "STAGE", "--to", "json", "-o", "OUT.json"],
    "export-glsl": ["export", "STAGE", "--to", "glsl", "-o", "OUT.glsl"],
    "export-nerd": ["export", "STAGE", "--to", "nerd", "-o", "OUT.npy"],
    "export-distant": ["export", "STAGE", "--to", "distant", "-o", "OUT.usda"],
    "view": ["view", "--help"],
}
"""Commands in the order in which one process runs them."""

READ = """\
import json, sys
from asglight.cli.main import main
answer, stage, commands = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
found = {}
for name, words in commands.items():
    found[name] = main(words), sorted(sys.modules)
from asglight.cli.sources.opening import Request, opened
opened(Request(input=stage)).close()
found["session"] = 0, sorted(sys.modules)
open(answer, "w").write(json.dumps(found))
"""
THREADS = """
import ctypes, numpy, sys
library = ctypes.CDLL(sys.argv[-1])
print(library.scipy_openblas_get_num_threads64_())
"""
FIT = """\
import sys, threading
import asglight
from asglight.cli import main as cli
from asglight.images.decoding import decoders
start, load = decoders.Apart, cli._load

def started(module):
    print('decoder:', 'torch' in sys.modules)
    return start(module)

def loaded(name, command):
    load(name, command)
    print('options:', *sys.modules)
    print('threads:', sys.modules['torch'].get_num_threads(), threading.active_count())
    asglight.fit_sequence
    print('python:', 'pxr' in sys.modules)

decoders.Apart, cli._load = started, loaded
status = cli.main()
print('threads:', sys.modules['torch'].get_num_threads(), threading.active_count())
sys.exit(status)
"""
WRITER = """\
import sys
from asglight.fitting.options import FitOptions, Preset
from asglight.shots.events import FrameDone
from asglight.shots.job import fit_shot

def told(event):
    if isinstance(event, FrameDone):
        print(event.frame, 'asglight.usd.write.stage_file' in sys.modules)

fit_shot(*sys.argv[1:], FitOptions(2, Preset.LIVE), on_progress=told)
"""


@dataclass(frozen=True)
class Loaded:
    """What a process says.

    Attributes:
        modules: Those that are loaded after each command.
        out: On standard output.
        err: On standard error.
    """

    modules: dict[str, set[str]]
    out: str
    err: str


def environment(**said: str) -> dict[str, str]:
    """Return the variables of a user who has said this about threads; OpenMP prints them."""
    others = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return {**others, "OMP_DISPLAY_ENV": "VERBOSE", **said}


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> Loaded:
    """Read a stage with one command after the other, in a process of their own."""
    folder = tmp_path_factory.mktemp("readers")
    stage, answer = folder / "shot.usda", folder / "modules.json"
    write_usd(moving((1001, 1002)), stage)
    put = {"STAGE": str(stage)}
    commands = {
        name: [put.get(word, word.replace("OUT", str(folder / "out"))) for word in words]
        for name, words in READERS.items()
    }
    code = READ + (THREADS if OPENBLAS else "")
    words = [answer, stage, json.dumps(commands), *OPENBLAS[:1]]
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        check=True,
        env=environment(),
    )
    found = json.loads(answer.read_text())
    assert {name: status for name, (status, _) in found.items()} == dict.fromkeys(found, 0)
    modules = {name: set(loaded) for name, (_, loaded) in found.items()}
    return Loaded(modules, done.stdout, done.stderr)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Loaded:
    """Fit a frame as the command does."""
    folder = tmp_path_factory.mktemp("fit")
    source = sky_files.write_frame(folder / "a.exr", sky_files.sky(0))
    words = ["fit", str(source), "-o", str(folder / "a.usda"), "--lobes", "2"]
    done = subprocess.run(
        [sys.executable, "-c", FIT, *words], capture_output=True, text=True, check=True
    )
    (options,) = (line for line in done.stdout.splitlines() if line.startswith("options: "))
    return Loaded({"options": set(options.split()[1:])}, done.stdout, done.stderr)


@pytest.fixture(scope="module")
def outspoken() -> Loaded:
    """Load the libraries of numbers after a command of a user who has said all about threads."""
    load = "import ctypes, sys; ctypes.CDLL(sys.argv[1])" if GOMP else "import torch"
    code = f"from asglight.cli.main import main; main(['--version']); {load}"
    words = [*GOMP[:1], *OPENBLAS[:1]]
    done = subprocess.run(
        [sys.executable, "-c", code + (THREADS if OPENBLAS else ""), *words],
        capture_output=True,
        text=True,
        check=True,
        env=environment(OMP_WAIT_POLICY="ACTIVE", OPENBLAS_NUM_THREADS="2"),
    )
    return Loaded({}, done.stdout, done.stderr)


def begins(modules: set[str], *names: str) -> set[str]:
    return {name for name in modules if name.startswith(names)}


def test_threads_that_wait_sleep_unless_the_user_says_otherwise(
    readers: Loaded, outspoken: Loaded
) -> None:
    """OpenMP reads it when torch is loaded. Untold, it says PASSIVE as well, and spins a while."""
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in readers.err
    assert set(re.findall(r"GOMP_SPINCOUNT = '(\d+)'", readers.err)) == {"0"}
    assert "OMP_WAIT_POLICY = 'ACTIVE'" in outspoken.err


@pytest.mark.skipif(
    not OPENBLAS or len(os.sched_getaffinity(0)) < 2,
    reason="NumPy without its own OpenBLAS, or one core",
)
def test_matrices_of_numpy_are_on_one_thread_unless_the_user_says_otherwise(
    readers: Loaded, outspoken: Loaded
) -> None:
    """OpenBLAS reads it when NumPy is loaded, and says how many it goes by."""
    assert readers.out.splitlines()[-1] == "1"
    assert outspoken.out.splitlines()[-1] == "2"


def test_help_of_all_loads_no_numbers() -> None:
    code = (
        "import sys; from asglight.cli.main import main; "
        "status = main(['--help']); print(*sys.modules); sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.splitlines()[-1].split())
    assert "asglight.cli.main" in modules
    assert not begins(modules, "torch", "numpy", "scipy", "pxr", "OpenImageIO", "rich", "fileseq")


@pytest.mark.parametrize("name", READERS)
def test_who_reads_a_stage_loads_no_fitter(name: str, readers: Loaded) -> None:
    assert begins(readers.modules[name], *FITTER, "moderngl", "matplotlib") == set()


def test_the_session_of_a_stage_loads_no_fitter(readers: Loaded) -> None:
    modules = readers.modules["session"]
    assert "asglight.viewer.state.session" in modules
    assert begins(modules, *FITTER) == set()


def test_the_options_of_a_fit_load_no_decoder_nor_scipy_nor_usd_nor_a_window(fit: Loaded) -> None:
    modules = fit.modules["options"]
    assert "torch" in modules
    late = ("scipy", "pxr", "rich", "matplotlib", "torch._dynamo", "distributed", "dask")
    late += ("OpenImageIO", "OpenEXR", "PyOpenColorIO")  # the process that decodes has them
    assert begins(modules, *late, "moderngl", "imgui_bundle") == set()


def test_fitting_from_python_loads_no_usd(fit: Loaded) -> None:
    assert "python: False" in fit.out.splitlines()


def test_a_fit_starts_its_decoder_before_it_loads_torch(fit: Loaded) -> None:
    # one process for the whole fit
    decoders = [line for line in fit.out.splitlines() if line.startswith("decoder: ")]
    assert decoders == ["decoder: False"]


def test_a_fit_makes_its_tables_on_another_thread_while_its_options_are_loaded(
    fit: Loaded,
) -> None:
    lines = [line.split()[1:] for line in fit.out.splitlines() if line.startswith("threads: ")]
    (allowed, beside), (after, left) = (map(int, line) for line in lines)
    assert beside == min(allowed, 2)  # the other cores are for what waits for them
    assert (after, left) == (allowed, 1)


def test_what_writes_the_stage_is_loaded_after_the_first_frame(tmp_path: Path) -> None:
    """The next frames are read meanwhile, and nothing waits for it after the last."""
    for number in (1, 2):
        sky_files.write_frame(tmp_path / f"a.{number}.exr", sky_files.sky(number))
    words = [str(tmp_path / "a.#.exr"), str(tmp_path / "a.usda")]
    done = subprocess.run(
        [sys.executable, "-c", WRITER, *words], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["1 False", "2 True"]


def test_the_command_says_nothing_at_its_end(fit: Loaded) -> None:
    """What is loaded without collections is collected in the end: OpenImageIO tells what is not."""
    assert fit.err.count("\n") == 1
    assert fit.err.startswith("frame 1 (1/1)")
