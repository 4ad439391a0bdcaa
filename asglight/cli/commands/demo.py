# SPDX-License-Identifier: Apache-2.0
"""`asglight demo`: the whole way on the built-in moving environment, ending in pictures."""

import argparse
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from asglight.cli.commands import evaluate, fit
from asglight.cli.folders import made_folder
from asglight.cli.options.parser import add_json_option
from asglight.cli.printing import print_json
from asglight.cli.progress import Reporter, reporter
from asglight.images import Sequence, open_sequence, write_exr
from asglight.judging.metrics import SequenceErrors
from asglight.lobes import LobeTracks, texels
from asglight.shots import fit_shot
from asglight.shots.kept.checkpoint import SUFFIX
from asglight.sky import SkyConfig, radiance

EXAMPLE = "asglight demo -o demo-output"
ON_INTERRUPT = "interrupted; run it again to go on"

CONFIG = SkyConfig()
HEIGHT = 256
"""Rows of the sequence: those that a fit works on."""

TITLE = "built-in environment"
SHEET_FRAMES = 6
BALL_FRAMES = 4
"""Frames that fit on one picture and can still be read."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `demo`."""
    folder = "folder to write into (default: %(default)s)"
    parser.add_argument("-o", "--output", metavar="DIR", default="demo-output", help=folder)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make the sequence, fit it, judge it, draw it, and list what was written."""
    folder = made_folder(Path(arguments.output))
    made_folder(folder / "sky")
    with reporter() as report:
        sequence = write_sky(folder, report)
        stage = folder / "demo.usda"
        result = fit_shot(sequence.pattern, stage, resume=True, on_progress=report)
        errors = evaluate.judge(
            evaluate.map_of_lobes(result.tracks), sequence, sequence.frames, report
        )
        draw(folder, result.tracks, sequence, errors, report)
    files = written_files(folder, sequence)
    document = fit.as_document(result, str(stage))
    if arguments.json:
        print_json({"files": files, "fit": document, "errors": evaluate.as_json(errors)})
        return 0
    listed = [f"{path}: {meaning}" for path, meaning in files.items()]
    text = [evaluate.errors_table(errors), "", *fit.summary_lines(document), "", *listed]
    print("\n".join(text))
    return 0


def write_sky(folder: Path, report: Reporter) -> Sequence:
    """Write the frames of the environment as OpenEXR and return them as a sequence.

    An interrupted demo goes on with the frames that its checkpoint knows; otherwise all are made
    again, so that a newer asglight shows its own environment.
    """
    goes_on = (folder / f"demo.usda{SUFFIX}").exists()
    for frame in report.follow(CONFIG.frames, "drawing the environment", len(CONFIG.frames)):
        path = folder / "sky" / f"sky.{frame:04d}.exr"
        if not (goes_on and path.exists()):
            write_exr(path, radiance(CONFIG, frame, HEIGHT))
    pattern = folder / "sky" / "sky.####.exr"
    return open_sequence(pattern, frames=f"{CONFIG.frames[0]}-{CONFIG.frames[-1]}")


def draw(
    folder: Path,
    tracks: LobeTracks,
    sequence: Sequence,
    errors: SequenceErrors,
    report: Reporter,
) -> None:
    """Write the contact sheet and the balls."""
    pictures = (draw_contact_sheet, draw_balls)
    for picture in report.follow(pictures, "drawing the pictures", len(pictures)):
        picture(folder, tracks, sequence, errors)


def draw_contact_sheet(
    folder: Path, tracks: LobeTracks, sequence: Sequence, errors: SequenceErrors
) -> None:
    """Write the environment, its lobes and the difference at some frames."""
    from asglight.judging.pictures.figures import contact_sheet  # loads matplotlib

    frames = spread(tracks.frames, SHEET_FRAMES)
    references, fits = maps_at(frames, tracks, sequence)
    lobes = tracks.lobes[[tracks.frames.index(frame) for frame in frames]]
    numbers = {
        name: [errors.frames[frame][name] for frame in frames] for name in ("env", "irr", "r0.5")
    }
    path = folder / "contact-sheet.png"
    contact_sheet(path, frames, references, fits, lobes, TITLE, errors=numbers)


def draw_balls(
    folder: Path, tracks: LobeTracks, sequence: Sequence, errors: SequenceErrors
) -> None:
    """Write balls of five roughnesses under the environment and under the lobes."""
    from asglight.judging.pictures.figures import ball_sheet  # loads matplotlib
    from asglight.shading.balls import ROUGHNESS, render_balls

    frames = spread(tracks.frames, BALL_FRAMES)
    references, fits = maps_at(frames, tracks, sequence)
    reference_balls, fit_balls = render_balls(torch.cat([references, fits])).split(len(frames))
    ball_sheet(folder / "balls.png", frames, ROUGHNESS, reference_balls, fit_balls, TITLE)


def spread(frames: tuple[int, ...], count: int) -> tuple[int, ...]:
    """Return at most `count` frames, evenly from the first to the last."""
    count = min(count, len(frames))
    if count == 1:
        return frames[:1]
    return tuple(frames[round(i * (len(frames) - 1) / (count - 1))] for i in range(count))


def maps_at(
    frames: tuple[int, ...], tracks: LobeTracks, sequence: Sequence
) -> tuple[Tensor, Tensor]:
    """Return the references and the fits of some frames.  [K, H, W, 3] each."""
    references = torch.stack([sequence.read(frame).radiance for frame in frames])
    height, width = references.shape[1:3]
    fits = [texels.texel_means(tracks.at(frame), height, width) for frame in frames]
    return references, torch.stack(fits)


def written_files(folder: Path, sequence: Sequence) -> dict[str, Any]:
    """Return what was written, with what each file is."""
    fill = folder / "demo_dome"
    broad = {str(fill): "the images of its broad lobes"} if fill.is_dir() else {}
    return {
        sequence.pattern: f"the environment, {len(sequence)} frames",
        str(folder / "demo.usda"): "the lights: open it in usdview, Blender or Houdini",
        **broad,
        str(folder / "contact-sheet.png"): "environment, lobes and difference over time",
        str(folder / "balls.png"): "balls of five roughnesses under the environment and the lights",
    }
