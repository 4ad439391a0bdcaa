# SPDX-License-Identifier: Apache-2.0
"""The options of a command that say how its stage is written."""

import argparse
from dataclasses import fields
from typing import Any

from asglight.errors import InputError
from asglight.usd.options import (
    DISTANT_LIGHTS,
    UP_AXES,
    Representation,
    StageOptions,
    parse_representations,
)

OUTPUT = "stage: .usda, .usdc or .usd, or .usdz, a package with its images"


def add_stage_options(parser: argparse.ArgumentParser, kept: str | None = None) -> None:
    """Add the options of a stage, in a group of their own.

    Args:
        parser: Of the command.
        kept: Where what is not given is taken from, such as `the first part`; None for defaults.
    """

    def default(value: object) -> str:
        return f"(default: {kept or value})"

    add = parser.add_argument_group("the stage").add_argument
    usual = StageOptions()
    held = (
        f"what the lobes are written as: some of {', '.join(Representation)}, the one that the "
        "stage opens with first; several become variants; the images of dome are written only here "
        "and by asglight export --to dome"
    )
    add(
        "--representations",
        type=representation_list,
        metavar="LIST",
        help=f"{held} {default(','.join(usual.representations))}",
    )
    path = "prim that holds the lobes, such as /World/Lights/Env"
    add("--primary-path", metavar="PATH", help=f"{path} {default(usual.primary_path)}")
    add("--up-axis", choices=UP_AXES, help=f"axis that is up {default(usual.up_axis)}")
    unit = "length of a stage unit in metres, such as 0.01"
    add(
        "--meters-per-unit",
        type=float,
        metavar="LENGTH",
        help=f"{unit} {default(usual.meters_per_unit)}",
    )
    far = "of the cards from the origin, in stage units"
    add("--distance", type=float, metavar="LENGTH", help=f"{far} {default('1000 m')}")
    space = "linear space of the stage's colours, such as ACEScg, Rec.2020 or P3-D65"
    add("--colorspace", metavar="NAME", help=f"{space} {default('Rec.709')}")
    many = "lights of an anisotropic lobe in distant"
    add(
        "--distant-lights",
        type=int,
        choices=DISTANT_LIGHTS,
        help=f"{many} {default(usual.distant_lights)}",
    )
    add(
        "--card-texture",
        action=argparse.BooleanOptionalAction,
        help=f"Gaussian texture of the cards {default('none')}",
    )
    rows = "rows of the images of the dome"
    add("--dome-height", type=int, metavar="ROWS", help=f"{rows} {default(usual.dome_height)}")


def representation_list(text: str) -> tuple[str, ...]:
    """Return the representations that an option lists, as the type of an argument."""
    try:
        return parse_representations(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("representations: ")) from None


def given_stage_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a stage that were given, by the names of `StageOptions`."""
    chosen = {field.name: getattr(arguments, field.name) for field in fields(StageOptions)}
    return {name: value for name, value in chosen.items() if value is not None}
