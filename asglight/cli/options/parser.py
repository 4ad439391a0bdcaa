# SPDX-License-Identifier: Apache-2.0
"""The argument parser of every command: one-line errors, an example in each help text."""

import argparse
import difflib
import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NoReturn, get_args

from asglight.errors import InputError
from asglight.images.options import LOST_MAX, Eye
from asglight.images.output import check_names_file

NEAR = 0.7
"""Likeness of a name that is asked after: one letter more, less or other of six."""


NEGATIVE = re.compile(r"-\.?\d")
"""How a value begins that is no option: a negative number, or a range from one. No option of ours
begins with a digit."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, as every other error of asglight."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take the arguments of ArgumentParser; options are never abbreviated."""
        # An abbreviation that works today would mean another option tomorrow.
        kwargs.setdefault("allow_abbrev", False)
        kwargs.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(*args, **kwargs)
        self._negative_number_matcher = NEGATIVE  # argparse's own takes `-9` for one, not `-9--2`

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        """Parse; an option that nobody knows is an error of its command, with the nearest one."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            own = self.command_of(args or ())
            own.error(f"unrecognized arguments: {' '.join(unknown)}{own.near(unknown)}")
        return found

    def command_of(self, words: Sequence[str]) -> "Parser":
        """Return the parser of the command that words begin with; without one, this parser."""
        every = [each for each in self._actions if isinstance(each, argparse._SubParsersAction)]
        found = every[0].choices.get(words[0]) if every and words else None
        return self if found is None else found.command_of(words[1:])

    def near(self, unknown: Sequence[str]) -> str:
        """Return a question for the option that comes nearest to one nobody knows, if one does."""
        for word in unknown:
            name = word.partition("=")[0]
            close = difflib.get_close_matches(name, self._option_string_actions, 1, NEAR)
            if name.startswith("--") and close:
                return f". Did you mean {close[0]}?"
        return ""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with 2."""
        self.exit(2, f"asglight: {one_line(message)} See {self.prog} --help.\n")


def one_line(message: str) -> str:
    """Return a message as one printable line that ends as a sentence does."""
    text = " ".join(message.split())
    # Names may hold anything; what is not printable may move a terminal's cursor.
    printable = "".join(c if c.isprintable() else "?" for c in text)
    return printable if printable.endswith((".", "?")) else f"{printable}."


def add_input_options(parser: argparse.ArgumentParser, taken: str = "default: all") -> None:
    """Add the options that choose frames, layer and colours of an image sequence.

    Args:
        parser: Of the command.
        taken: Which frames it takes.
    """
    parser.add_argument(
        "--frames",
        metavar="RANGE",
        help=f"frames, such as 1001-1048 or 1001-1048x2 ({taken})",
    )
    add_reading_options(parser)


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose layer and colours of images, and what of them may be lost."""
    parser.add_argument(
        "--layer",
        metavar="NAME",
        help="layer or part of OpenEXR files (default: the beauty: plain R, G, B, or by its name)",
    )
    parser.add_argument(
        "--eye", choices=get_args(Eye), help="eye of stereo images: views, or halves of the image"
    )
    parser.add_argument(
        "--input-colorspace",
        metavar="NAME",
        help="colour space of the images, such as ACEScg or sRGB, whatever they state (default: "
        "what they state, else linear Rec.709)",
    )
    parser.add_argument(
        "--repair",
        type=float,
        default=LOST_MAX,
        metavar="SHARE",
        help="of a frame's light or texels that may be lost to NaN or negative values, 0 to 1 "
        "(default: %(default)s; more is an error)",
    )


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
    parser.add_argument(
        "--json", action="store_true", help="print one JSON document on standard output"
    )


class _FollowReferences(argparse.Action):
    """Let stages refer to layers outside their folder, for this run."""

    def __call__(self, *_: object) -> None:
        from asglight.usd.check.trust import follow_references

        follow_references()


def add_follow_option(parser: argparse.ArgumentParser) -> None:
    """Add --follow-references, of commands that read stages."""
    parser.add_argument(
        "--follow-references",
        action=_FollowReferences,
        nargs=0,
        help="open the layers that a stage refers to outside its own folder",
    )


def add_rig_option(parser: argparse.ArgumentParser) -> None:
    """Add --rig, of commands that read one stage."""
    parser.add_argument(
        "--rig",
        metavar="PRIM",
        help="prim that holds the lobes, such as /World/Env, of a stage with several",
    )


def frame_rate(text: str) -> float:
    """Parse a frame rate: `24`, `23.976` or `24000/1001`."""
    try:
        return float(Fraction(text) if "/" in text else text)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no frame rate; expected a number such as 24, 23.976 or 24000/1001"
        ) from None


def file_name(text: str) -> str:
    """Take the name of a file to write."""
    try:
        check_names_file(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removesuffix(".")) from None
    return text


def step_pair(text: str) -> tuple[int, int]:
    """Parse `FIRST,NEXT`."""
    try:
        first, following = map(int, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}; expected two whole numbers such as 24000,6000"
        ) from None
    return first, following
