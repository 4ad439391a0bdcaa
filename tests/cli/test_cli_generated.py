# SPDX-License-Identifier: Apache-2.0
"""Hundreds of command lines of odd values, and none ends in a traceback.

The options are those that the parsers have, so that a new one is tried without a word here. What
would take long, a fit or a picture, ends where it would begin.
"""

import argparse
import functools
import os
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import sky_files
import torch
from effort import tries
from usd_tracks import moving

from asglight.arrays import feeds
from asglight.cli import farm
from asglight.cli.commands import bench, compare, demo, evaluate, figures, stress
from asglight.cli.main import COMMANDS, command_parser, main
from asglight.cli.sources import built_in, opening
from asglight.errors import InputError
from asglight.judging.stress import run as stress_run
from asglight.shots import job
from asglight.usd import write_usd
from asglight.usd.check import trust
from asglight.viewer import app

LINES = tries(1200)
PROGRESS = re.compile(r"[\w @#-]+ \(\d+\)|.* Lights are named anew|.*: shown without lobes: .*")
"""What a command says that it does, before it does."""

ODD_NUMBERS = ["0", "-1", "1", "2", "3", "15", "1e9", "-0", "nan", "inf", "-inf", "1.5", "1/0"]
ODD_NUMBERS += ["9" * 40, "0x10", "", " ", "١", "1,2", "24000/1001", "1e-320", "2,1", "64x32"]
ODD_RANGES = [
    "1001-1004",
    "1001-1004x2",
    "1001.5",
    "1001-1002x0.5",
    "-5",
    "5-1",
    "x",
    "1-",
    ",",
    "",
]
ODD_RANGES += ["1-999999999999", "1001,1001", "9" * 200, "1001-1048x0", "#", "1-10y3", "1:2"]
ODD_WORDS = [
    "",
    " ",
    "a",
    "R",
    "beauty",
    "ACEScg",
    "srgb",
    "größe",
    "a\nb",
    "\t",
    "/",
    "/World/Env",
]
ODD_WORDS += [
    "/a/b c",
    "//",
    "--",
    "-x",
    "%s",
    "{}",
    "[",
    "\\",
    "\udcff",
    "\x1b[2J",
    "a" * 5000,
    ".",
]
FILES = [
    "still.exr",
    "in",
    "in/sky.####.exr",
    "in/sky.%04d.exr",
    "in/sky.@@@@.exr",
    "in/sky.$F4.exr",
]
FILES += ["in/sky.1001-1002#.exr", "in/sky.1001-1009x2#.exr", "sky@2x.####.exr", "a#b.####.exr"]
FILES += [
    "shot.usda",
    "shot.usdc",
    "shot.usdz",
    "shot.usd",
    "lobes.json",
    "lights.npy",
    "text.usda",
]
FILES += ["cut.exr", "zero.exr", "zero.usda", "zero.npy", "text.exr", "nowhere", "nowhere/x.usda"]
FILES += [
    "folder.usda",
    "folder.exr",
    "empty",
    "loop",
    "loop.exr",
    "loop.usda",
    "pipe.exr",
    "closed",
]
FILES += ["many", "fractions", "fractions/sky.####.exr", "out.usda", "out.usdc", "out.usdz", "out"]
FILES += [
    "out.json",
    "out.glsl",
    "out.npy",
    "out.png",
    "out.exr",
    "renders\\out.usda",
    "in\\sky.#.exr",
]
FILES += [
    "-",
    "--",
    ".",
    "..",
    "",
    "/",
    "/dev/null",
    "x" * 300 + ".usda",
    "ü.usda",
    "a b.usda",
    "~",
]
FILES += [
    "a\nb.usda",
    "\udcff.usda",
    "[1].usda",
    "{a,b}.exr",
    "*.usda",
    "?.exr",
    "%.exr",
]
FILES += [
    "#",
    "@",
    "%d",
    "####",
    "sky.#.#.exr",
    "in/sky.1-3y9#.exr",
    "in/sky.9-1#.exr",
    "$F",
    "1001.exr",
]


class _CutError(InputError):
    """A command has come to where it works."""


