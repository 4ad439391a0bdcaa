# SPDX-License-Identifier: Apache-2.0
"""`asglight export`: a stage's lobes for engines and peers; more representations of a stage."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from asglight.cli.frames import chosen_frames, warn_of_unread
from asglight.cli.options.parser import (
    add_follow_option,
    add_reading_options,
    add_rig_option,
    file_name,
)
from asglight.cli.options.reading import given, read_options
from asglight.cli.printing import counted, frame_range, size
from asglight.errors import InputError
from asglight.export import SgLayout
from asglight.images.message import shown
from asglight.lobes import Form, Lobes, LobeTracks
from asglight.usd.options import OF_LOBES, Representation

if TYPE_CHECKING:
    from asglight.images import Sequence

EXAMPLE = (
    "asglight export shot.usda --to glsl --frame 1001 -o environment.glsl\n"
    "         asglight export shot.usda --to physg --frame 1001 -o lights.npy\n"
    "         asglight export shot.usda --to gltf -o lights.glb\n"
    "         asglight export shot.usda --to html --reference sky.####.exr -o shot.html\n"
    "         asglight export shot.usda --to dome"
)

HTML = "html"
GLTF = "gltf"

_OTHER_FILES = (".usd", ".usda", ".usdc", ".usdz", ".exr", ".hdr", ".f32")
"""Suffixes of what is surely meant to be kept: stages, images, blocks of frames."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `export`."""
    add = parser.add_argument
    add("stage", metavar="STAGE", help="a stage that asglight has written")
    formats = (
        "json: lobe tracks as data, keys and rest too; "
        "glsl: functions that shade with the lobes, or with keys if the stage shows these, as an "
        "include; "
        "gltf: directional lights that move, as a .glb file; "
        "html: a page that needs nothing else, with balls, map and timeline; "
        "physg, nerd: the .npy array of spherical Gaussians that the program reads, [N, 7] of one "
        "frame, [F, N, 7] of several; cards, distant, dome: the stage with this representation too"
    )
    kinds = ("json", "glsl", GLTF, HTML, *map(str, SgLayout), *map(str, OF_LOBES))
    add("--to", required=True, choices=kinds, help=formats)
    target = "file to write; of a representation a stage (default: STAGE itself)"
    add("-o", "--output", type=lambda text: Path(file_name(text)), metavar="FILE", help=target)
    frames = (
        "frames, such as 1001 or 1001-1048 (default: all); glsl of one frame has the lobes as "
        "constants, of several as a uniform block that FILE with the suffix .f32 fills"
    )
    add("--frames", "--frame", metavar="RANGE", help=frames)
    reference = "images that the page of html shows beside the lobes, with the errors"
    add("--reference", metavar="INPUT", help=reference)
    add_reading_options(parser)
    add_rig_option(parser)
    add_follow_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read a stage, write what was asked for and say what it is."""
    if arguments.to in set(Representation):
        return _represent(arguments)
    if arguments.output is None:
        raise InputError(f"output: none for {arguments.to}; expected a file. Add -o FILE.")
    output: Path = arguments.output
    _check_output(output, arguments.to)
    _check_reference(arguments)
    from asglight.cli.progress import reporter
    from asglight.cli.sources.keyed_light import keyed_light
    from asglight.export import write_glsl, write_gltf, write_json, write_sg_array
    from asglight.usd import read_stage
    from asglight.usd.stage import representations_of

    reading = read_stage(arguments.stage, arguments.rig)
    every = reading.tracks
    tracks = _of_frames(every, chosen_frames(every, arguments.frames, arguments.stage))
    files, written = [output], tracks.lobes
    said = f"{counted(written.count, 'lobe')} of form {written.form}"
    shows, _ = representations_of(arguments.stage, arguments.rig)
    is_keyed = shows == Representation.KEYS
    keyed = None
    if arguments.to == "json" or (arguments.to == "glsl" and is_keyed):
        with reporter() as report:
            keyed = keyed_light(arguments.stage, arguments.rig, tracks.frames, report)
    key_count = 0 if keyed is None or keyed.keys is None else keyed.keys.lobes.count
    if arguments.to == "json":
        write_json(output, tracks, tracks.names, keyed)
        said += "" if keyed is None else f", {counted(key_count, 'key')} and a rest"
    elif arguments.to == "glsl" and keyed is not None:
        files = write_glsl(output, keyed.lit_tracks, keyed.irradiance)
        said = f"{counted(key_count, 'key')} and a rest"
    elif arguments.to == "glsl":
        files = write_glsl(output, tracks)
    elif arguments.to == GLTF:
        write_gltf(output, tracks, tracks.names)
    elif arguments.to == HTML:
        _write_page(arguments, tracks)
    else:
        written = write_sg_array(output, tracks, SgLayout(arguments.to))
        said = f"{counted(written.count, 'lobe')} of form {written.form}"
    numbers = tracks.frames
    print(
        f"{', '.join(shown(file) for file in files)}: "
        f"{said}, "
        f"{counted(len(numbers), 'frame')} ({frame_range(numbers)}) at {tracks.fps:g} fps, "
        f"{size(sum(file.stat().st_size for file in files))}"
    )
    if written is not tracks.lobes:
        _print_loss(tracks.lobes, written)
    if arguments.to == SgLayout.NERD:
        _print_misfit(written)
    warn_of_unread(arguments.stage, reading)
    return 0


def _check_reference(arguments: argparse.Namespace) -> None:
    """Refuse options of a reference where there is none."""
    asked = {"--reference": arguments.reference} if arguments.to != HTML else {}
    asked |= given(read_options(arguments)) if arguments.reference is None else {}
    for option, value in asked.items():
        if value is not None:
            needed = "--to html" if option == "--reference" else "--reference"
            raise InputError(f"{option}: {shown(value)} without {needed}; expected both, or none.")


def _write_page(arguments: argparse.Namespace, tracks: LobeTracks) -> None:
    """Write a page, with its reference where one was asked for."""
    from asglight.cli.inputs import lit
    from asglight.cli.progress import reporter
    from asglight.page.html import page_balls, write_page
    from asglight.page.reference import reference_of

    reference = None
    if arguments.reference is not None:
        sequence = _reference(arguments, tracks)
        with reporter() as report:
            maps = (lit(sequence, frame) for frame in tracks.frames)
            followed = report.follow(maps, "reference", len(tracks.frames))
            name = shown(Path(sequence.pattern).name)
            reference = reference_of(name, followed, tracks, page_balls())
    write_page(arguments.output, tracks, shown(Path(arguments.stage).name), reference)


def _reference(arguments: argparse.Namespace, tracks: LobeTracks) -> "Sequence":
    """Find the images of the frames of a stage.

    Raises:
        InputError: Some are missing.
    """
    from asglight.fitting.options import FIT_HEIGHT
    from asglight.images import open_sequence

    return open_sequence(
        arguments.reference,
        frames=frame_range(tracks.frames),
        height=FIT_HEIGHT,
        reading=read_options(arguments),
    )


def _represent(arguments: argparse.Namespace) -> int:
    """Write a stage with one more representation and say what it holds."""
    if arguments.frames is not None:
        raise InputError(
            f"frames: {shown(arguments.frames)} with --to {arguments.to}, which is of all frames; "
            "expected none."
        )
    from asglight.shots.kept.checkpoint import alone
    from asglight.usd import add_representations
    from asglight.usd.read.read_options import read_options as stage_options

    with alone(arguments.output or arguments.stage):
        report = add_representations(arguments.stage, [arguments.to], arguments.output)
    target = report.files[0]
    held = ", ".join(stage_options(target).representations)
    count = counted(len(report.files) - 1, "image")
    print(f"{shown(target)}: {held}; {count}, {size(report.bytes)}")
    return 0


def _print_loss(lobes: Lobes, written: Lobes) -> None:
    """Say on one line what lobes lose in an array, if anything.  [F, N, .], [F, N', .]."""
    from asglight.export.sg_array import NERD_SHARPNESS
    from asglight.judging.metrics import irradiance_errors
    from asglight.lobes.isotropic import as_sg

    findings = []
    if lobes.form is not Form.SG:
        stretched = int((lobes.sharpness[..., 0] != lobes.sharpness[..., 1]).any(0).sum())
        findings.append(f"{stretched} of {counted(lobes.count, 'lobe')} lost their anisotropy")
    held = int((as_sg(lobes).sharpness != written.sharpness).any(-1).any(0).sum())
    if held:
        low, high = NERD_SHARPNESS
        limits = f"NeRD's sharpness, {low:g} to {high:g}"
        findings.append(f"{held} of {counted(written.count, 'lobe')} held to {limits}")
    if findings:
        errors = irradiance_errors(written, lobes)
        worst = f" in the mean, {100 * max(errors):.2f} % in the worst frame"
        print(
            f"{'; '.join(findings)}: irradiance changes by {100 * sum(errors) / len(errors):.2f} %"
            f"{worst if len(errors) > 1 else ''}"
        )


def _print_misfit(written: Lobes) -> None:
    """Say on one line that NeRD's training does not take so many lobes, if so.  [F, N', .]."""
    from asglight.export.sg_array import NERD_LOBES

    if written.count != NERD_LOBES:
        print(
            f"NeRD's training takes arrays of {NERD_LOBES} lobes, not of {written.count}; for it, "
            f"fit with --form sg --lobes {NERD_LOBES}"
        )


def _of_frames(tracks: LobeTracks, frames: tuple[int, ...]) -> LobeTracks:
    places = [tracks.frames.index(frame) for frame in frames]
    return replace(tracks, frames=frames, lobes=tracks.lobes[places])


def _check_output(output: Path, to: str) -> None:
    """Refuse a target that cannot be meant."""
    if to in list(SgLayout) and output.suffix != ".npy":
        raise InputError(f"{output}: expected a name that ends in .npy, such as lights.npy.")
    if to == GLTF and output.suffix.lower() != ".glb":
        raise InputError(f"{output}: expected a name that ends in .glb, such as lights.glb.")
    if output.suffix.lower() in _OTHER_FILES:
        raise InputError(
            f"{output}: has the suffix of another kind of file; expected a name such as shot.json "
            "or environment.glsl."
        )
    if output.is_dir():
        raise InputError(f"{output}: is a folder; expected a file to write.")
