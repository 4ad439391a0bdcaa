# SPDX-License-Identifier: Apache-2.0
"""`asglight info`: what a stage holds; images are image_info.py."""

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from asglight.cli.condition import condition_lines
from asglight.cli.leaving_out import left_out_lines
from asglight.cli.options.key_options import key_lines
from asglight.cli.options.parser import (
    add_follow_option,
    add_input_options,
    add_json_option,
    add_rig_option,
)
from asglight.cli.options.reading import given, read_options
from asglight.cli.printing import counted, frame_range, print_json, size, table
from asglight.cli.repairs import repair_line
from asglight.errors import InputError
from asglight.images.account import image_line, warning_lines
from asglight.lobes import LobeTracks, asg

EXAMPLE = "asglight info sky.usda\n         asglight info sky.####.exr"

RESAMPLED = "resampled"
"""Key of the metadata: what a shot was resampled from, a row each time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `info`."""
    what = "a stage that asglight has written; or an image, a folder or a pattern of images"
    parser.add_argument("stage", metavar="INPUT", help=what)
    add_input_options(parser)
    add_rig_option(parser)
    add_follow_option(parser)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read a stage and print what it holds."""
    from asglight.cli import image_info

    if image_info.is_images(arguments.stage):
        return image_info.run(arguments)
    of_frames = [] if arguments.frames is None else ["--frames"]
    for option in [*given(read_options(arguments)), *of_frames]:
        raise InputError(f"{option}: given with a stage; expected it with images only.")
    from asglight.usd import read_stage
    from asglight.usd.read.between import samples_between
    from asglight.usd.read.keys import read_keys
    from asglight.usd.stage import representations_of

    shown, held = representations_of(arguments.stage, arguments.rig)
    reading = read_stage(arguments.stage, arguments.rig)
    keys = read_keys(arguments.stage, arguments.rig)
    of_keys = () if keys is None else keys.changes
    # what is done to the rig is told of its keys too
    changes = dict.fromkeys([*reading.changes, *of_keys])
    document = {
        "stage": arguments.stage,
        "bytes": os.path.getsize(arguments.stage),
        "representation": shown,
        "representations": held,
        "samples_between": samples_between(arguments.stage, arguments.rig),
        "changes": list(changes),
        "unread": list(reading.unread),
        **as_document(reading.tracks),
        "ill_conditioned": reading.tracks.metadata.get("ill_conditioned", []),
    }
    if arguments.json:
        print_json(document)
    else:
        print("\n".join([*summary_lines(document), "", lobe_table(document["lobes"])]))
    return 0


def as_document(tracks: LobeTracks) -> dict[str, Any]:
    """Return tracks as JSON values: the shot, how it was fitted, and each lobe."""
    return {
        "frames": list(tracks.frames),
        "fps": tracks.fps,
        "form": str(tracks.lobes.form),
        "metadata": dict(tracks.metadata),
        "lobes": lobe_rows(tracks),
    }


def lobe_rows(tracks: LobeTracks) -> list[dict[str, Any]]:
    """Describe each lobe over the shot.

    The direction is the mean weighted by flux, `moves_deg` the largest angle from it while the lobe
    is lit, `flux_share` the mean over the frames that have light. Longitude and latitude are those
    of the latlong: 0 degrees is +Z, 90 degrees +X.
    """
    lobes = tracks.lobes.to(torch.float64)
    flux = asg.flux(lobes).sum(-1)  # [F, N]
    lit = flux > 0
    shares = flux / flux.sum(1, keepdim=True).clamp(min=torch.finfo(torch.float64).tiny)
    share = shares.sum(0) / lit.any(1).sum().clamp(min=1)  # mean over frames that are not black
    rows = []
    for index in range(lobes.count):
        seen = lit[:, index]
        # A lobe that is never lit is described where it lies.
        seen = seen if bool(seen.any()) else torch.ones_like(seen)
        weight = flux[seen, index].clamp(min=torch.finfo(torch.float64).tiny)
        weight = weight / weight.max()  # `normalize` leaves vectors below 1e-12 as they are
        axis_z = lobes.axis_z[seen, index]
        mean = torch.nn.functional.normalize((weight[:, None] * axis_z).sum(0), dim=0)
        cosine = (axis_z @ mean).clamp(-1, 1)
        sharpness = lobes.sharpness[seen, index]
        x, y, z = mean.tolist()
        rows.append(
            {
                "lobe": tracks.names[index],
                "longitude_deg": math.degrees(math.atan2(x, z)),
                "latitude_deg": math.degrees(math.asin(max(-1.0, min(1.0, y)))),
                "direction": [x, y, z],
                "moves_deg": math.degrees(math.acos(float(cosine.min()))),
                "sharpness_min": float(sharpness.min()),
                "sharpness_max": float(sharpness.max()),
                "flux_share": float(share[index]),
                "lit_frames": int(lit[:, index].sum()),
            }
        )
    return rows


def summary_lines(document: dict[str, Any]) -> list[str]:
    """Return the shot and how it was fitted, one line for each subject."""
    metadata, frames = document["metadata"], document["frames"]
    lines = [
        f"{document['stage']}: {counted(len(document['lobes']), 'lobe')} of form "
        f"{document['form']}, {counted(len(frames), 'frame')} ({frame_range(frames)}) at "
        f"{document['fps']:g} fps, {size(document['bytes'])}",
        representation_line(document),
        f"between frames: {counted(document['samples_between'], 'time sample')}",
    ]
    if "preset" in metadata:
        lines.append(
            f"fitted: preset {metadata['preset']}, from {metadata.get('source', 'unknown')}, "
            f"asglight {metadata.get('asglight', 'unknown')}"
        )
    if "layout" in metadata:
        lines.append(
            f"imported: {metadata['layout']} array, from {metadata.get('source', 'unknown')}, "
            f"asglight {metadata.get('asglight', 'unknown')}"
        )
    lines += key_lines(metadata.get("keys"))
    lines += [f"edited: {change}" for change in document["changes"]]
    lines += [f"not read: {found}" for found in document["unread"]]
    lines += left_out_lines(metadata)
    lines += condition_lines(document["ill_conditioned"])
    lines += part_lines(metadata.get("parts", []))
    lines += resampled_lines(metadata.get(RESAMPLED, []))
    image = metadata.get("image")
    lines += [] if image is None else [image_line(image), *warning_lines(image)]
    lines += [repair_line(metadata["repairs"])] if "repairs" in metadata else []
    return [line for line in lines if line]


def representation_line(document: Mapping[str, Any]) -> str:
    """Return which lights the stage shows, and which others it holds."""
    shown = document["representation"]
    others = [name for name in document["representations"] if name != shown]
    also = f" (also {', '.join(others)})" if others else ""
    return f"representation: {shown or 'none chosen'}{also}"


def part_lines(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each part of a stitched shot, and one more where it was repaired."""
    lines = []
    for part in parts:
        lines.append(
            f"part {part['name']}: {frame_range(part['frames'])}, {counted(part['lobes'], 'lobe')}"
        )
        repaired = repair_line(part["repairs"]) if "repairs" in part else ""
        lines += [f"part {part['name']}: {repaired}"] if repaired else []
    return lines


def resampled_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each time that a shot was resampled, and one where it was repaired."""
    lines = []
    for row in rows:
        first, last = row["frames"]
        speed = "" if row["speed"] == 1 else f", at {row['speed']:g} times the speed"
        lines.append(f"resampled: {first}-{last} of {row['source']} at {row['fps']:g} fps{speed}")
        repaired = repair_line(row["repairs"]) if "repairs" in row else ""
        lines += [f"before, {repaired}"] if repaired else []
    return lines


def lobe_table(rows: list[dict[str, Any]]) -> str:
    """Return the lobes as a table; angles in degrees, flux share in percent."""
    header = ["", "lon", "lat", "direction", "moves", "sharpness", "flux %", "lit frames"]
    return table(header, [_cells(row) for row in rows])


def _cells(row: dict[str, Any]) -> list[str]:
    return [
        row["lobe"],
        f"{row['longitude_deg']:.1f}",
        f"{row['latitude_deg']:.1f}",
        " ".join(f"{component:+.3f}" for component in row["direction"]),
        f"{row['moves_deg']:.1f}",
        f"{row['sharpness_min']:.3g} to {row['sharpness_max']:.3g}",
        f"{100 * row['flux_share']:.2f}",
        str(row["lit_frames"]),
    ]
