# SPDX-License-Identifier: Apache-2.0
"""What a shot did without, as the lines that `fit` and `info` print."""

from collections.abc import Mapping
from typing import Any

from asglight.cli.printing import counted, frame_range


def left_out_lines(metadata: Mapping[str, Any]) -> list[str]:
    """Return what was left out of a shot and why, one line for each subject.

    Args:
        metadata: Of the stage, or as much of it as there is.
    """
    try:
        found = metadata.get("left_out")
        lines = [] if found is None else _left_out(found)
        if "tolerance_met" in metadata:
            lines.append(tolerance_line(metadata))
    except (KeyError, TypeError, ValueError, AttributeError):  # anyone can write metadata
        return ["left out: the stage's account of it is of another version of asglight, or edited"]
    return lines


def _left_out(found: Mapping[str, Any]) -> list[str]:
    lines = []
    if found["lights"] > found["lit_at_once"]:
        every, lit = found["lights"], found["lit_at_once"]
        lines.append(f"lights: {every} in all, at most {lit} lit in one frame")
    reasons = []
    if found["black"]:
        reasons.append(f"{counted(found['black'], 'lobe')}, black in every frame")
    if found["unneeded"]:
        reasons.append(f"{counted(found['unneeded'], 'lobe')} that nothing shows")
    if reasons:
        lines.append(f"left out: {'; '.join(reasons)}")
    simpler = []
    if found["one_sharpness"]:
        simpler.append(f"{counted(found['one_sharpness'], 'lobe')} with one sharpness")
    if found["static"]:
        simpler.append(f"{counted(found['static'], 'lobe')} the same in every frame")
    if simpler:
        budget = f"{100 * found['budget']:g} %"
        lines.append(f"simpler: {'; '.join(simpler)} (balls change by {budget} at most)")
    repeated = found["repeated_frames"]
    if repeated:
        what = counted(len(repeated), "frame")
        lines.append(
            f"repeated: {what} as the one before, not fitted again ({frame_range(repeated)})"
        )
    return lines


def tolerance_line(metadata: Mapping[str, Any]) -> str:
    """Say whether a shot keeps its tolerance, and the largest errors with their frames."""
    errors = ", ".join(
        f"{name} {_number(worst['error'])} (frame {worst['frame']})"
        for name, worst in metadata["worst_errors"].items()
    )
    tolerance = f"tolerance {metadata['tolerance']:g}"
    if metadata["tolerance_met"]:
        return f"{tolerance}: met with {counted(metadata['lobes'], 'lobe')}; worst {errors}"
    return (
        f"{tolerance}: missed with {counted(metadata['lobes'], 'lobe')}, the most allowed; worst "
        f"{errors}. Allow more with --max-lobes."
    )


def _number(error: float | None) -> str:
    return "infinite" if error is None else f"{error:.4f}"
