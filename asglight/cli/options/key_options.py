# SPDX-License-Identifier: Apache-2.0
"""The options of a command that say how keys are found and written."""

import argparse
from typing import Any

from asglight.cli.printing import table
from asglight.errors import InputError
from asglight.usd.options import REST_ROWS_MAX, KeyLights, KeyOptions, Representation

AUTO = "auto"

_NAMES = {"keys_as": "--keys-as", "keys_texture": "--keys-texture", "rest_height": "--rest-height"}


def add_key_options(parser: argparse.ArgumentParser, *, usual: str | None) -> None:
    """Add the options of keys, in a group of their own.

    Args:
        parser: Of the command.
        usual: How many keys there are where nobody says; None for none.
    """
    add = parser.add_argument_group(
        "keys: lamps as lights, and the images without them"
    ).add_argument
    least = "or so many at most" if usual else "so many at most; or 0"
    many = (
        "lights for the lamps of the images: auto, as few as carry most of their light; "
        f"{least} (default: {usual or 'none'})"
    )
    add("--keys", type=_count, metavar="auto|N", help=many, default=usual)
    shine = "what a key is: rect, its lamp's rectangle, or distant, for real-time engines"
    add("--keys-as", choices=[*KeyLights], help=f"{shine} (default: {KeyLights.RECT})")
    texture = "keys carry the pixels of their lamps, so that they look like them"
    add("--keys-texture", action="store_true", default=None, help=texture)
    rows = f"rows of the images of the rest (default: the images' own, {REST_ROWS_MAX} at most)"
    add("--rest-height", type=int, metavar="ROWS", help=rows)


def key_options(arguments: argparse.Namespace) -> KeyOptions | None:
    """Return how keys are found; None where there are none.

    Raises:
        InputError: An option would have no effect.
    """
    shown = arguments.representations or ()
    count = arguments.keys
    if count is None and Representation.KEYS in shown:
        count = AUTO
    if count in (None, 0):
        for name, flag in _NAMES.items():
            if getattr(arguments, name) is not None:
                raise InputError(f"{flag}: given without keys; expected --keys auto too.")
        if Representation.KEYS in shown:
            raise InputError(
                "keys: 0, and the representation keys is asked for; expected one of the two. "
                "Leave out --keys 0."
            )
        return None
    return KeyOptions(
        count=None if count == AUTO else count,
        lights=KeyLights(arguments.keys_as or KeyLights.RECT),
        texture=bool(arguments.keys_texture),
        rest_height=REST_ROWS_MAX if arguments.rest_height is None else arguments.rest_height,
    )


def with_keys(
    chosen: dict[str, Any], keys: KeyOptions | None, held: tuple[str, ...]
) -> dict[str, Any]:
    """Return options of a stage that shows keys, where there are any.

    Args:
        chosen: Options that were given.
        keys: How keys are found; None for none.
        held: What the stage shows where nobody says.
    """
    if keys is None:
        return chosen
    names = chosen.get("representations")
    if names is None:
        names = (Representation.KEYS, *held)
    return {**chosen, "representations": tuple(dict.fromkeys([*names, Representation.KEYS]))}


def key_lines(document: dict[str, Any] | None) -> list[str]:
    """Return what is known of keys, one line each."""
    if document is None:
        return []
    keys = document["keys"]
    if not keys:
        return ["keys: none; no lamp stands out of the images"]
    share = f"{100 * document['share']:.1f} %"
    text = table(HEADER, [_cells(key) for key in keys])
    lines = [f"keys: {len(keys)}, with {share} of the light"]
    return lines + [f"  {line}" for line in text.split("\n")]


HEADER = ("key", "light %", "of its lamp %", "degrees", "color", "stops above", "frames", "rim")
"""Of the table of keys. `rim` is the gradient of the rest at a key's rim over that around."""

HALF_STOPS = 40.0
"""From the least half float to the largest: what is more above the rest has black around it."""


def _cells(key: dict[str, Any]) -> list[str]:
    """Return what is known of a key, in the order of `HEADER`."""
    if key["size_deg"] is None:
        return [key["name"], "no light", *[""] * (len(HEADER) - 2)]
    wide, high = key["size_deg"]
    first, last = key["frames"]
    return [
        key["name"],
        f"{100 * key['share']:.2f}",
        f"{100 * key['carried']:.0f}",
        f"{wide:.1f} x {high:.1f}",
        " ".join(f"{one:.2f}" for one in key["color"]),
        "black around" if key["stops"] > HALF_STOPS else f"{key['stops']:.1f}",
        f"{first}-{last}" if last > first else f"{first}",
        f"{key['rim']:.2f}",
    ]


def _count(text: str) -> str | int:
    if text == AUTO:
        return AUTO
    try:
        count = int(text)
    except ValueError:
        count = -1
    if count < 0:
        raise argparse.ArgumentTypeError(f"{text!r}; expected auto or a number such as 3")
    return count
