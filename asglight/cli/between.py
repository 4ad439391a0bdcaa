# SPDX-License-Identifier: Apache-2.0
"""`asglight eval --between`: how right a stage is between its frames, by leaving frames out."""

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fileseq import framesToFrameRange

from asglight.cli.frames import warn_of_unread
from asglight.cli.options.reading import read_options
from asglight.cli.printing import counted, table
from asglight.cli.progress import Reporter
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset, form_of
from asglight.images import Sequence, open_sequence
from asglight.images.message import shown
from asglight.judging.motion import between
from asglight.lobes import LobeTracks

EXPLANATION = """\
With --between: every second frame is left out, fitted without, and judged half-way between its
neighbours. stage: as a program interpolates the stage; rule: flux and log sharpness linear, turns
even; fits: the two fits dissolved; maps: the two images dissolved. (x): over that of the fits.
Lights that another program edited count in rule and fits, not in stage; where the stage has all
frames, and the others of them are fitted anew, nowhere."""

FRAMES_MIN = 3
"""One to leave out, between two."""


def document_of(arguments: argparse.Namespace, report: Reporter) -> dict[str, Any]:
    """Judge a stage between its frames.

    A stage whose frames leave out some of the reference's is judged at those. Otherwise every
    second frame is left out and the others are fitted anew, with the options of the stage.

    Raises:
        InputError: The stage cannot be fitted anew, or there are too few frames.
    """
    from asglight.usd import read_stage, read_usd

    reading = read_stage(arguments.stage, arguments.rig)
    warn_of_unread(arguments.stage, reading)
    tracks = reading.tracks
    sequence = open_sequence(
        arguments.reference,
        frames=arguments.frames,
        height=FIT_HEIGHT,
        reading=read_options(arguments),
    )
    times = between.left_out(tracks.frames, sequence.frames)
    if times:
        return _judged(arguments.stage, tracks, sequence, times, report, arguments.rig) | {
            "fitted_anew": False
        }
    frames = sequence.frames[::2]
    times = between.left_out(frames, sequence.frames)
    if len(sequence.frames) < FRAMES_MIN:
        raise InputError(
            f"{shown(arguments.reference)}: {counted(len(sequence.frames), 'frame')}; expected "
            f"{FRAMES_MIN} or more, to leave out one between two."
        )
    options = options_of(tracks.metadata, arguments.stage)
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        path = Path(folder) / "every-second.usdc"
        _fit(sequence, frames, path, options, report)
        found = _judged(path, read_usd(path), sequence, times, report)
    return found | {"fitted_anew": True}


def options_of(metadata: Mapping[str, Any], stage: str) -> FitOptions:
    """Return the settings with which a stage was fitted.

    Raises:
        InputError: It was not fitted.
    """
    try:
        return FitOptions(
            lobes=int(metadata["lobes"]),
            preset=Preset(metadata["preset"]),
            form=form_of(metadata["form"]),
            seed=int(metadata["seed"]),
            paper_steps=tuple(metadata["paper_steps"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{shown(stage)}: does not say how it was fitted; expected a stage of asglight fit. "
            "Or give one that was fitted to every second frame of the reference: "
            "asglight fit INPUT --frames 1001-1047x2 -o STAGE."
        ) from error


def _fit(
    sequence: Sequence,
    frames: tuple[int, ...],
    path: Path,
    options: FitOptions,
    report: Reporter,
) -> None:
    from asglight.shots import fit_shot

    fit_shot(
        sequence.pattern,
        path,
        options,
        frames=framesToFrameRange(frames),
        reading=sequence.reading,
        on_progress=report,
    )


def _judged(
    path: str | Path,
    tracks: LobeTracks,
    sequence: Sequence,
    times: tuple[int, ...],
    report: Reporter,
    rig: str | None = None,
) -> dict[str, Any]:
    from asglight.usd.read.between import read_between

    found = between.between_errors(
        tracks,
        report.follow(times, "judging between frames", len(times)),
        lambda frame: sequence.read(frame).radiance,
        read_between(path, times, rig),
    )
    return {
        "left_out": list(times),
        "mean": found.mean,
        "ratios": found.ratios,
        "frames": [{"frame": time} | errors for time, errors in found.times.items()],
    }


def between_table(document: Mapping[str, Any]) -> str:
    """Return the errors of each way as a table, and below it what was judged."""
    rows = []
    for way, errors in document["mean"].items():
        ratios = document["ratios"].get(way)
        cells = []
        for name in between.METRICS:
            over = "" if ratios is None else f" ({ratios[name]:.2f})"
            cells.append(f"{errors[name]:.4f}{over or '       '}")
        rows.append([way, *cells])
    count = counted(len(document["left_out"]), "frame")
    anew = ", the others fitted anew" if document["fitted_anew"] else ""
    text = table(["between", *(f"{name}       " for name in between.METRICS)], rows)
    return f"{text}\nmean of {count} left out{anew}"
