# SPDX-License-Identifier: Apache-2.0
"""Frames of one call on several threads: the same bits, from any thread and in a copied process."""

import ctypes
import multiprocessing
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch
from lobe_cases import alike, noise, target
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import newton
from asglight.lobes import Form, Lobes
from asglight.threads import frames_on, one_thread

pytestmark = pytest.mark.skipif(compiled.LIBRARY is None, reason="there is no C compiler")

FRAMES = 7


def _ends(threads: int, on_step: Callable[[Lobes], None] | None = None) -> list[Tensor]:
    """Return what five steps on so many threads come to."""
    lobes, frame = alike(Form.ASG, 5, tuple(range(FRAMES))), target(noise(64, FRAMES), 32, 4)
    with frames_on(threads):
        found = newton.minimise(lobes, frame, 5, tolerance=0.0, on_step=on_step)
    return [found.value, found.damping, found.lobes.axes, found.lobes.amplitude]


def _is_same(found: list[Tensor], other: list[Tensor]) -> bool:
    return all(map(torch.equal, found, other))


@pytest.mark.parametrize("threads", [2, 3, 64])
def test_the_number_of_threads_changes_no_bit(threads: int) -> None:
    alone = _ends(1)
    for _ in range(20):
        assert _is_same(_ends(threads), alone)
    assert _is_same(_ends(threads, on_step=lambda _: None), alone)


def _helpers() -> int:
    names = [task / "comm" for task in Path("/proc/self/task").iterdir()]
    return sum(name.read_text().strip() == "asglight-step" for name in names)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="the system lists no threads")
def test_helpers_are_named_and_three_at_most_and_stay() -> None:
    for _ in range(5):  # each call starts one at most
        _ends(64)
    assert _helpers() == 3
    _ends(1)
    assert _helpers() == 3


def test_calls_from_several_threads_share_the_helpers() -> None:
    alone = _ends(1)
    together = threading.Barrier(4, timeout=60)

    def call(_: int) -> bool:
        together.wait()
        return all(_is_same(_ends(3), alone) for _ in range(10))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(call, range(4)))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not copied on this system")
def test_a_copied_process_takes_steps_without_the_helpers_of_the_first() -> None:
    alone = _ends(1)
    assert _is_same(_ends(2), alone)
    copied = multiprocessing.get_context("fork")
    queue = copied.SimpleQueue()
    process = copied.Process(target=lambda: queue.put(_is_same(_ends(2), alone)))
    process.start()
    process.join(60)
    assert process.exitcode == 0
    assert queue.get()


def test_a_fit_takes_as_many_threads_as_torch_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    real = compiled.frame_threads
    monkeypatch.setattr(compiled, "frame_threads", lambda: seen.append(real()) or real())
    sky = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        lobes = fit_frame(sky, FitOptions(4, Preset.LIVE), None).lobes
        seen.clear()
        fit_frame(sky.flip(1), FitOptions(4, Preset.LIVE), lobes)
        assert set(seen) == {2}
        with one_thread():  # as who measures
            seen.clear()
            fit_frame(sky.flip(1), FitOptions(4, Preset.LIVE), lobes)
            assert set(seen) == {1}
    finally:
        torch.set_num_threads(before)


def test_a_call_that_is_interrupted_leaves_the_smallest_numbers_to_others() -> None:
    smallest = float.fromhex("0x1p-1074")
    with pytest.raises(ctypes.ArgumentError):
        compiled._call("asglight_probe", *["no pointer"] * 7)
    assert (smallest * 1.0).hex() == "0x0.0000000000001p-1022"


def _resident() -> float:
    """Return the memory of this process, in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system tells no memory")
def test_a_thread_that_ends_leaves_no_memory() -> None:
    def one_after_the_other(threads: int) -> None:
        for _ in range(threads):
            with ThreadPoolExecutor(1) as pool:
                pool.submit(_ends, 1).result()

    one_after_the_other(10)
    before = _resident()
    one_after_the_other(60)
    assert _resident() - before < 120  # of 370 that so many threads take; what torch keeps varies
