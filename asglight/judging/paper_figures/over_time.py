# SPDX-License-Identifier: Apache-2.0
"""A row of the map stacked over time, as Clausen et al. 2024 show it, measured.

The paper's recipe with its temporal term L_T, without it, and on each frame by itself from the same
start; and `fast`. All are judged on the frames as they are, all of the map: the row is only shown.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions
from asglight.fitting.paper import fit as paper
from asglight.judging.clock import Clock
from asglight.judging.compare.maps import Follow
from asglight.judging.following import follow as fit_frames
from asglight.judging.following import jumps, matched, refined
from asglight.judging.metrics import FrameErrors, maps_errors, sequence_errors
from asglight.judging.paper_figures.data import Plan, coarsened
from asglight.judging.pictures.display import exposure_stops
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import stack
from asglight.lobes.identity.tracks import as_tracks
from asglight.luminance import luminance
from asglight.shading import kernels
from asglight.sphere import latlong
from asglight.threads import one_thread

NEXT_SHARE = paper.FIRST_FRAME_STEPS // paper.NEXT_FRAME_STEPS
"""A next frame has one in so many of the steps of the first, as published."""

ROUGHNESS, DIRECTIONS = 0.25, 128
"""Of the ball along the row: that of `flicker`; 2.8 degrees apart, as it blurs by 9 (full width at
half maximum)."""

REFERENCE = "reference"
WITH, WITHOUT, INDEPENDENT, OURS = "with L_T", "without L_T", "independent", "fast"


@dataclass(frozen=True)
class Followed:
    """A sequence fitted one way.

    Attributes:
        name: The way.
        row: The row that is shown, of each frame's fit.  [F, W, 3]
        glossy: What a ball of roughness 0.25 shows along the row.  [F, D, 3]
        mean: Means of the errors over the frames, and flicker (`metrics`).
        jumps: Lit lobes that turn by more than 10 degrees between two frames.
        steps: Adam steps in all; 0 for `fast`.
        seconds: Processor seconds a frame, one thread.
    """

    name: str
    row: Tensor = field(repr=False)
    glossy: Tensor = field(repr=False)
    mean: dict[str, float]
    jumps: int
    steps: int
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return the numbers."""
        numbers = {"jumps": self.jumps, "steps": self.steps, "cpu_seconds": self.seconds}
        return {"name": self.name, **numbers, **self.mean}


@dataclass(frozen=True)
class Stacked:
    """A row of a sequence over time.

    Attributes:
        frames: Frame numbers.
        index: Of the row that is shown.
        latitude_deg: Of its middle.
        row: The row of each frame.  [F, W, 3]
        glossy: What a ball of roughness 0.25 shows along the row.  [F, D, 3]
        stops: Exposure at which the sequence is seen.
        ways: How it was fitted.
    """

    frames: tuple[int, ...]
    index: int
    latitude_deg: float
    row: Tensor = field(repr=False)
    glossy: Tensor = field(repr=False)
    stops: float
    ways: tuple[Followed, ...]


def stacked(
    references: Sequence[Tensor],
    frames: Sequence[int],
    plan: Plan,
    follow: Follow,
    latitude_deg: float | None = None,
) -> Stacked:
    """Fit a sequence in four ways and take a row of each frame.

    Args:
        references: Repaired radiance, each with some light in it.  [H, W, 3]
        frames: Their numbers.
        plan: Lobes, and steps and rows of the paper's recipe.
        follow: Shows how far this is.
        latitude_deg: Where the row is; None for the one that changes most.
    """
    shot = torch.stack(list(references))
    index = liveliest_row(shot) if latitude_deg is None else row_at(latitude_deg, shot.shape[1])
    ways: dict[str, tuple[list[Lobes], int, float]] = {}
    coarse = [coarsened(reference, plan.rows) for reference in references]
    for name in (WITH, WITHOUT, INDEPENDENT):
        passed = follow(coarse, f"paper's recipe, {name}, frames", len(coarse))
        ways[name] = _paper_way(passed, plan, name)
    ways[OURS] = _our_way(follow(references, "fast, frames", len(references)), plan, references)
    found = {name: way[0] for name, way in ways.items()}
    seen, judged = _judged(found, shot, index, follow)
    listed = [
        Followed(name, *seen[name], judged[name], jumps(lobes), steps, seconds)
        for name, (lobes, steps, seconds) in ways.items()
    ]
    latitude = 90 - 180 * (index + 0.5) / shot.shape[1]
    stops = exposure_stops(shot)
    return Stacked(tuple(frames), index, latitude, *seen[REFERENCE], stops, tuple(listed))


