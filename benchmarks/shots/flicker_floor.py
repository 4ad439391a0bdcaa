# SPDX-License-Identifier: Apache-2.0
"""How little a sequence can flicker with so many lobes, whatever they do from frame to frame.

    python -m benchmarks.shots.flicker_floor ../shared/sequences/tunnel --frames 16

Nothing holds the lobes here: they jump as they like. Every frame is fitted from nothing, by `fast`
and by `best`. Then the lobes of `best` take steps for what roughness 0.25 shows alone, by which
flicker is judged, and then for that and its change from frame to frame at once: four times through
the sequence, each map is moved by half of the mean error of its two neighbours. What flicker is
left then, lobes that may not jump cannot be asked to go below.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import Exposed, exposed, narrowest, on_fine_cells
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.options import LOBES, FitOptions, Preset
from asglight.fitting.steps import newton
from asglight.judging.following import follow
from asglight.judging.metrics import SequenceErrors, frame_errors, sequence_errors
from asglight.lobes import Lobes
from asglight.threads import one_thread
from benchmarks.given import add_sequence, frames_given

WEIGHTS = 0.05, (1.0, 0.1, 0.1, 4.0)
"""Factors of J's weights: of the map, and of the mean radiance, Lambert, GGX 0.5 and GGX 0.25."""

STEPS, MORE_STEPS, ROUNDS = 150, 60, 4
"""For what GGX 0.25 shows alone; for its change as well, in each of so many rounds. After two of
them nothing moves by 1 % any more."""

SHOWN = ("irr", "r0.5", "r0.25", "flicker")


def main(argv: Sequence[str] | None = None) -> int:
    """Fit a sequence in each way, print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.shots.flicker_floor", description=__doc__
    )
    add_sequence(parser)
    parser.add_argument("--lobes", type=int, metavar="N", default=LOBES, help=f"({LOBES})")
    options = parser.parse_args(argv)
    maps = frames_given(parser, options)
    if not all(float(radiance.max()) > 0 for radiance in maps):
        parser.error(f"{options.sequence}: has black frames; expected some light in each")
    print(table(measured(maps, options.lobes)))
    return 0


def measured(maps: list[Tensor], count: int) -> dict[str, SequenceErrors]:
    """Return the errors of each way.

    Args:
        maps: Of each frame.  [H, W, 3]
        count: N.
    """
    found = {
        f"{preset} from nothing": follow(maps, FitOptions(count, preset), fresh=True)[0]
        for preset in (Preset.FAST, Preset.BEST)
    }
    with one_thread(), torch.inference_mode():
        frames = [exposed(radiance) for radiance in maps]
        lobes = found[f"{Preset.BEST} from nothing"]
        lobes = [_stepped(*pair, None, STEPS) for pair in zip(lobes, frames, strict=True)]
        found["r0.25 alone"] = lobes
        found["r0.25 and its change"] = steadied(lobes, frames)
    return {
        name: sequence_errors(
            (frame, frame_errors(*pair)) for frame, pair in enumerate(zip(lobes, maps, strict=True))
        )
        for name, lobes in found.items()
    }


def steadied(lobes: list[Lobes], frames: list[Exposed]) -> list[Lobes]:
    """Take steps for what GGX 0.25 shows and its change, frame by frame.

    Args:
        lobes: Of each frame, in the units of its map.  [N, .]
        frames: Their maps.
    """
    shot = list(lobes)
    for _ in range(ROUNDS):
        for place, frame in enumerate(frames):
            beside = [other for other in (place - 1, place + 1) if 0 <= other < len(frames)]
            pairs = [(shot[other], frames[other]) for other in beside]
            shot[place] = _stepped(shot[place], frame, pairs, MORE_STEPS)
    return shot


def _stepped(
    lobes: Lobes, frame: Exposed, beside: list[tuple[Lobes, Exposed]] | None, steps: int
) -> Lobes:
    """Return lobes after steps for what GGX 0.25 shows of their map.

    Args:
        lobes: In the units of the map.  [N, .]
        frame: The map.
        beside: Lobes of the neighbouring frames and their maps, by half of whose mean error the
            map is moved.
        steps: At most.
    """
    wanted = on_fine_cells(frame)
    if beside:
        errors = [_error(other, own, frame, wanted) for other, own in beside]
        radiance, parts = (sum(each) / (2 * len(errors)) for each in zip(*errors, strict=True))
        moved = wanted.radiance + radiance, (wanted.parts + parts).contiguous()
        wanted = replace(wanted, radiance=moved[0], parts=moved[1])
    found = newton.minimise(
        replace(lobes, amplitude=lobes.amplitude / frame.exposure)[None],
        wanted.with_weights(*WEIGHTS),
        steps,
        width_min=narrowest(frame.height),
    ).lobes[0]
    return replace(found, amplitude=found.amplitude * frame.exposure)


def _error(
    lobes: Lobes, own: Exposed, frame: Exposed, wanted: objective.Target
) -> tuple[Tensor, Tensor]:
    """Return what lobes show wrong of the map of their frame, on the adaptive cells of another.

    Returns:
        On the adaptive cells [1, 3, P] and on the parts of cells [1, K, 3, C], in units of the
        other frame.
    """
    unit = own.exposure / frame.exposure
    there = objective.target(own.radiance * unit, wanted.corners, wanted.places)
    ours = replace(lobes, amplitude=lobes.amplitude / frame.exposure)[None]
    shown = lobe_images.images(ours, wanted.places).radiance
    cells = shown[:, None, :, : wanted.places.count]
    return shown - there.radiance, cells - there.parts


def table(found: dict[str, SequenceErrors]) -> str:
    """Return a row for each way, flicker also over that of the first.

    Args:
        found: Errors by way.
    """
    heads = ["lobes", *SHOWN, "flicker over the first"]
    lines = [f"| {' | '.join(heads)} |", "|---|" + "--:|" * (len(heads) - 1)]
    first = next(iter(found.values())).mean["flicker"]
    for name, errors in found.items():
        numbers = [f"{errors.mean[key]:.4f}" for key in SHOWN]
        numbers.append(f"{errors.mean['flicker'] / first:.2f}")
        lines.append(f"| {name} | {' | '.join(numbers)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
