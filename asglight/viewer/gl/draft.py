# SPDX-License-Identifier: Apache-2.0
"""How coarse the balls are shaded while something moves, so that the picture follows the hand."""

import moderngl

SLOW_S = 1 / 72
"""A third of a frame of film: balls that take longer are too fine. Without a GPU the rest of the
window takes the other two thirds."""

FAST_S = SLOW_S / 5
"""Balls that take less may be finer: four times the pixels, as from 2 to 1, stay below SLOW_S."""

DIVISOR_MAX = 4
"""Coarser pictures would not show a highlight of a tenth of a ball any more."""

UNRELIABLE_NS = 4_000_000_000
"""Just below the 4.3 seconds at which 32 bits of nanoseconds end."""


class Draft:
    """Chooses how many pixels of the screen one shaded pixel stands for, along a side."""

    def __init__(self) -> None:
        """Start fine."""
        self.divisor = 1

    def took(self, seconds: float | None) -> None:
        """Learn how long a picture took that was shaded while something moved, if one was."""
        if seconds is None:
            return
        if seconds > SLOW_S:
            self.divisor = min(self.divisor + 1, DIVISOR_MAX)
        elif seconds < FAST_S:
            self.divisor = max(self.divisor - 1, 1)


class Stopwatch:
    """Measures what the GPU does within a `with` block."""

    def __init__(self, context: moderngl.Context) -> None:
        """Make the query."""
        self._query = context.query(time=True)
        self._has_run = False

    def __enter__(self) -> None:
        """Start."""
        self._query.__enter__()

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self._query.__exit__()
        self._has_run = True

    def seconds(self) -> float | None:
        """Return how long the last block took, once; None if there was none since."""
        has_run, self._has_run = self._has_run, False
        if not has_run:
            return None
        # moderngl keeps 32 bits of nanoseconds, and Mesa's first query is far off.
        nanoseconds = self._query.elapsed
        return nanoseconds * 1e-9 if nanoseconds < UNRELIABLE_NS else None
