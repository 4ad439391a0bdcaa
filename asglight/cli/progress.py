# SPDX-License-Identifier: Apache-2.0
"""Progress on standard error: a bar on a terminal, plain lines everywhere else."""

import contextlib
import os
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Protocol, TypeVar

from asglight.cli.printing import counted, duration, percent
from asglight.shots.events import (
    Event,
    Farmed,
    FrameDone,
    Keyed,
    Notice,
    Prerolled,
    Refined,
    Searched,
    Started,
    StepDone,
)

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

STEP_LINE_SECONDS = 30.0
"""Between two lines about slow work: often enough to see that it lives, few in a log."""

BARS_MAX = 8
"""Bars of finished work on a terminal: with more, that of what runs would be below its last row."""

_Item = TypeVar("_Item")


class Reporter(Protocol):
    """Takes the events of a shot, and follows other work item by item."""

    def __call__(self, event: Event) -> None:
        """Show an event."""
        ...

    def follow(self, items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        """Pass items on and show how many have been."""
        ...


@contextlib.contextmanager
def reporter() -> Iterator[Reporter]:
    """Open the reporter that suits standard error."""
    # what rich asks; it is not loaded for a log
    if not (sys.stderr.isatty() or {"FORCE_COLOR", "TTY_COMPATIBLE"} & os.environ.keys()):
        yield Lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines()
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TextColumn("{task.fields[numbers]}"),
    )
    with Progress(*columns, console=console, expand=True) as progress:
        yield Bar(progress)


class Lines:
    """One plain line for each finished frame; for a slow frame, one now and then."""

    def __init__(self) -> None:
        """Start the clock."""
        self._last_line = time.monotonic()

    def __call__(self, event: Event) -> None:
        """Print what deserves a line."""
        match event:
            case FrameDone():
                self._print(frame_line(event))
            case Notice(text=text):
                self._print(f"asglight: {text}")
            case Searched():
                self._print(search_line(event))
            case Refined():
                self._print(f"refined {event.done}/{event.frames}")
            case Keyed() if time.monotonic() - self._last_line >= STEP_LINE_SECONDS:
                self._print(f"{event.label} {event.done}/{event.frames}")
            case Prerolled() if time.monotonic() - self._last_line >= STEP_LINE_SECONDS:
                self._print(f"preroll {event.done}/{event.frames}")
            case StepDone() if time.monotonic() - self._last_line >= STEP_LINE_SECONDS:
                self._print(f"frame {event.frame}  {step_numbers(event)}")
            case Farmed(finished=str(part)):
                self._print(f"{part} finished  {farm_numbers(event)}")
            case Farmed() if time.monotonic() - self._last_line >= STEP_LINE_SECONDS:
                self._print(farm_numbers(event))
            case Started() | Farmed() | Keyed() | Prerolled() | StepDone():
                pass

    def follow(self, items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        """Print one line at the start, and for slow work one now and then."""
        self._print(f"{label} ({count})")
        for done, item in enumerate(items):
            if done and time.monotonic() - self._last_line >= STEP_LINE_SECONDS:
                self._print(f"{label} {done}/{count}")
            yield item

    def _print(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)
        self._last_line = time.monotonic()


class Bar:
    """A bar for each kind of work."""

    def __init__(self, progress: "Progress") -> None:
        """Draw on a running rich progress."""
        self._progress = progress
        self._fit: TaskID | None = None
        self._refine: TaskID | None = None
        self._preroll: TaskID | None = None
        self._keys: dict[str, TaskID] = {}
        self._followed: list[TaskID] = []

    def __call__(self, event: Event) -> None:
        """Move the bar of the fit."""
        if isinstance(event, Notice):
            self._progress.console.print(f"asglight: {event.text}", markup=False, highlight=False)
            return
        if isinstance(event, Started):
            self._fit = self._progress.add_task(
                "fitting", total=event.frames, completed=event.done, numbers=""
            )
            self._refine = None
            return
        if isinstance(event, Farmed):
            if self._fit is None:
                self._fit = self._progress.add_task("fitting", total=event.frames, numbers="")
            self._progress.update(self._fit, completed=event.done, numbers=farm_numbers(event))
            return
        if isinstance(event, Keyed):
            if event.label not in self._keys:
                self._keys[event.label] = self._progress.add_task(
                    event.label, total=event.frames, numbers=""
                )
            self._progress.update(self._keys[event.label], completed=event.done)
            return
        assert self._fit is not None, "an event before the start"
        if isinstance(event, Refined):
            if self._refine is None:
                self._refine = self._progress.add_task("refining", total=event.frames, numbers="")
            self._progress.update(self._refine, completed=event.done)
            return
        if isinstance(event, Prerolled):
            if self._preroll is None:
                self._preroll = self._progress.add_task("preroll", total=event.frames, numbers="")
            self._progress.update(self._preroll, completed=event.done)
            return
        if isinstance(event, Searched):
            self._progress.update(self._fit, numbers=search_line(event))
        elif isinstance(event, StepDone):
            numbers = f"frame {event.frame}  {step_numbers(event)}"
            self._progress.update(self._fit, numbers=numbers)
        else:
            numbers = f"frame {event.frame}  {frame_numbers(event)}"
            self._progress.update(self._fit, completed=event.position, numbers=numbers)

    def follow(self, items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        """Move a bar of its own."""
        task = self._progress.add_task(label, total=count, numbers="")
        for item in items:
            yield item
            self._progress.advance(task)
        self._followed.append(task)
        for old in self._followed[:-BARS_MAX]:
            self._progress.update(old, visible=False)


def search_line(event: Searched) -> str:
    """Return a number of lobes that was tried as one line of a log."""
    return f"frame {event.frame} with {counted(event.lobes, 'lobe')}: error {event.error:.4f}"


def frame_line(event: FrameDone) -> str:
    """Return a finished frame as one line of a log."""
    line = f"frame {event.frame} ({event.position}/{event.frames})  {frame_numbers(event)}"
    if event.repeats is not None:
        line = f"{line}, as frame {event.repeats}"
    # Negative texels are in nearly every frame of some sequences; the summary counts them.
    if event.repair.filled_from or event.repair.nonfinite or event.repair.infinite:
        return f"{line}  [{event.repair.sentence()}]"
    return line


def frame_numbers(event: FrameDone) -> str:
    """Return loss, flux error and times of a finished frame."""
    took, left = duration(event.seconds), duration(event.seconds_left)
    return f"loss {event.loss:.4g}  flux {percent(event.flux_error)}  {took}, {left} left"


def farm_numbers(event: Farmed) -> str:
    """Return how far a farm has come."""
    left = "" if event.seconds_left is None else f", {duration(event.seconds_left)} left"
    return f"{event.done} of {counted(event.frames, 'frame')}{left}"


def step_numbers(event: StepDone) -> str:
    """Return step and loss within a frame."""
    return f"step {event.step}/{event.steps}  loss {event.loss:.4g}"
