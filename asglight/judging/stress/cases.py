# SPDX-License-Identifier: Apache-2.0
"""All stress cases, and choosing some by name."""

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
