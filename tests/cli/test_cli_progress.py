# SPDX-License-Identifier: Apache-2.0
import io

import pytest
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn

from asglight.cli import printing, progress
from asglight.images import Repair
from asglight.shots.events import (
    Farmed,
    FrameDone,
    Keyed,
    Notice,
    Prerolled,
    Refined,
    Started,
    StepDone,
)

FRAME = FrameDone(1001, 1, 48, 0.412, 1e-4, 0.4, 18.8, Repair(negative=3))


def test_a_finished_frame_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    lines = progress.Lines()
    lines(Started(48, 0))
    lines(FRAME)
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "frame 1001 (1/48)  loss 0.412  flux +0.01 %  0.4 s, 19 s left\n"


@pytest.mark.parametrize(
    "repair", [Repair(nonfinite=1), Repair(filled_from=(1000,)), Repair(filled_from=(1000, 1002))]
)
def test_a_frame_that_was_damaged_or_missing_says_so(repair: Repair) -> None:
    event = FrameDone(1001, 1, 48, 0.4, 0.0, 0.4, 18.8, repair)
    assert progress.frame_line(event).endswith(f"  [{repair.sentence()}]")


def test_a_notice_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    progress.Lines()(Notice("mind the gap"))
    assert capsys.readouterr().err == "asglight: mind the gap\n"


def test_refined_frames_are_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    progress.Lines()(Refined(16, 48))
    assert capsys.readouterr().err == "refined 16/48\n"


def test_a_slow_frame_gives_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    lines = progress.Lines()
    for step in range(1, 101):
        now[0] += 1.0
        lines(StepDone(1001, step, 24000, 0.5))
    assert capsys.readouterr().err.splitlines() == [
        f"frame 1001  step {step}/24000  loss 0.5" for step in (30, 60, 90)
    ]


def test_a_farm_tells_of_finished_parts_and_else_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    lines = progress.Lines()
    lines(Farmed(0, 96, None))
    for done in range(1, 41):
        now[0] += 1.0
        lines(Farmed(done, 96, 96.0 - done))
    lines(Farmed(50, 96, 46.0, "day 1001-1050"))
    assert capsys.readouterr().err.splitlines() == [
        "30 of 96 frames, 1 min 06 s left",
        "day 1001-1050 finished  50 of 96 frames, 46 s left",
    ]


def test_a_long_preroll_gives_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    lines = progress.Lines()
    for done in range(1, 71):
        now[0] += 1.0
        lines(Prerolled(done, 240))
    assert capsys.readouterr().err.splitlines() == ["preroll 30/240", "preroll 60/240"]
    for done in range(1, 51):
        now[0] += 1.0
        lines(Keyed("cutting keys", done, 240))
    assert capsys.readouterr().err.splitlines() == ["cutting keys 20/240", "cutting keys 50/240"]


def bar_on(screen: io.StringIO) -> Progress:
    """Return a bar that is drawn when it is asked to be."""
    columns = (
        TextColumn("{task.description}"),
        MofNCompleteColumn(),
        TextColumn("{task.fields[numbers]}"),
    )
    console = Console(file=screen, force_terminal=True, width=120)
    return Progress(*columns, console=console, auto_refresh=False)


def test_the_bar_shows_a_preroll_and_a_farm() -> None:
    screen = io.StringIO()
    with bar_on(screen) as shown:
        bar = progress.Bar(shown)
        bar(Started(20, 0))
        bar(Prerolled(1, 14))
        bar(Prerolled(2, 14))
        bar(Keyed("looking for lamps", 3, 17))
        bar(Keyed("looking for lamps", 5, 17))
        shown.refresh()
        farm = progress.Bar(shown)
        farm(Farmed(3, 96, None))
        farm(Farmed(4, 96, 9.0, "day 1001-1050"))
        shown.refresh()
    text = screen.getvalue()
    assert " 2/14" in text
    assert "looking for lamps" in text
    assert " 5/17" in text
    assert " 4/96" in text
    assert "4 of 96 frames, 9.0 s left" in text


def test_work_item_by_item_is_passed_on(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.Lines().follow("abc", "judging", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err == "judging (3)\n"


def test_slow_work_has_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter([0, 0, 29, 30, 30, 59])  # of each look at the clock; a line looks once more
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(times))
    assert list(progress.Lines().follow("abcd", "fitting", 4)) == ["a", "b", "c", "d"]
    assert capsys.readouterr().err == "fitting (4)\nfitting 2/4\n"


def test_the_bar_shows_the_same_numbers() -> None:
    screen = io.StringIO()
    with bar_on(screen) as shown:
        bar = progress.Bar(shown)
        bar(Started(48, 0))
        bar(Notice("mind [the] gap"))
        bar(StepDone(1001, 3, 9, 0.5))
        shown.refresh()
        assert "frame 1001  step 3/9  loss 0.5" in screen.getvalue()
        bar(FRAME)
        bar(Refined(16, 48))
        bar(Refined(32, 48))
        assert list(bar.follow("ab", "judging", 2)) == ["a", "b"]
        shown.refresh()
    text = screen.getvalue()
    assert "asglight: mind [the] gap" in text
    assert progress.frame_numbers(FRAME) in text
    assert "judging" in text
    assert "2/2" in text
    assert "refining" in text
    assert "32/48" in text


def test_a_terminal_gets_the_bar_and_a_file_gets_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    with progress.reporter() as report:
        assert isinstance(report, progress.Lines)
    # what rich takes for a terminal, and is not asked for where there is none
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    with progress.reporter() as report:
        assert isinstance(report, progress.Bar)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (9.94, "9.9 s"),
        (9.96, "10 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (200, "3 min 20 s"),
        (3900, "1 h 05 min"),
        (100_000, "27 h 46 min"),
    ],
)
def test_a_duration_is_told_in_its_two_largest_units(seconds: float, text: str) -> None:
    assert printing.duration(seconds) == text


@pytest.mark.parametrize(
    ("count", "text"),
    [(999, "999 B"), (1000, "1 kB"), (312_400, "312 kB"), (2_500_000, "2.5 MB"), (3e9, "3 GB")],
)
def test_a_size_is_told_in_decimal_units(count: int, text: str) -> None:
    assert printing.size(count) == text


@pytest.mark.parametrize(
    ("ratio", "text"),
    [(1e-4, "+0.01 %"), (-0.5, "-50.00 %"), (-1e-9, "0.00 %"), (1e-9, "0.00 %"), (None, "unknown")],
)
def test_an_error_in_percent_has_a_sign_unless_it_is_zero(ratio: float | None, text: str) -> None:
    assert printing.percent(ratio) == text


def test_a_table_is_aligned() -> None:
    assert printing.table(["", "env"], [["a", "1"], ["bcd", "1000"]]) == (
        "      env\na       1\nbcd  1000"
    )


def test_bars_of_finished_work_make_room_for_what_runs() -> None:
    console = Console(file=io.StringIO(), force_terminal=True)
    with Progress(console=console) as shown:
        bar = progress.Bar(shown)
        for place in range(progress.BARS_MAX + 3):
            assert list(bar.follow("ab", f"part {place}", 2)) == ["a", "b"]
        visible = [task.description for task in shown.tasks if task.visible]
    assert visible == [f"part {place}" for place in range(3, progress.BARS_MAX + 3)]
