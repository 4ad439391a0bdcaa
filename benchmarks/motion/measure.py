# SPDX-License-Identifier: Apache-2.0
"""Measure motion: light between frames, light at the frames, and whether a lamp is one track.

    python -m benchmarks.motion.measure --sequences ../shared/sequences2x ../shared/sequences -o DIR

Every second frame of each sequence is fitted with each preset, written as a stage, read half-way
between its frames as USD interpolates it, and judged against the frame that was left out. Then all
frames are fitted and judged, beside lobes of EM that are fitted to each frame by itself. Tables go
to standard output, numbers to motion.json, the picture of each sequence to <sequence>.png.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from fileseq import framesToFrameRange

from asglight.cli.folders import write_text
from asglight.cli.options.parser import one_line
from asglight.cli.progress import Reporter, reporter
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT, LOBES, Preset
from asglight.images import open_sequence
from asglight.images import sequence as image_sequence
from asglight.images.message import shown
from asglight.judging.clock import timed
from asglight.judging.metrics import frame_errors, sequence_errors
from asglight.judging.motion import between, lamps
from asglight.lobes import LobeTracks
from asglight.peers import vmf_em
from asglight.shots import fit_sequence
from asglight.usd import read_usd, write_usd
from asglight.usd.read.between import read_between
from benchmarks.motion import picture, tables

PRESETS = (Preset.LIVE, Preset.FAST, Preset.BEST)
PASSAGES = 5
EXAMPLE = "example: make bench-motion"


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write and print; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.motion.measure",
        description=__doc__,
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--sequences", type=Path, nargs="+", required=True, metavar="DIR", help="of sequences")
    add("--presets", nargs="+", choices=PRESETS, default=PRESETS, type=Preset, help="(all)")
    add("--only", nargs="+", metavar="NAME", help="sequences by name (all)")
    add("--frames", type=int, metavar="N", help="the first N frames of each (all)")
    add("-o", "--output", type=Path, default=Path("bench-motion"), metavar="DIR")
    options = parser.parse_args(argv)
    try:
        found = measured(options)
    except (InputError, OSError) as error:
        print(f"bench-motion: {one_line(str(error))}", file=sys.stderr)
        return 2
    print(tables.tables(found))
    return 0


def measured(options: argparse.Namespace) -> dict[str, Any]:
    """Measure every sequence with every preset; write numbers and pictures after each sequence."""
    found: dict[str, Any] = {}
    options.output.mkdir(parents=True, exist_ok=True)
    with reporter() as report:
        for sequence in sequences_in(options.sequences, options.only):
            frames = sequence.frames[: options.frames]
            maps = {frame: sequence.read(frame).radiance for frame in frames}
            account, tracks = of_sequence(sequence, maps, options.presets, report)
            found[sequence.name] = account
            picture.draw(options.output / f"{sequence.name}.png", maps, tracks)
            text = json.dumps(found, indent=1)
            write_text(options.output / "motion.json", text + "\n")
    return found


def sequences_in(
    folders: Sequence[Path], only: Sequence[str] | None
) -> list[image_sequence.Sequence]:
    """Open the sequence in each folder of some folders.

    Raises:
        InputError: There is none.
    """
    inner = [path for folder in folders for path in sorted(folder.iterdir()) if path.is_dir()]
    chosen = [path for path in inner if only is None or path.name in only]
    if not chosen:
        raise InputError(f"{shown(folders[0])}: no sequence found; expected folders of images.")
    return [open_sequence(path, height=FIT_HEIGHT) for path in chosen]


def of_sequence(
    sequence: image_sequence.Sequence,
    maps: dict[int, torch.Tensor],
    presets: Sequence[Preset],
    report: Reporter,
) -> tuple[dict[str, Any], LobeTracks]:
    """Measure a sequence.

    Returns:
        Numbers by preset, and the tracks of every second frame of the last preset.
    """
    frames = list(maps)
    alone = [
        vmf_em.fit(radiance, LOBES) for radiance in report.follow(maps.values(), "EM", len(maps))
    ]
    em = at_frames(dict(zip(frames, alone, strict=True)), maps)
    passages = lamps.passages(list(maps.values()), PASSAGES)
    account: dict[str, Any] = {}
    for preset in presets:
        half, _ = timed(fit, sequence, frames[::2], preset)
        every, seconds = timed(fit, sequence, frames, preset)
        errors = at_frames({frame: every.at(frame) for frame in frames}, maps)
        followed = [lamps.followed(half, one, frames) for one in passages if one.last > one.first]
        account[preset.value] = {
            **between_frames(half, maps),
            "at_frames": errors,
            "flicker_over_em": errors["flicker"] / em["flicker"] if em["flicker"] else None,
            "seconds_per_frame": seconds["wall_seconds"] / len(frames),
            "cpu_seconds_per_frame": seconds["cpu_seconds"] / len(frames),
            "passages": [{"share": one.share, "frames": len(one.frames)} for one in followed],
        }
    return account, half


def fit(sequence: image_sequence.Sequence, frames: Sequence[int], preset: Preset) -> LobeTracks:
    """Fit some frames as `asglight fit` does; another process decodes them."""
    return fit_sequence(sequence.pattern, preset=preset, frames=framesToFrameRange(list(frames)))


def between_frames(tracks: LobeTracks, maps: dict[int, torch.Tensor]) -> dict[str, Any]:
    """Judge a fit of every second frame at the others, also as USD reads its stage."""
    times = between.left_out(tracks.frames, maps)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shot.usdc"
        written = write_usd(tracks, path)
        read, stage = read_usd(path), read_between(path, times)
        size = path.stat().st_size
    found = between.between_errors(read, times, maps.__getitem__, stage)
    return {
        "between": found.mean,
        "ratios": found.ratios,
        "samples": written.samples_written,
        "samples_between": written.samples_between,
        "bytes": size,
    }


def at_frames(lobes: dict[int, Any], maps: dict[int, torch.Tensor]) -> dict[str, float]:
    """Return the mean errors at the frames, and flicker."""
    return sequence_errors(
        (frame, frame_errors(one, maps[frame])) for frame, one in lobes.items()
    ).mean


if __name__ == "__main__":
    sys.exit(main())
