# SPDX-License-Identifier: Apache-2.0
"""What a fitted shot can do without, and the account of it.

Frames that repeat another count once: a held frame weighs no more than any other.
"""

from typing import Any

import torch

from asglight.fitting.simplification import BUDGET, leave_out
from asglight.lobes import Form, Lobes
from asglight.shots.tolerance import Accuracy
from asglight.threads import one_thread, threads_there

TOLERANCE_SHARE = 0.1
"""Budget of a shot with a tolerance, of the tolerance."""

HALVINGS = 4
"""Times that the budget of a frame is halved which simplifying has taken beyond the tolerance: the
errors of a fit and of its simplification seldom add up, so most frames bear all of it."""


def simplified(lobes: Lobes, frames: list[int], accuracy: Accuracy | None) -> tuple[Lobes, float]:
    """Leave out what the budget allows; with a tolerance, what every frame bears.

    Args:
        lobes: A shot without repeated frames, continuous in time.  [F, N, .]
        frames: Frame numbers.
        accuracy: Measures the frames, where the shot has a tolerance.

    Returns:
        The lobes [F, N', .] and the budget.
    """
    threads = threads_there()
    with one_thread():
        if accuracy is None:
            return leave_out(lobes, torch.full((len(frames),), BUDGET), threads), BUDGET
        share = TOLERANCE_SHARE * accuracy.tolerance
        before = _largest(accuracy, frames, lobes)
        budget = torch.full_like(before, share)
        for _ in range(HALVINGS):
            found = leave_out(lobes, budget, threads)
            after = _largest(accuracy, frames, found)
            lost = (before <= accuracy.limit) & (after > accuracy.limit)
            if not bool(lost.any()):
                return found, share
            budget = torch.where(lost, budget / 2, budget)
        # the change of a frame bounds that of its error
        room = torch.where(before <= accuracy.limit, accuracy.limit - before, share)
        return leave_out(lobes, torch.minimum(budget, room), threads), share


def _largest(accuracy: Accuracy, frames: list[int], lobes: Lobes) -> torch.Tensor:
    """Return the larger error of each frame.  [F]."""
    found = accuracy.errors(frames, lobes)
    return torch.tensor([max(one.values()) for one in found], dtype=torch.float64)


def one_sharpness(lobes: Lobes) -> int:
    """Count the lobes that are isotropic in every frame; of the sg form, which knows no others, 0.

    [F, N, .].
    """
    if lobes.form is Form.SG:
        return 0
    return int((lobes.sharpness[..., 0] == lobes.sharpness[..., 1]).all(0).sum())


def static(lobes: Lobes) -> int:
    """Count the lobes that have the same values in every one of several frames.  [F, N, .]."""
    if len(lobes.axes) < 2:
        return 0
    same = (lobes.axes == lobes.axes[:1]).flatten(2).all(-1)
    same &= (lobes.sharpness == lobes.sharpness[:1]).all(-1)
    same &= (lobes.amplitude == lobes.amplitude[:1]).all(-1)
    return int(same.all(0).sum())


def account(
    fitted: int, lit: int, lobes: Lobes, repeated: list[int], budget: float | None
) -> dict[str, Any]:
    """Return what was left out, as JSON values.

    Args:
        fitted: Lobes that were fitted.
        lit: How many of them are lit.
        lobes: The shot as it is written.  [F, N, .]
        repeated: Frames that repeat another.
        budget: Of the simplifications; None where there were none.
    """
    simple = budget is not None
    return {
        "budget": budget,
        "black": max(fitted - lit, 0),
        "unneeded": lit - lobes.count,
        "one_sharpness": one_sharpness(lobes) if simple else 0,
        "static": static(lobes) if simple else 0,
        "repeated_frames": repeated,
        "lights": lobes.count,
        "lit_at_once": int((lobes.amplitude > 0).any(-1).sum(-1).max()),
    }
