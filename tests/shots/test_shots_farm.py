# SPDX-License-Identifier: Apache-2.0
"""Shots on a Dask cluster: what one machine writes by hand, whatever happens on the way."""

import contextlib
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cloudpickle
import dask.config
import distributed
import dying_worker
import farm_files
import loaded
import pytest

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.shots import fit_shot
from asglight.shots.events import Event, Farmed, Notice
from asglight.shots.parts import chunks, farm
from asglight.shots.parts.chunks import Shot
from asglight.shots.parts.joining import join

LIVE = FitOptions(lobes=3, preset=Preset.LIVE)
CHUNK = 8
FRAMES = range(1001, 1025)
PARTS = ("1001-1010", "1007-1018", "1015-1024")
"""Three parts of 24 frames: 8 each and 2 more at each side of a seam."""


@pytest.fixture(scope="module", autouse=True)
def other_cluster() -> Iterator[None]:
    """Take the port on which Dask shows a cluster, as another cluster on this machine does."""
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # another program has it: as well
            taken.bind(("", 8787))
            taken.listen()
        yield


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    loaded.context()
    forks = {"distributed.worker.multiprocessing-method": "forkserver"}
    with (
        dask.config.set(forks),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as cluster,
    ):
        for nanny in cluster.workers.values():
            nanny.instantiate = stay_away
        yield cluster.scheduler_address


async def stay_away() -> None:
    """Start no worker in the place of one that was killed: it would load all once more."""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return farm_files.write_shot(tmp_path_factory.mktemp("images") / "sky", FRAMES)


@pytest.fixture(scope="module")
def by_hand(source: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the stage of the same parts, fitted one after the other and joined without Dask."""
    folder = tmp_path_factory.mktemp("hand")
    files = [str(folder / f"part.{frames}.usdc") for frames in PARTS]
    for frames, file in zip(PARTS, files, strict=True):
        fit_shot(source, file, replace(LIVE, preroll=1001), frames=frames)
    join(files, str(folder / "shot.usda"))
    return (folder / "shot.usda").read_bytes()


def shot(source: Path, output: Path, **changes: object) -> Shot:
    return replace(Shot(str(source), str(output), LIVE), **changes)  # pyright: ignore


def on_farm(
    source: Path, output: Path, address: str, on_progress: Callable[[Event], None], **options: bool
) -> None:
    stages = farm.fit_on_farm(
        [shot(source, output)], address, chunk=CHUNK, on_progress=on_progress, **options
    )
    assert stages == [str(output)]


def test_a_run_goes_on_where_an_interrupted_one_stopped(
    source: Path, by_hand: bytes, address: str, tmp_path: Path
) -> None:
    output = tmp_path / "shot.usda"

    def interrupt(event: Event) -> None:
        if isinstance(event, Farmed) and event.finished:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        on_farm(source, output, address, interrupt)
    kept = next((tmp_path / "shot.usda.parts").glob("*.done"))  # two may end at once
    before = kept.with_suffix(".usdc").stat().st_mtime_ns
    again: list[Event] = []

    def look(event: Event) -> None:
        if not again:
            assert kept.with_suffix(".usdc").stat().st_mtime_ns == before
        again.append(event)

    on_farm(source, output, address, look, resume=True)
    first = again[0]
    assert isinstance(first, Farmed)
    assert first.done >= 10  # of the part that was finished
    assert f"sky {kept.stem.removeprefix('part.')}" not in {
        event.finished for event in again if isinstance(event, Farmed)
    }
    assert output.read_bytes() == by_hand


def test_several_shots_at_once_from_the_command_line(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A shot of one part is what `asglight fit` writes."""
    short = farm_files.write_shot(tmp_path / "short", range(1, 6), seed=1)
    long = farm_files.write_shot(tmp_path / "long", range(1, 13), seed=2)
    (tmp_path / "out").mkdir()
    options = ["--lobes", "3", "--preset", "live"]
    words = ["fit", str(short), str(long), "-o", str(tmp_path / "out"), *options]
    assert main([*words, "--scheduler", address, "--chunk", "8"]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0].startswith(f"{tmp_path}/out/short.usdc: ")
    assert lines[0].endswith(" lobes, 5 frames (1-5) at 24 fps, from 1 part")
    assert lines[1].endswith("from 2 parts")
    assert "short 1-5 finished" in err
    assert main(["fit", str(short), "-o", str(tmp_path / "short.usdc"), *options]) == 0
    one, other = tmp_path / "short.usdc", tmp_path / "out" / "short.usdc"
    assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "long.usdc",
        "short.usdc",
    ]


