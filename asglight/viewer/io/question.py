# SPDX-License-Identifier: Apache-2.0
"""What a window asks."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Question:
    """Something to be answered before anything else.

    Attributes:
        title: What it is about.
        text: What is asked.
        answers: What the buttons say and do; the last is also that of Escape.
    """

    title: str
    text: str
    answers: tuple[tuple[str, Callable[[], None]], ...]
