# SPDX-License-Identifier: Apache-2.0
import errno
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import commands
import pytest
import sky_files
import torch

import asglight
from asglight.cli import main as cli
from asglight.cli.options import parser
from asglight.errors import InputError

REST = {
    "fit": ["-o", "a.usda"],
    "eval": ["--reference", "a"],
    "export": ["--to", "json"],
    "resample": ["-o", "a.usda"],
}
"""What a command asks for besides."""


@pytest.mark.parametrize("command", sorted(cli.COMMANDS))
def test_every_command_has_help_with_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"example: asglight {command} " in text
    # The result of two is a file, `follow` prints JSON alone; `figures` has the option with each.
    assert ("--json" in text) is (command not in ("view", "export", "follow", "figures"))


def test_the_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    for command, summary in cli.COMMANDS.items():
        assert f"{command} " in text
        assert summary in text


def test_the_help_of_fit_states_defaults_and_units(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["fit", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for part in (
        "number of lobes (default: 15)",
        "frames per second of the stage, such as 24 or 24000/1001 (default: 24)",
        "(default: fast)",
        "(default: asg)",
        "(default: 24000,6000)",
        "{error,hold,interpolate}",
        "some of cards, distant, dome",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("command", "taken"),
    [
        ("fit", "(default: all)"),
        ("compare", "(default: the first)"),
        ("bench", "(default: the first 24, with --quick 8, with --full all)"),
        ("figures lobes", "(the first)"),
        ("figures time", "(default: the first 16)"),
    ],
)
def test_the_help_says_which_frames_are_taken(
    command: str, taken: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*command.split(), "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"frames, such as 1001-1048 or 1001-1048x2 {taken} --layer" in text


def test_python_runs_the_package_as_the_command() -> None:
    words = [sys.executable, "-m", "asglight", "--version"]
    found = subprocess.run(words, capture_output=True, text=True, check=True)
    assert found.stdout == f"asglight {asglight.__version__}\n"


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"asglight {asglight.__version__}\n"


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("view", "--help")])
def test_help_and_version_load_no_torch(arguments: tuple[str, ...]) -> None:
    hook = "import atexit; atexit.register(lambda: print('torch' in sys.modules))"
    assert commands.run_asglight(*arguments, hook=hook).stdout.endswith("False\n")


def raising(error: BaseException) -> Callable[[object], int]:
    def run(arguments: object) -> int:
        raise error

    return run


@pytest.fixture
def info_raises(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], int]:
    """Return a function that runs `asglight info` with an error inside."""
    from asglight.cli.commands import info

    def run(error: BaseException) -> int:
        monkeypatch.setattr(info, "run", raising(error))
        return cli.main(["info", "x.usda"])

    return run


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("a.exr: is 3 x 3; expected 2:1."), 2, "a.exr: is 3 x 3; expected 2:1."),
        (InputError("a\nb: \x1b[2J is no path"), 2, "a b: ?[2J is no path."),
        (MemoryError(), 2, "not enough memory; use fewer lobes or close other programs."),
        (
            RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: 9 bytes"),
            2,
            "not enough memory; use fewer lobes or close other programs.",
        ),
        (
            torch.OutOfMemoryError("CUDA out of memory"),
            2,
            "not enough memory; use fewer lobes or close other programs.",
        ),
        (
            OSError(errno.ENOSPC, "No space left on device", "a.usda"),
            2,
            "a.usda: No space left on device; make room for it.",
        ),
        (KeyboardInterrupt(), 130, "interrupted."),
    ],
)
def test_what_is_no_bug_is_one_line(
    info_raises: Callable[[BaseException], int],
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    status: int,
    line: str,
) -> None:
    assert info_raises(error) == status
    assert capsys.readouterr().err == f"asglight: {line}\n"


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), OSError(errno.EIO, "I/O"), ValueError()])
def test_a_bug_is_a_traceback_and_a_request_to_report_it(
    info_raises: Callable[[BaseException], int],
    capsys: pytest.CaptureFixture[str],
    error: Exception,
) -> None:
    assert info_raises(error) == 1
    text = capsys.readouterr().err
    assert text.startswith("Traceback")
    assert text.splitlines()[-1] == (
        f"asglight: this is a bug in asglight {asglight.__version__}; please report it with the "
        "lines above."
    )


def test_an_interrupted_fit_says_how_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from asglight.cli.commands import fit

    monkeypatch.setattr(fit, "run", raising(KeyboardInterrupt()))
    assert cli.main(["fit", "a.exr", "-o", "a.usda"]) == 130
    assert capsys.readouterr().err == "asglight: interrupted; resume with --resume.\n"


def test_a_reader_that_closes_early_is_no_error() -> None:
    hook = (
        "from asglight.cli.commands import view\n"  # which loads little
        "view.run = lambda arguments: print('x' * 100_000) or 0"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", commands.RUN.format(hook=hook), "view", "x.usda"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 141
    assert process.stderr is not None
    assert process.stderr.read() == b""
    process.stderr.close()


@pytest.mark.parametrize("command", ["fit", "info", "eval", "export", "resample"])
@pytest.mark.parametrize("frames", ["-9", "-9--2", "-9-4x2", "-9,-7,5"])
def test_negative_frames_need_no_equals_sign(
    command: str, frames: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [command, str(tmp_path / "gone"), "--frames", frames]
    found = cli.command_parser(words).parse_args([*words, *REST.get(command, [])])
    assert (found.frames, capsys.readouterr().err) == (frames, "")


def test_a_negative_number_may_have_an_exponent(tmp_path: Path) -> None:
    words = ["view", "day.usda", "--exposure-ev", "-5e-1"]
    assert cli.command_parser(words).parse_args(words).exposure_ev == -0.5


@pytest.mark.parametrize(
    ("text", "rate"),
    [("1e99999999", math.inf), ("24", 24.0), ("23.976", 23.976), ("24000/1001", 24000 / 1001)],
)
def test_a_frame_rate_may_be_a_fraction(text: str, rate: float) -> None:
    assert parser.frame_rate(text) == pytest.approx(rate, rel=1e-15)


@pytest.mark.parametrize(
    ("message", "line"),
    [
        ("is empty", "is empty."),
        ("is empty.", "is empty."),
        ("a\nb\tc. So?", "a b c. So?"),
    ],
)
def test_a_message_is_one_line_that_ends_once(message: str, line: str) -> None:
    assert parser.one_line(message) == line


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_standard_stream_that_is_closed_changes_nothing(closed: str, tmp_path: Path) -> None:
    sky_files.write_frame(tmp_path / "sky.exr", sky_files.sky(1, 16))
    hook = "import sys; from asglight.cli.main import main; sys.exit(main())"
    line = f'"{sys.executable}" -c "{hook}" info {tmp_path / "sky.exr"} --json {closed}'
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert bool(done.stdout) == (">&-" not in closed or closed == "2>&-")
