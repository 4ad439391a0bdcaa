# SPDX-License-Identifier: Apache-2.0
"""Which stages are opened unchecked, and whether layers outside a stage's folder are opened."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass
class _Asked:
    follows_outside: bool = False


_ASKED = _Asked()
_IS_OURS: ContextVar[bool] = ContextVar("is_ours", default=False)


def follow_references() -> None:
    """From now on open the layers that a stage refers to outside its own folder.

    Call it for stages whose origin is known; `--follow-references` does. Without it such a stage is
    refused, because it could make asglight open any file of this computer or of its network.
    """
    _ASKED.follows_outside = True


def follows_references() -> bool:
    """Tell whether layers outside a stage's folder are opened."""
    return _ASKED.follows_outside


@contextmanager
def our_own() -> Iterator[None]:
    """Open what asglight has just written without checking it as a file from outside."""
    before = _IS_OURS.set(True)
    try:
        yield
    finally:
        _IS_OURS.reset(before)


def is_our_own() -> bool:
    """Tell whether stages are opened unchecked."""
    return _IS_OURS.get()
