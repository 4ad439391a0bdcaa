# SPDX-License-Identifier: Apache-2.0
"""The reference of the command line, written out of its parsers."""

import argparse
from collections.abc import Iterator

from asglight.cli.main import COMMANDS, command_parser


def reference() -> str:
    """Return a section of Markdown for every command, in the order of `asglight --help`."""
    return "\n\n".join(section(name, parser_of(name)) for name in COMMANDS)


def parser_of(name: str) -> argparse.ArgumentParser:
    """Return the parser of one command."""
    choices = [
        action.choices
        for action in command_parser([name])._actions
        if isinstance(action, argparse._SubParsersAction)
    ]
    return choices[0][name]


def section(name: str, parser: argparse.ArgumentParser) -> str:
    """Return what one command does, its usage, and a table for each group of its options."""
    parts = [f"## asglight {name}", parser.description or "", _code(parser.format_usage())]
    parts += [
        f"**{(group.title or 'options').capitalize()}**\n\n{table}"
        for group in parser._action_groups
        if (table := _table(group))
    ]
    return "\n\n".join([*parts, _code(parser.epilog or "")])


def _table(group: argparse._ArgumentGroup) -> str:
    rows = list(_rows(group))
    return "\n".join(["| option | what it does |", "|---|---|", *rows]) if rows else ""


def _rows(group: argparse._ArgumentGroup) -> Iterator[str]:
    for action in group._group_actions:
        if action.help != argparse.SUPPRESS and "--help" not in action.option_strings:
            text = (action.help or "") % vars(action)
            yield f"| `{_cell(_called(action))}` | {_cell(text)} |"


def _called(action: argparse.Action) -> str:
    """Return an option as one types it: its names, and what stands for its value."""
    choices = None if action.choices is None else "{" + ",".join(map(str, action.choices)) + "}"
    value = action.metavar or choices or action.dest.upper()
    value = value if isinstance(value, str) else " ".join(value)
    if not action.option_strings:
        return value
    names = ", ".join(action.option_strings)
    return names if action.nargs == 0 else f"{names} {value}"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def _code(text: str) -> str:
    return f"```text\n{text.strip()}\n```"
