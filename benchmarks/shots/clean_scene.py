# SPDX-License-Identifier: Apache-2.0
r"""What a fit spends on what a clean scene does not need: processor time and calls of each part.

    python -m benchmarks.shots.clean_scene --still ../shared/hdri/esplanade.exr \
        --sequence ../shared/sequences/day

`asglight fit` runs in this process on one thread, everything loaded before. A part's time is that
of the thread which runs it (`time.thread_time`), what it calls included; the whole is that of the
process and of the one that decodes. Medians over repeats, so that other work on the machine says
little.
"""

import argparse
import contextlib
import importlib
import io
import os
import resource
import statistics
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import torch

from asglight.cli.main import main as asglight
from asglight.errors import InputError
from asglight.images import read_latlong, sequence
from asglight.images.decoding.decoders import APART, HERE
from benchmarks.given import positive, refused_in_a_line

PARTS: dict[str, tuple[str, ...]] = {
    "fit of the frames": ("asglight.fitting.sequence.fit_frame",),
    "second reading": ("asglight.shots.rounds.refined",),
    "repairs": ("asglight.images.repair.Tally.account",),
    "light, with its ridge": ("asglight.fitting.steps.light.solve_amplitudes",),
    "relocation": ("asglight.fitting.following.next_frame.relocated",),
    "wider sight for a lost lamp": ("asglight.fitting.following.initial_guess.re_detected",),
    "doubt: a fresh fit": ("asglight.fitting.following.next_frame.fit_first_frame",),
    "leaving out": ("asglight.shots.tracks.simplified",),
    "preroll": ("asglight.shots.rounds.start_of",),
    "checkpoint": (
        "asglight.shots.kept.checkpoint.Checkpoint.__init__",
        "asglight.shots.kept.checkpoint.Checkpoint.append",
        "asglight.shots.kept.checkpoint.Checkpoint.remove",
    ),
    "condition report": ("asglight.shots.job.with_condition",),
    "USD, with its lint": ("asglight.shots.job.write_stage",),
}
"""Where each part is looked up by who calls it. A part within another counts in both."""

WHOLE, OTHER = "all", "decoding, the process apart"

Taken = dict[str, tuple[int, float]]
"""Calls and seconds by part."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure each fit, print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.shots.clean_scene", description=__doc__
    )
    add = parser.add_argument
    add("--still", required=True, metavar="FILE", help="a clean map")
    add("--sequence", required=True, metavar="DIR", help="a clean sequence")
    add("--frames", type=positive, default=8, metavar="N", help="of it (default: %(default)s)")
    add("--repeats", type=positive, default=3, metavar="N", help="of each (default: %(default)s)")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)  # so that the thread that calls a part does all of its work
    with refused_in_a_line(parser):
        print(measured(options))
    return 0


def measured(options: argparse.Namespace) -> str:
    """Measure what the command line names; return its table, and a line of what decoding costs.

    Raises:
        InputError: The still or the sequence cannot be fitted.
    """
    first = sequence.open_sequence(options.sequence).frames[: options.frames]
    shot = [options.sequence, "--frames", f"{first[0]}-{first[-1]}"]
    fits = {
        f"{Path(options.still).stem}, fast": [options.still],
        f"{Path(options.sequence).name}, {len(first)} frames, fast": shot,
        f"{Path(options.sequence).name}, {len(first)} frames, live": [*shot, "--preset", "live"],
    }
    found = {}
    for name, words in fits.items():
        taken(words)  # loads what it needs, and prepares the grids
        found[name] = middle([taken(words) for _ in range(options.repeats)])
    return f"{table(found)}\n\n{decoding(options.still, options.repeats)}"


def taken(words: Sequence[str]) -> Taken:
    """Fit once; return what each part took.

    Raises:
        InputError: `asglight fit` refuses what it is given.
    """
    told = io.StringIO()
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder, timed() as calls:
        APART.close()
        before, children = time.process_time(), _children()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(told):
            status = asglight(["fit", *words, "-o", str(Path(folder) / "shot.usda"), "--json"])
        APART.close()
        own, other = time.process_time() - before, _children() - children
    if status == 2:
        raise InputError(told.getvalue().strip().splitlines()[-1].removeprefix("asglight: "))
    if status != 0:
        raise RuntimeError(f"asglight fit {' '.join(words)} ended with {status}")
    found = {part: (len(calls[part]), sum(calls[part])) for part in PARTS}
    return {WHOLE: (1, own + other), OTHER: (1, other)} | found


@contextlib.contextmanager
def timed() -> Iterator[dict[str, list[float]]]:
    """Note the seconds of each call of each part."""
    seconds: dict[str, list[float]] = defaultdict(list)
    with contextlib.ExitStack() as undo:
        for part, places in PARTS.items():
            for place in places:
                owner, name = owner_of(place)
                own = getattr(owner, name)
                undo.callback(setattr, owner, name, own)
                setattr(owner, name, _timed(own, seconds[part]))
        yield seconds


def owner_of(place: str) -> tuple[Any, str]:
    """Return the module or class of a dotted name, and the name in it."""
    *path, name = place.split(".")
    for length in range(len(path), 0, -1):
        with contextlib.suppress(ModuleNotFoundError):
            owner: Any = importlib.import_module(".".join(path[:length]))
            for each in path[length:]:
                owner = getattr(owner, each)
            return owner, name
    raise LookupError(place)


def _timed(call: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    def within(*arguments: Any, **named: Any) -> Any:
        begin = time.thread_time()
        try:
            return call(*arguments, **named)
        finally:
            seconds.append(time.thread_time() - begin)

    return within


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def middle(runs: Sequence[Taken]) -> Taken:
    """Return the calls of the first run and the median of the seconds."""
    return {
        part: (count, statistics.median(run[part][1] for run in runs))
        for part, (count, _) in runs[0].items()
    }


def table(found: dict[str, Taken]) -> str:
    """Return a row a part: milliseconds, share and calls in each fit."""
    lines = [f"| part | {' | '.join(found)} |", f"|---|{'---:|' * len(found)}"]
    for part in (WHOLE, OTHER, *PARTS):
        cells = []
        for fit in found.values():
            count, seconds = fit[part]
            share = 100 * seconds / fit[WHOLE][1]
            cells.append(f"{1e3 * seconds:.1f} ms, {share:.2f} %, {count}x" if count else "–")
        lines.append(f"| {part} | {' | '.join(cells)} |")
    return "\n".join(lines)


def decoding(path: str, repeats: int) -> str:
    """Say what it costs to decode a map in another process instead of in this one."""
    counted: Counter[str] = Counter()
    reads = 10 * repeats
    for name, decoder in (("here", HERE), ("apart", APART)):
        APART.close()
        begin, children = time.process_time(), _children()
        read_latlong(path, decoder=decoder)
        APART.close()
        once = time.process_time() - begin + _children() - children
        begin, children = time.process_time(), _children()
        for _ in range(reads):
            read_latlong(path, decoder=decoder)
        APART.close()
        every = time.process_time() - begin + _children() - children
        counted[name] = round(1e6 * (every - once) / (reads - 1))
        counted[f"{name}, once"] = round(1e6 * once)
    return (
        f"{os.path.basename(path)}: read here {counted['here'] / 1e3:.1f} ms, apart "
        f"{counted['apart'] / 1e3:.1f} ms an image, and {counted['apart, once'] / 1e3:.0f} ms for "
        "the first, with the start of the process"
    )


if __name__ == "__main__":
    raise SystemExit(main())
