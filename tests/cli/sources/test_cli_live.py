# SPDX-License-Identifier: Apache-2.0
"""The fit that runs in a process of its own while the viewer shows it."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import loaded
import processes
import pytest
import sky_files
import torch
from places import ROOT, SHARED, SUPPORT
from stand_in_fit import FRAMES, StandInJob

from asglight.cli.sources import live_source
from asglight.cli.sources.live_source import LiveJob, LiveSource
from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset
from asglight.images import open_sequence
from asglight.lobes import LobeTracks
from asglight.shots.events import ignore
from asglight.shots.frames import fit_frames

DAY = SHARED / "sequences" / "day"

Start = Callable[[LiveJob], LiveSource]


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts a fit; it is ended after the test."""
    sources: list[LiveSource] = []

    def started(job: LiveJob) -> LiveSource:
        sources.append(LiveSource(job))
        return sources[-1]

    yield started
    for source in sources:
        source.close()


@pytest.fixture
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let processes be forks that need not load torch; a signal is ignored by no fork."""
    monkeypatch.setattr(live_source.multiprocessing, "get_context", loaded.context)


@pytest.fixture
def job(tmp_path: Path) -> LiveJob:
    folder = sky_files.write_sequence(tmp_path / "in")
    return LiveJob((1001, 1002, 1003, 1004), str(folder), lobes=4, fps=25.0)


def polled(source: LiveSource, is_enough: Callable[[], bool]) -> list[LobeTracks]:
    """Return every news of a source until it is enough."""
    news: list[LobeTracks] = []

    def step() -> bool:
        enough = is_enough()  # before the poll, so that nothing is left unread
        tracks = source.poll()
        if tracks is not None:
            news.append(tracks)
        return enough

    processes.wait_until(step)
    return news


def check_same_as_direct(news: list[LobeTracks], job: LiveJob) -> None:
    """Compare all news, frame by frame, with a fit in this process."""
    assert job.source is not None
    wanted = f"{job.frames[0]}-{job.frames[-1]}"
    sequence = open_sequence(job.source, frames=wanted, height=FIT_HEIGHT)
    options = FitOptions(job.lobes, Preset.LIVE, moving=True)
    last = news[-1]
    assert last.frames == job.frames
    for k, record in enumerate(fit_frames(sequence, options, [], ignore)):
        lobes = record.lobes
        assert record.frame == last.frames[k]
        # The same arithmetic on the same numbers: not a bit differs.
        assert torch.equal(last.lobes.axes[k], lobes.axes)
        assert torch.equal(last.lobes.sharpness[k], lobes.sharpness)
        assert torch.equal(last.lobes.amplitude[k], lobes.amplitude)
    counts = [len(tracks.frames) for tracks in news]
    assert counts == sorted(set(counts))
    for tracks in news:
        assert tracks.frames == job.frames[: len(tracks.frames)]
        assert torch.equal(tracks.lobes.axes, last.lobes.axes[: len(tracks.frames)])


def test_lobes_are_those_of_a_direct_fit_and_ctrl_c_is_left_to_the_viewer(
    start: Start, job: LiveJob
) -> None:
    handler = signal.getsignal(signal.SIGINT)
    source = start(job)
    assert source.process.pid is not None
    os.kill(source.process.pid, signal.SIGINT)  # while it starts, as a terminal sends it to both
    assert signal.getsignal(signal.SIGINT) is handler
    assert source.status().message == "starting the fit"
    assert (source.status().frames_done, source.status().frames_total) == (0, 4)
    news = polled(source, lambda: source.status().is_finished)
    check_same_as_direct(news, job)
    assert news[-1].fps == 25.0
    status = source.status()
    assert (status.frames_done, status.failure) == (4, None)
    assert status.message == "all frames are fitted"
    assert source.poll() is None


@pytest.mark.usefixtures("forks")
@pytest.mark.skipif(not DAY.is_dir(), reason="needs ../shared/sequences/day")
def test_lobes_of_the_day_are_those_of_a_direct_fit(start: Start) -> None:
    job = LiveJob((1001, 1002), str(DAY))
    source = start(job)
    check_same_as_direct(polled(source, lambda: source.status().is_finished), job)


def test_closing_in_the_middle_leaves_no_process(start: Start) -> None:
    source = start(StandInJob(FRAMES, lobes=3))
    polled(source, lambda: source.status().frames_done > 0)
    pid = source.process.pid
    assert pid is not None
    assert processes.is_running(pid)
    source.close()
    assert not processes.is_running(pid)
    status = source.status()
    assert status.is_finished
    assert status.failure is None
    assert status.message == "the fit was ended"
    assert source.poll() is None
    source.close()


def test_closing_at_once_leaves_no_process(start: Start, job: LiveJob) -> None:
    source = start(job)
    source.close()
    assert source.process.pid is not None
    assert not processes.is_running(source.process.pid)


def test_a_killed_process_is_a_failure_and_keeps_its_frames(start: Start) -> None:
    source = start(StandInJob(FRAMES, lobes=3))
    news = polled(source, lambda: source.status().frames_done > 0)
    assert news[-1].frames[0] == 1001
    assert source.process.pid is not None
    os.kill(source.process.pid, signal.SIGKILL)
    polled(source, lambda: source.status().is_finished)
    status = source.status()
    assert status.failure == (
        "live fit: its process ended early (signal 9); expected it to reach the last frame. "
        "Is memory short? Start the viewer again."
    )
    assert status.frames_done >= 1
    assert status.message == ""


@pytest.mark.usefixtures("forks")
def test_a_bad_image_is_a_failure_after_the_frames_before_it(start: Start, job: LiveJob) -> None:
    assert job.source is not None
    (Path(job.source) / "sky.1003.exr").write_text("no image")
    source = start(job)
    news = polled(source, lambda: source.status().is_finished)
    assert news[-1].frames == (1001, 1002)
    failure = source.status().failure
    assert failure is not None
    assert "sky.1003.exr: " in failure
    assert "\n" not in failure


def test_a_bug_is_a_failure_that_asks_for_a_report(
    start: Start, capfd: pytest.CaptureFixture[str]
) -> None:
    source = start(StandInJob(FRAMES, lobes=0))  # which the command line refuses
    polled(source, lambda: source.status().is_finished)
    failure = source.status().failure
    assert failure is not None
    assert failure.startswith("live fit: ")
    assert failure.endswith(". This is a bug; please report it.")
    assert "Traceback" in capfd.readouterr().err


VIEWER = (
    "import time\nfrom asglight.cli.sources.live_source import LiveSource\n"
    "from stand_in_fit import FRAMES, StandInJob\n"
    "if __name__ == '__main__':\n"
    "    source = LiveSource(StandInJob(FRAMES, lobes=3))\n"
    "    print(source.process.pid, flush=True)\n"
    "    source._connection.poll(None)\n"  # without loading torch
    "    print('fitted', flush=True)\n"
    "    time.sleep(600)\n"
)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_the_fit_ends_with_a_viewer_that_is_killed(tmp_path: Path, how: signal.Signals) -> None:
    script = tmp_path / "viewer.py"
    script.write_text(VIEWER)
    path = os.pathsep.join(map(str, (ROOT, SUPPORT / "cases")))
    viewer = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
        # a shell's background jobs ignore it, and their children do
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert viewer.stdout is not None
    pid = int(viewer.stdout.readline())
    assert viewer.stdout.readline() == "fitted\n"
    viewer.send_signal(how)
    _, err = viewer.communicate(timeout=processes.PATIENCE)
    processes.wait_until(lambda: not processes.is_running(pid))
    assert err.count("Traceback") == (1 if how is signal.SIGINT else 0)  # of the viewer itself
