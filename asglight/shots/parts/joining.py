# SPDX-License-Identifier: Apache-2.0
"""One stage from the stages of the parts of a shot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.lobes.identity.naming import named_as
from asglight.lobes.stitching import stitched
from asglight.shots.conditioning import with_condition

if TYPE_CHECKING:
    from asglight.usd import WriteReport

OF_FRAMES = (
    "loss",
    "flux_error",
    "repairs",
    "left_out",
    "tolerance_met",
    "worst_errors",
)
"""Metadata that is true of the frames of one part only, and stays with it."""


@dataclass(frozen=True)
class Joined:
    """A shot that was put together.

    Attributes:
        tracks: The lobes, as written; `parts` of the metadata is the account of the parts.
        written: What was written.
        keys_left_out: Whether some parts have keys, which the shot has not as others have none.
    """

    tracks: LobeTracks
    written: "WriteReport"
    keys_left_out: bool = False


def join(
    files: Sequence[str],
    output: str,
    given: Mapping[str, Any] = MappingProxyType({}),
    *,
    names_from: str | None = None,
) -> Joined:
    """Read parts, stitch them and write the shot as the first part was written.

    Args:
        files: Stages of the parts, in any order.
        output: The stage of the shot.
        given: Options of the stage, by name, in place of those of the first part.
        names_from: Stage of an earlier fit, whose names the lights of the shot keep.

    Raises:
        InputError: A part cannot be read, they do not make up a shot, or it cannot be written.
    """
    from asglight.shots.keyed.sources import stitched_keys
    from asglight.usd import read_usd, write_usd  # loads pxr
    from asglight.usd.options import Representation, without_keys
    from asglight.usd.read.read_options import read_options

    parts = sorted(((read_usd(file), file) for file in files), key=lambda pair: pair[0].frames)
    tracks = stitched([part for part, _ in parts], [shown(file) for _, file in parts])
    if names_from is not None:
        tracks = named_as(tracks, read_usd(names_from))
    account = [row for part, file in parts for row in part_rows(part, file)]
    metadata = {name: tracks.metadata[name] for name in tracks.metadata if name not in OF_FRAMES}
    tracks = with_condition(replace(tracks, metadata=metadata | {"parts": account}))
    options = replace(read_options(parts[0][1]), **given)
    keys = None
    if Representation.KEYS in options.held:
        names = [shown(file) for _, file in parts]
        keys = stitched_keys([file for _, file in parts], [part for part, _ in parts], names)
        options = options if keys else without_keys(options)
    had_keys = any("keys" in part.metadata for part, _ in parts)
    written = write_usd(tracks, output, **vars(options), keys=keys)
    return Joined(tracks, written, had_keys and "representations" not in given and keys is None)


def part_rows(part: LobeTracks, file: str) -> list[dict[str, Any]]:
    """Return what the shot remembers of a part; of one that is stitched itself, of its parts."""
    if "parts" in part.metadata:
        return list(part.metadata["parts"])
    of_frames = {name: part.metadata[name] for name in OF_FRAMES if name in part.metadata}
    row = {"name": Path(file).name, "frames": list(part.frames), "lobes": part.lobes.count}
    return [row | of_frames]
