# SPDX-License-Identifier: Apache-2.0
"""`asglight fit`: fit an image or sequence and write the lobes as USD lights."""

import argparse
from typing import Any, get_args

from asglight.cli import farm
from asglight.cli.condition import condition_lines
from asglight.cli.leaving_out import left_out_lines
from asglight.cli.options.key_options import add_key_options, key_lines, key_options, with_keys
from asglight.cli.options.parser import (
    add_follow_option,
    add_input_options,
    add_json_option,
    frame_rate,
    step_pair,
)
from asglight.cli.options.reading import read_options
from asglight.cli.options.stage_options import OUTPUT, add_stage_options, given_stage_options
from asglight.cli.printing import counted, duration, frame_range, percent, print_json, size
from asglight.cli.progress import reporter
from asglight.cli.repairs import repair_line
from asglight.errors import InputError
from asglight.fitting.options import (
    FORM_NAMES,
    LOBES,
    MAX_LOBES,
    FitOptions,
    Preset,
    form_of,
)
from asglight.images import ocio
from asglight.images.account import image_line
from asglight.images.sequence import Missing
from asglight.shots import ShotResult, fit_shot
from asglight.shots.tracks import repairs_of
from asglight.usd.options import Representation, StageOptions

EXAMPLE = f"""asglight fit sky.####.exr -o sky.usda --frames 1001-1048 --resume
names kept: asglight fit sky.####.exr -o sky.v2.usdz --names-from sky.v1.usdz --colorspace ACEScg
elsewhere: asglight fit sky.####.exr -o sky.usdc --primary-path /World/Lights/Env --up-axis Z
part of a shot: asglight fit sky.####.exr -o part.2.usdc --frames 1045-1096 --preroll 1001
Dask: {farm.EXAMPLE}"""
MADE = (
    "live: while the shot plays; fast; best: slower, steadier where lamps rush past; paper: as "
    "published in 2024 (default: %(default)s)"
)

