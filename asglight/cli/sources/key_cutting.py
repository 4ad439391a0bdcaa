# SPDX-License-Identifier: Apache-2.0
"""Keys cut for a stage that is there: by `asglight keys`, and for what a farm has fitted."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from asglight.cli.commands.evaluate import check_frames
from asglight.cli.options.key_options import with_keys
from asglight.cli.printing import frame_range
from asglight.cli.sources.same_light import SameLight
from asglight.images import LatlongImage, Repair, Sequence, open_sequence
from asglight.images.options import ReadOptions
from asglight.images.sequence import Missing
from asglight.usd.options import KeyOptions, StageOptions

if TYPE_CHECKING:
    from asglight.cli.progress import Reporter
    from asglight.usd import WriteReport


@dataclass(frozen=True)
class Cutting:
    """What keys are cut from, and how.

    Attributes:
        reference: The images that the stage was fitted to.
        keys: How many keys, and as what.
        reading: How the images are read.
        representations: What the stage holds then; None for keys, and what it has.
        missing: What stands in for an image that is missing or damaged.
    """

    reference: str
    keys: KeyOptions
    reading: ReadOptions
    representations: tuple[str, ...] | None = None
    missing: Missing = "error"


ALL_FRAMES = "Keys are cut in every frame of the stage."
"""What is said of a reference that lacks some."""


def cut_keys(
    stage: str, output: str, cutting: Cutting, report: "Reporter"
) -> "tuple[WriteReport, StageOptions, dict[int, Repair]]":
    """Find the keys of a stage's images, and write the stage with them.

    Returns:
        What was written, how, and what was repaired in the image of each frame.

    Raises:
        InputError: The images lack a frame or one is damaged, something cannot be read or written,
            or a fit writes the stage.
    """
    from asglight.shots.kept.checkpoint import alone

    with alone(output):
        return _cut(stage, output, cutting, report)


def _cut(
    stage: str, output: str, cutting: Cutting, report: "Reporter"
) -> "tuple[WriteReport, StageOptions, dict[int, Repair]]":
    from asglight.shots.keying import Keying
    from asglight.usd import read_usd, write_usd
    from asglight.usd.read.read_options import read_options

    tracks, options = read_usd(stage), read_options(stage)
    asked = cutting.representations
    chosen = {} if asked is None else {"representations": asked}
    options = replace(options, **with_keys(chosen, cutting.keys, options.representations))
    sequence = _images(cutting, tracks.frames, stage)
    compare = SameLight(tracks, stage, cutting.reference, report)
    repairs: dict[int, Repair] = {}

    def check(frame: int, image: LatlongImage) -> None:
        repairs[frame] = image.repair
        compare(frame, image)

    keying = Keying(sequence, cutting.keys, report.follow, check)
    return write_usd(tracks, output, **vars(options), keys=keying), options, repairs


def _images(cutting: Cutting, frames: tuple[int, ...], stage: str) -> Sequence:
    """Open the images of a stage's frames."""
    are_filled = cutting.missing != "error"
    sequence = open_sequence(
        cutting.reference,
        frames=frame_range(frames) if are_filled else None,
        missing=cutting.missing if are_filled else "hold",
        height=cutting.keys.rest_height,
        reading=cutting.reading,
    )
    if not are_filled:  # by its own message, in place of that of `open_sequence`
        check_frames(sequence, frames, cutting.reference, stage, ALL_FRAMES)
    return replace(sequence, missing=cutting.missing)
