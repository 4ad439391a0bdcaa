# SPDX-License-Identifier: Apache-2.0
"""What cutting a shot into parts costs: three parts, stitched, beside one fit of all frames.

    python -m benchmarks.shots.parts ../shared/sequences/day --preset fast

Parts are thirds that share four frames, fitted with `--preroll` and without. Errors are means over
all frames as `asglight eval` prints them, jumps as benchmarks/fits/__main__.py counts them. A lobe
goes on if it has more than 1 % of the flux in the frames before and after those that two parts
share; each seam says how many of those that have it before do.
"""

import argparse
import contextlib
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import torch

from asglight.cli.main import main as asglight
from asglight.cli.printing import counted
from asglight.fitting.options import Preset
from asglight.images.sequence import open_sequence
from asglight.judging.following import JUMP_SHARE, jumps
from asglight.judging.metrics import frame_errors, sequence_errors
from asglight.lobes import LobeTracks
from asglight.lobes.identity.matching import flux_shares
from asglight.usd import read_usd
from benchmarks.given import refused_in_a_line

PARTS = 3
OVERLAP = 4
"""Frames that neighbours share, as docs/guides/farms.md asks."""

PRESETS = (Preset.LIVE, Preset.FAST, Preset.BEST)
"""`paper` takes a shot as one part."""


class Range(NamedTuple):
    """First and last frame of a part."""

    first: int
    last: int


def main(argv: Sequence[str] | None = None) -> int:
    """Fit one sequence in each way, print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.shots.parts", description=__doc__)
    parser.add_argument("sequence", metavar="DIR", help="a sequence of latlong maps")
    parser.add_argument("--preset", choices=PRESETS, default=Preset.FAST, help="(fast)")
    options = parser.parse_args(argv)
    with refused_in_a_line(parser):
        frames = list(open_sequence(options.sequence).frames)
    if len(frames) < PARTS * OVERLAP:
        parser.error(
            f"{options.sequence}: {counted(len(frames), 'frame')}; expected {PARTS * OVERLAP} or "
            "more. Give a longer sequence."
        )
    ranges = cut(frames)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        whole = _fitted(options, folder / "whole.usdc", Range(frames[0], frames[-1]), [])
        shots = {"one fit": read_usd(str(whole))}
        ways = {"parts": ["--preroll", str(frames[0])], "parts from nothing": []}
        for number, (name, words) in enumerate(ways.items()):
            shots[name] = _stitched(options, folder / str(number), ranges, words)
    ends = [frames.index(before.last) for before in ranges[:-1]]
    seams = [(frames[end - OVERLAP], frames[end + 1]) for end in ends]
    rows = [row(name, tracks, options.sequence, seams) for name, tracks in shots.items()]
    head = "| fit | irr | r0.5 | r0.25 | flicker | jumps | lobes | go on |"
    print("\n".join([head, "|---|" + "--:|" * 7, *rows]))
    return 0


def cut(frames: Sequence[int]) -> list[Range]:
    """Return parts of about the same length, of which neighbours share `OVERLAP` frames."""
    half = OVERLAP // 2
    inner = [round(len(frames) * part / PARTS) for part in range(1, PARTS)]
    starts = [0, *(place - half for place in inner)]
    ends = [*(place + half for place in inner), len(frames)]
    return [Range(frames[a], frames[b - 1]) for a, b in zip(starts, ends, strict=True)]


def _fitted(options: argparse.Namespace, output: Path, part: Range, words: Sequence[str]) -> Path:
    job = [options.sequence, "--frames", f"{part.first}-{part.last}", "-o", str(output)]
    _done(["fit", *job, "--preset", options.preset, *words])
    return output


def _stitched(
    options: argparse.Namespace, folder: Path, ranges: Sequence[Range], words: Sequence[str]
) -> LobeTracks:
    folder.mkdir()
    parts = [
        str(_fitted(options, folder / f"part{number}.usdc", part, words))
        for number, part in enumerate(ranges)
    ]
    output = str(folder / "shot.usdc")
    _done(["stitch", *parts, "-o", output])
    return read_usd(output)


def _done(words: list[str]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        status = asglight([*words, "--json"])
    if status:
        raise SystemExit(status)


def row(name: str, tracks: LobeTracks, sequence: str, seams: Sequence[tuple[int, int]]) -> str:
    """Judge a shot, return its row.

    Args:
        name: Of the fit.
        tracks: Its lobes.
        sequence: What was fitted.
        seams: Last frame before and first frame after those that two parts share.
    """
    images = open_sequence(sequence)
    pairs = (
        (frame, frame_errors(tracks.at(frame), images.read(frame).radiance))
        for frame in tracks.frames
    )
    mean = sequence_errors(pairs).mean
    lobes = [tracks.at(frame) for frame in tracks.frames]
    errors = [f"{mean[metric]:.4f}" for metric in ("irr", "r0.5", "r0.25", "flicker")]
    went_on = [going_on(tracks, *seam) for seam in seams]
    told = ", ".join(f"{stays} of {lit}" for stays, lit in went_on)
    cells = [name, *errors, str(jumps(lobes)), str(tracks.lobes.count), told]
    return f"| {' | '.join(cells)} |"


def going_on(tracks: LobeTracks, before: int, after: int) -> tuple[int, int]:
    """Return how many of the lobes lit in one frame are lit in a later one, and how many there are.

    Args:
        tracks: The shot.
        before: The one frame.
        after: The later one.
    """
    lit, stays = (flux_shares(tracks.at(frame)) > JUMP_SHARE for frame in (before, after))
    return int((lit & stays).sum()), int(torch.count_nonzero(lit))


if __name__ == "__main__":
    raise SystemExit(main())