ON_INTERRUPT = "interrupted; resume with --resume"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fit`."""
    add = parser.add_argument
    default = FitOptions()
    source = "image file, folder, or pattern such as sky.####.exr; several with --scheduler"
    add("input", nargs="+", metavar="INPUT", help=source)
    stage = f"{OUTPUT}; with several inputs, the folder of their stages"
    add("-o", "--output", required=True, metavar="STAGE", help=stage)
    add("--lobes", type=int, metavar="N", help=f"number of lobes (default: {LOBES})")
    fewest = (
        "in place of --lobes: the fewest with which irr and r0.5 of every frame stay at or below"
    )
    add("--tolerance", type=float, metavar="ERROR", help=f"{fewest} this, such as 0.02")
    most = f"lobes at most, with --tolerance (default: {MAX_LOBES})"
    add("--max-lobes", type=int, metavar="N", help=most)
    presets = [str(preset) for preset in Preset]
    add("--preset", choices=presets, default=str(default.preset), help=MADE)
    better = "asg, or flat or sg if a still is better so"
    function = f"lobe function; auto: {better} (default: %(default)s)"
    add("--form", choices=FORM_NAMES, default=str(default.form), help=function)
    add_input_options(parser)
    part = "the shot's first frame, if --frames is a part of it: parts then have the same lobes"
    add("--preroll", type=int, metavar="FRAME", help=part)
    missing = "what stands in for a missing or damaged frame (default: %(default)s, which stops)"
    add("--missing", choices=get_args(Missing), default="error", help=missing)
    rate = "frames per second of the stage, such as 24 or 24000/1001 (default: 24)"
    add("--fps", type=frame_rate, default=24.0, help=rate)
    resume = "go on where an interrupted run stopped; without it, a run starts afresh"
    add("--resume", action="store_true", help=resume)
    add("--device", default=default.device, help="cpu, cuda or cuda:1 (default: %(default)s)")
    add("--seed", type=int, default=default.seed, help="of random starts (default: %(default)s)")
    first, following = default.paper_steps
    steps = f"steps of --preset paper (default: {first},{following})"
    add("--paper-steps", type=step_pair, metavar="FIRST,NEXT", help=steps)
    farm.add_arguments(parser)
    add_json_option(parser)
    add_stage_options(parser)
    add_key_options(parser, usual=None)
    names = "stage of an earlier fit whose lights keep their names (default: the one written over)"
    add("--names-from", metavar="STAGE", help=names)
    add_follow_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fit, write, and say what was written."""
    options = options_from(arguments)
    keys = key_options(arguments)
    if arguments.scheduler is not None:
        return farm.run(arguments, options, keys)
    source = farm.one_input(arguments)
    with reporter() as report:
        result = fit_shot(
            source,
            arguments.output,
            options,
            frames=arguments.frames,
            fps=arguments.fps,
            missing=arguments.missing,
            reading=read_options(arguments),
            stage=StageOptions(
                **with_keys(given_stage_options(arguments), keys, StageOptions.representations)
            ),
            keys=keys,
            names_from=arguments.names_from,
            resume=arguments.resume,
            on_progress=report,
        )
    document = as_document(result, arguments.output)
    if arguments.json:
        print_json(document)
    else:
        print("\n".join(summary_lines(document)))
    return 0


def options_from(arguments: argparse.Namespace) -> FitOptions:
    """Return the settings of the fit.

    Raises:
        InputError: An option would have no effect.
    """
    preset = Preset(arguments.preset)
    steps = arguments.paper_steps
    if steps is not None and preset is not Preset.PAPER:
        raise InputError(
            f"paper steps: given with --preset {preset}, which has none; expected --preset paper."
        )
    return FitOptions(
        lobes=arguments.lobes,
        preset=preset,
        form=form_of(arguments.form),
        seed=arguments.seed,
        device=arguments.device,
        paper_steps=steps or FitOptions().paper_steps,
        tolerance=arguments.tolerance,
        max_lobes=arguments.max_lobes,
        preroll=arguments.preroll,
    )


def as_document(result: ShotResult, output: str) -> dict[str, Any]:
    """Return a finished shot as JSON values."""
    frames = [
        {
            "frame": record.frame,
            "loss": record.loss,
            "flux_error": record.flux_error,
            "seconds": record.seconds,
            "repair": record.repair.sentence(),
            "repeats": record.repeats,
        }
        for record in result.records
    ]
    metadata = result.tracks.metadata
    with_tolerance = ("tolerance", "tolerance_met", "worst_errors")
    return {
        "output": output,
        "bytes": result.written.bytes,
        "lobes": result.tracks.lobes.count,
        "fitted_lobes": metadata["lobes"],
        "left_out": metadata["left_out"],
        **(
            {name: metadata[name] for name in with_tolerance} if "tolerance_met" in metadata else {}
        ),
        "preset": metadata["preset"],
        "form": str(result.tracks.lobes.form),
        "representations": list(result.representations),
        "colorspace": result.colorspace,
        "fps": result.tracks.fps,
        "resumed": result.resumed,
        "seconds": sum(record.seconds for record in result.records),
        "ill_conditioned": metadata["ill_conditioned"],
        "repairs": repairs_of({record.frame: record.repair for record in result.records}),
        "image": metadata["image"],
        **({"keys": result.keys} if result.keys is not None else {}),
        "frames": frames,
    }


def summary_lines(document: dict[str, Any]) -> list[str]:
    """Return a finished shot as the few lines a user reads."""
    frames = document["frames"]
    worst = max(frames, key=lambda row: abs(row["flux_error"]))
    numbers = frame_range([row["frame"] for row in frames])
    lines = [
        f"{document['output']}: {counted(document['lobes'], 'lobe')} of form {document['form']}, "
        f"{counted(len(frames), 'frame')} ({numbers}) at {document['fps']:g} fps, "
        f"{size(document['bytes'])}, fitted in {duration(document['seconds'])}",
        written_line(document),
        f"flux error: at most {percent(worst['flux_error'])} (frame {worst['frame']})",
    ]
    if document["resumed"]:
        lines.append(f"resumed: {counted(document['resumed'], 'frame')} from an earlier run")
    lines += key_lines(document.get("keys"))
    lines += left_out_lines({**document, "lobes": document["fitted_lobes"]})
    lines += condition_lines(document["ill_conditioned"])
    lines += [image_line(document["image"]), repair_line(document["repairs"])]
    return [line for line in lines if line]


def written_line(document: dict[str, Any]) -> str:
    """Return what the lobes were written as, and how the images of a dome come to be."""
    held = document["representations"]
    line = f"written as: {', '.join(held)}"
    if document["colorspace"] != ocio.NAMES[ocio.REC709]:
        line += f", in {document['colorspace']}"
    if Representation.DOME in held:
        return line
    return f"{line}; images of a dome on demand: asglight export {document['output']} --to dome"