def test_a_worker_without_the_images_is_named(
    source: Path, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Elsewhere(chunks.Parts):
        """Parts whose images only this process finds."""

        def _part(self, frames: tuple[int, ...], first: int | None) -> chunks.Part:
            part = super()._part(frames, first)
            return replace(part, shot=replace(part.shot, source="/nowhere/sky.####.exr"))

    monkeypatch.setattr(farm, "Parts", Elsewhere)
    with pytest.raises(InputError, match=r"^worker on \S+: /nowhere/sky.*; expected"):
        farm.fit_on_farm([shot(source, tmp_path / "x.usda")], address)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_with_another_version_is_named(
    source: Path, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(farm, "__version__", "99.0")
    with pytest.raises(InputError, match=r"^worker on \S+: has asglight .*; expected asglight 99"):
        farm.fit_on_farm([shot(source, tmp_path / "x.usda")], address)


def test_a_machine_without_asglight_passes_tasks_on_and_says_what_it_lacks() -> None:
    task = cloudpickle.dumps(farm._carrier())
    code = (
        "import pickle, sys; sys.modules['asglight'] = None\n"
        f"run = pickle.loads({task!r})\n"
        "try: run('1.0', b'', None)\n"
        "except ImportError as error: print(error)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "has no asglight; expected asglight 1.0" in result.stdout


def test_a_part_that_kills_its_workers_is_told() -> None:
    error = distributed.KilledWorker("x", None, 3)
    run = farm._Run.__new__(farm._Run)
    run._distributed, run._address = distributed, "tcp://farm:8786"
    future = SimpleNamespace(status="error", exception=lambda: error)
    assert "sky 1-5: every worker that took it died; expected" in str(
        run._failure(future, "sky 1-5")
    )
    gone = SimpleNamespace(status="cancelled")
    assert "scheduler tcp://farm:8786: lost; expected" in str(run._failure(gone, "sky 1-5"))
    bug = ZeroDivisionError()
    assert run._failure(SimpleNamespace(status="error", exception=lambda: bug), "x") is bug


def test_no_scheduler_is_told(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(farm, "CONNECT_SECONDS", 0.2)
    with pytest.raises(InputError, match=r"^scheduler tcp://127.0.0.1:1: no answer \(.*; expected"):
        farm.fit_on_farm([shot(source, tmp_path / "x.usda")], "tcp://127.0.0.1:1")
    with pytest.raises(InputError, match=r"^scheduler nonsense://x: no answer"):
        farm.fit_on_farm([shot(source, tmp_path / "x.usda")], "nonsense://x")
    with pytest.raises(InputError, match=r"^scheduler: local:0; expected local or"):
        farm.fit_on_farm([shot(source, tmp_path / "x.usda")], "local:0")
    assert list(tmp_path.iterdir()) == []


FAULTS = [
    ("fit SKY SKY -o x.usda", "input: 2 sequences; expected one, or several with a scheduler"),
    ("fit SKY -o x.usda --chunk 20", "chunk: 20 without a scheduler; expected both or neither"),
    ("fit SKY -o x.usda --scheduler local --chunk 3", "chunk: 3; expected at least 8 frames"),
    ("fit SKY SKY -o x.usda --scheduler local", "x.usda: is no folder; expected one to write 2"),
    ("fit SKY SKY -o . --scheduler local", "would write sky.usdc as "),
    ("fit SKY -o x.usda --scheduler local --preroll 1001", "preroll: 1001 with a scheduler"),
]


@pytest.mark.parametrize(("words", "message"), FAULTS)
def test_a_fault_is_one_line(
    words: str,
    message: str,
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.replace("SKY", str(source)).split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert list(tmp_path.iterdir()) == []


def test_without_dask_the_extra_is_named(
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["fit", str(source), "-o", str(tmp_path / "x.usda"), "--scheduler", "local"]) == 2
    assert "pip install 'asglight[farm]'" in capsys.readouterr().err


def test_the_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--help"]) == 0
    out = capsys.readouterr().out
    assert "--scheduler tcp://farm:8786 --resume" in out
    assert "--preroll 1001" in out


def test_a_worker_that_is_killed_costs_nothing(
    source: Path, by_hand: bytes, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the last test of the cluster, which has one worker from here on."""
    events: list[Event] = []
    take = farm._Run._take

    def take_and_tell(run: farm._Run, news: dict[str, Any]) -> None:
        take(run, news)
        dying_worker.told(tmp_path / "shot.usda.parts", news)

    monkeypatch.setattr(farm._Run, "_take", take_and_tell)
    monkeypatch.setattr(farm, "_fit", dying_worker.fit)
    on_farm(source, tmp_path / "shot.usda", address, events.append)
    assert [event for event in events if isinstance(event, Notice) and "begun again" in event.text]
    assert (tmp_path / "shot.usda").read_bytes() == by_hand
    done = [event for event in events if isinstance(event, Farmed)]
    assert (done[-1].done, done[-1].frames) == (32, 32)  # 10 + 12 + 10 frames
    finished = {event.finished for event in done if event.finished}
    assert finished == {f"sky {part}" for part in PARTS}
    assert {path.name for path in tmp_path.iterdir()} == {"shot.usda"}
