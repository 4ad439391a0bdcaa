# SPDX-License-Identifier: Apache-2.0
"""All stress cases, and choosing some by name."""

import random
from collections.abc import Sequence

from asglight.errors import InputError
from asglight.judging.stress.case import Case, Group
from asglight.judging.stress.lobes import RECOVERY, STIFF
from asglight.judging.stress.shots import TIME
from asglight.judging.stress.stills import BROKEN, RADIANCE, SHAPE

CASES: tuple[Case, ...] = (*STIFF, *RADIANCE, *SHAPE, *TIME, *BROKEN, *RECOVERY)


def chosen(wanted: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases of some groups, or single ones: `time`, `time/cut`.

    Args:
        wanted: Groups and names; empty for all cases.

    Raises:
        InputError: There is no such group or case.
    """
    named = {f"{case.group}/{case.name}": case for case in CASES}
    for word in wanted:
        group, _, name = word.partition("/")
        if group not in list(Group):
            raise InputError(f"only: {word!r}; expected a group: {', '.join(Group)}.")
        if name and word not in named:
            names = ", ".join(case.name for case in CASES if case.group == group)
            raise InputError(f"only: no case {word!r}; expected {group}/ and one of {names}.")
    if not wanted:
        return CASES
    return tuple(case for place, case in named.items() if {place, str(case.group)} & set(wanted))


def sampled(share: float) -> list[str]:
    """Return names of cases that hold for all: those of `time`, and some of the others by chance.

    Args:
        share: Of the others, in (0, 1].

    Returns:
        `group/name` of each, so that a run can be repeated.

    Raises:
        InputError: The share is not in its range.
    """
    if not 0 < share <= 1:
        raise InputError(f"sample: {share:.10g}; expected a share above 0, at most 1.")
    rest = [f"{case.group}/{case.name}" for case in CASES if case.group is not Group.TIME]
    return [str(Group.TIME), *sorted(random.sample(rest, max(1, round(share * len(rest)))))]
