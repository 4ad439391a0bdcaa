# SPDX-License-Identifier: Apache-2.0
"""The figures of a keyed stage against its images: a row of the tables of `measure.py`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pxr import Usd
from torch import Tensor

from asglight.images import Sequence as ImageSequence
from asglight.images import read_latlong
from asglight.judging.metrics import maps_errors
from asglight.lobes import Lobes, LobeTracks
from asglight.shots.keying import Keying
from asglight.sphere import latlong
from asglight.usd import WriteReport, write_usd
from asglight.usd.options import KeyOptions
from benchmarks.keyed.seen import flux_error, rest_image, seen

SHOWN = ("env", "irr", "r0.5", "r0.25")


def print_head(heads: Sequence[str]) -> None:
    """Print the head of a table."""
    print_row(heads)
    print_row(["---", *["---:"] * (len(heads) - 1)])


def print_row(cells: Sequence[str]) -> None:
    """Print a row of a table."""
    print(f"| {' | '.join(cells)} |", flush=True)


@dataclass(frozen=True)
class Row:
    """The figures of an input.

    Attributes:
        name: Of the input.
        keys: How many.
        share: Of the light in keys.
        worst: `SHOWN` and `flux`, of the worst frame.
        rim: Of the worst key, None without one.
        pump: None of a still.
        bytes: Of the stage's files.
    """

    name: str
    keys: int
    share: float
    worst: dict[str, float]
    rim: float | None
    pump: float | None
    bytes: int

    def cells(self) -> list[str]:
        """Return the cells of a table."""
        return [*self.figures(), f"{self.bytes / 1e6:.2f}"]

    def figures(self) -> list[str]:
        """Return the cells up to `pump`."""
        return [
            self.name,
            str(self.keys),
            f"{100 * self.share:.1f}",
            *(f"{self.worst[name]:.4f}" for name in SHOWN),
            f"{self.worst['flux']:.0e}",
            *("–" if one is None else f"{one:.2f}" for one in (self.rim, self.pump)),
        ]


def written(sequence: ImageSequence, keys: KeyOptions, stage: Path) -> WriteReport:
    """Write the stage of a shot's keys beside a lobe that says nothing: keys are of images."""
    tracks = _one_lobe(sequence.frames)
    keying = Keying(sequence, keys)
    return write_usd(tracks, stage, representations=("keys",), keys=keying)


def _one_lobe(frames: tuple[int, ...]) -> LobeTracks:
    count = len(frames)
    lobes = Lobes(
        torch.eye(3).expand(count, 1, 3, 3),
        torch.full((count, 1, 2), 2.0),
        torch.full((count, 1, 3), 1e-3),
    )
    return LobeTracks(frames, 24.0, lobes)


def stage_row(
    sequence: ImageSequence, stage: Path, told: dict[str, Any], size: int, step: int = 1
) -> Row:
    """Judge a stage of keys against its images.

    Args:
        sequence: The images.
        stage: The stage's file.
        told: What was said of its keys.
        size: Of its files, in bytes.
        step: Every which frame is judged.
    """
    frames = sequence.frames[::step]
    rows = [frame_row(stage, frame, sequence.read(frame).radiance) for frame in frames]
    rims = [key["rim"] for key in told["keys"] if key["rim"] is not None]
    return Row(
        sequence.name,
        len(told["keys"]),
        told["share"],
        {name: max(row[name] for row in rows) for name in (*SHOWN, "flux")},
        max(rims, default=None),
        pump(stage, sequence.frames, [sequence.read(f).radiance for f in sequence.frames]),
        size,
    )


def frame_row(stage: Path, frame: int, reference: Tensor) -> dict[str, float]:
    """Return the errors of a frame."""
    opened = Usd.Stage.Open(str(stage))
    shown = seen(opened, frame, *reference.shape[:2])
    errors = maps_errors(torch.from_numpy(shown).float()[None], reference)[0].values
    return {**errors, "flux": flux_error(opened, frame, reference)}


DARK, UNSEEN = 0.05, 0.01
"""As of `asglight.keys.report.rim_gradients`: what is added to radiance before its logarithm, over
the median around mattes, and the change from frame to frame that no eye sees."""


def pump(stage: Path, frames: Sequence[int], maps: Sequence[Tensor]) -> float | None:
    """Return how the rest changes from frame to frame where keys are, over the map around them.

    Texels in which rest and map differ are those of mattes; around them is a band as wide as two
    texels. The change is the mean of the absolute differences of neighbouring frames, of the
    logarithm of radiance.
    """
    if len(frames) < 2:
        return None
    opened = Usd.Stage.Open(str(stage))
    inside, around = [], []
    last: tuple[Tensor, Tensor, Tensor] | None = None
    for frame, truth in zip(frames, maps, strict=True):
        rest = latlong.reduce(read_latlong(rest_image(opened, frame)).radiance, *truth.shape[:2])
        cut = ((rest - truth).abs() > 1e-3 * truth.clamp(min=1e-6)).any(-1)
        if last is not None:
            both, band = cut & last[2], _grown(_grown(cut | last[2])) & ~(cut | last[2])
            if both.any() and band.any():
                dark = DARK * float(truth.mean(-1)[band].median())
                inside.append(_change(last[0], rest, dark, both))
                around.append(max(_change(last[1], truth, dark, band), UNSEEN))
        last = rest, truth, cut
    return float(np.mean(inside) / np.mean(around)) if inside else None


def _change(before: Tensor, after: Tensor, dark: float, where: Tensor) -> float:
    ratio = (after.mean(-1)[where] + dark) / (before.mean(-1)[where] + dark)
    return float(ratio.log().abs().mean())


def _grown(mask: Tensor) -> Tensor:
    wide = mask | mask.roll(1, 1) | mask.roll(-1, 1)
    found = wide.clone()
    found[1:] |= wide[:-1]
    found[:-1] |= wide[1:]
    return found