def cut(*_: object, **__: object) -> None:
    """End a command."""
    raise _CutError("cut: here the work would begin.")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Fill a folder with good and bad things, go there, and cut what takes long."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    sky_files.write_sequence(tmp_path / "in")
    for name in ("still", "sky@2x.0001", "a#b.0001", "1001"):
        sky_files.write_frame(tmp_path / f"{name}.exr", sky_files.sky(0))
    sky_files.write_sequence(tmp_path / "fractions", range(1001, 1003))
    sky_files.write_frame(tmp_path / "fractions" / "sky.1001.5.exr", sky_files.sky(0))
    sky_files.write_sequence(tmp_path / "many", range(1001, 1003))
    sky_files.write_frame(tmp_path / "many" / "other.exr", sky_files.sky(0))
    for suffix in ("usda", "usdc", "usdz", "usd"):
        write_usd(moving(range(1001, 1004)), tmp_path / f"shot.{suffix}", dome_height=2)
    np.save(tmp_path / "lights.npy", np.ones((2, 7), np.float32))
    good = (tmp_path / "still.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(good[: len(good) // 2])
    for name in ("text.exr", "text.usda", "lobes.json"):
        (tmp_path / name).write_text("no such thing")
    for name in ("zero.exr", "zero.usda", "zero.npy"):
        (tmp_path / name).touch()
    for name in ("folder.usda", "folder.exr", "empty", "closed"):
        (tmp_path / name).mkdir()
    for name in ("loop", "loop.exr", "loop.usda"):
        (tmp_path / name).symlink_to(tmp_path / name)
    os.mkfifo(tmp_path / "pipe.exr")
    (tmp_path / "closed").chmod(0)
    for place, name in [
        (job, "fitted_shot"),
        (compare, "compare"),
        (bench, "measure"),
        (demo, "write_sky"),
        (evaluate, "judge"),
        (farm, "shots_from"),
        (stress_run, "run_case"),
        (stress, "tools_at_hand"),
        (opening, "LiveSource"),
        (app, "show"),
        (app, "write_screenshot"),
        (app, "check"),
        (built_in, "environment"),
        (feeds.Folder, "_first_whole"),  # which waits for images to come
    ]:
        monkeypatch.setattr(place, name, cut)
    monkeypatch.setattr(trust, "_ASKED", trust._Asked())  # which --follow-references changes
    monkeypatch.setattr(figures, "DRAWN", dict.fromkeys(figures.DRAWN, cut))
    yield tmp_path
    (tmp_path / "closed").chmod(0o700)


@functools.cache
def parsers_of(command: str) -> list[tuple[list[str], argparse.ArgumentParser]]:
    """Return the words of a command and its parser; one for each figure of `figures`."""
    of_all = command_parser([command])
    (subparsers,) = (one for one in of_all._actions if isinstance(one, argparse._SubParsersAction))
    parser = subparsers.choices[command]
    below = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]
    if not below:
        return [([command], parser)]
    return [([command, name], one) for name, one in below[0].choices.items()]


def value_of(action: argparse.Action, pick: random.Random) -> str:
    """Return a value for an option: most often of its kind, else of any."""
    kinds: list[list[str]] = [ODD_NUMBERS, ODD_RANGES, ODD_WORDS, FILES]
    if pick.random() < 0.1:
        return pick.choice(pick.choice(kinds))
    if action.choices is not None and pick.random() < 0.8:
        return str(pick.choice(list(action.choices)))
    name = (action.metavar if isinstance(action.metavar, str) else "") or action.dest.upper()
    if name in ("RANGE", "FRAMES", "FRAME"):
        return pick.choice(ODD_RANGES)
    if any(word in name for word in ("STAGE", "FILE", "DIR", "INPUT", "IMAGES", "PNG", "ARRAY")):
        return pick.choice(FILES)
    return pick.choice(ODD_NUMBERS if action.type is not None else ODD_WORDS)


def line_of(command: str, pick: random.Random) -> list[str]:
    """Return a command line: what is required most often, and a few options."""
    words, parser = pick.choice(parsers_of(command))
    words = list(words)
    actions = [one for one in parser._actions if not isinstance(one, argparse._HelpAction)]
    for action in actions:
        is_wanted = action.required or not action.option_strings
        if pick.random() > (0.95 if is_wanted else 0.15):
            continue
        if action.option_strings:
            words.append(pick.choice(action.option_strings))
        if action.nargs != 0:
            count = pick.choice([1, 1, 1, 2]) if action.nargs in ("+", "*") else 1
            words += [value_of(action, pick) for _ in range(count)]
    if pick.random() < 0.03:
        words.insert(pick.randrange(len(words) + 1), pick.choice(ODD_WORDS + FILES))
    return words


@pytest.mark.thorough
@pytest.mark.usefixtures("here")
def test_no_command_line_ends_in_a_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    pick = random.Random(0)
    commands = list(COMMANDS)
    ended: dict[int, int] = {}
    good = 0  # those that end well, or come to where the work begins
    faults: list[tuple[int, list[str], str]] = []
    for _ in range(LINES):
        line = line_of(pick.choice(commands), pick)
        status = main(line)
        said = capfd.readouterr().err
        ended[status] = ended.get(status, 0) + 1
        good += status == 0 or "cut: here" in said
        lines = [one for one in said.splitlines() if not PROGRESS.fullmatch(one)]
        is_one_line = len(lines) == 1 and lines[0].startswith("asglight: ")
        if status not in (0, 2, 3, 130) or (status == 2 and not is_one_line):
            faults.append((status, line, said))
    assert not faults
    assert ended[2] > LINES // 2  # these are odd lines; and some are good
    assert good > 0


def test_the_generator_tries_every_option() -> None:
    pick, tried = random.Random(0), set()
    for _ in range(4800):
        tried.update(word for word in line_of(pick.choice(list(COMMANDS)), pick))
    every: Callable[[str], set[str]] = lambda command: {  # noqa: E731
        name
        for _, parser in parsers_of(command)
        for action in parser._actions
        for name in action.option_strings
        if not isinstance(action, argparse._HelpAction)
    }
    assert set().union(*map(every, COMMANDS)) <= tried