def liveliest_row(shot: Tensor) -> int:
    """Return the row that changes most from frame to frame, by its solid angle.

    Of the logarithm of 1 + luminance over the mean: a sun that moves by a texel would else outweigh
    all. The solid angle keeps it from the poles, where a row is one direction.

    Args:
        shot: Maps.  [F, H, W, 3]
    """
    level = luminance(shot)
    weight = latlong.texel_solid_angles(*shot.shape[1:3])
    mean = (level * weight).sum() / (weight.sum() * len(shot))
    seen = (level / mean.clamp(min=torch.finfo(level.dtype).tiny)).log1p()
    return int((seen.diff(dim=0).abs() * weight).sum((0, 2)).argmax())


def row_at(latitude_deg: float, height: int) -> int:
    """Return the row that holds a latitude."""
    return min(int((90 - latitude_deg) / 180 * height), height - 1)


def _paper_way(
    references: Iterable[Tensor], plan: Plan, name: str
) -> tuple[list[Lobes], int, float]:
    """Follow frames with the paper's recipe; return lobes, steps in all, seconds a frame."""
    found: list[Lobes] = []
    total = 0
    clock = Clock()
    with one_thread():
        for reference in references:
            fresh = not found or name == INDEPENDENT
            steps = plan.steps if fresh else max(plan.steps // NEXT_SHARE, 1)
            begin = paper.start(reference, plan.lobes, Form.ASG, 0) if fresh else found[-1]
            previous = found[-1] if found and name == WITH else None
            found.append(paper.fit_frame(reference, begin, steps=steps, previous=previous))
            total += steps
    seconds = clock.seconds()["cpu_seconds"] / len(found)
    return (matched(found) if name == INDEPENDENT else found), total, seconds


def _our_way(
    references: Iterable[Tensor], plan: Plan, shot: Sequence[Tensor]
) -> tuple[list[Lobes], int, float]:
    """Follow frames as `asglight fit` does."""
    lobes, points = fit_frames(references, FitOptions(plan.lobes))
    if len(lobes) > 1:
        lobes, points = refined(shot, lobes, points)
    tracks = as_tracks(stack(lobes))
    seconds = sum(point["cpu_seconds"] for point in points) / len(points)
    return [tracks[index] for index in range(len(lobes))], 0, seconds


def _judged(
    found: dict[str, list[Lobes]], shot: Tensor, index: int, follow: Follow
) -> tuple[dict[str, tuple[Tensor, Tensor]], dict[str, dict[str, float]]]:
    """Return the row of every frame and what a ball shows along it, and the errors, by way."""
    _, height, width, _ = shot.shape
    around = latlong.directions(height, DIRECTIONS)[index]  # of the row, at columns of its own
    names = [REFERENCE, *found]
    rows: dict[str, list[Tensor]] = {name: [] for name in names}
    glossy: dict[str, list[Tensor]] = {name: [] for name in names}
    errors: dict[str, list[tuple[int, FrameErrors]]] = {name: [] for name in found}
    for frame, reference in enumerate(follow(shot, "judging frames", len(shot))):
        maps = torch.stack(
            [texels.texel_means(lobes[frame].to(torch.float32), height, width)
             for lobes in found.values()]
        )  # fmt: skip
        every = torch.cat([reference[None], maps])
        filtered = kernels.filtered(every, ROUGHNESS, around)
        for name, radiance, shown in zip(names, every, filtered, strict=True):
            rows[name].append(radiance[index])
            glossy[name].append(shown)
        for name, of_frame in zip(found, maps_errors(maps, reference), strict=True):
            errors[name].append((frame, of_frame))
    seen = {name: (torch.stack(rows[name]), torch.stack(glossy[name])) for name in names}
    return seen, {name: sequence_errors(listed).mean for name, listed in errors.items()}
