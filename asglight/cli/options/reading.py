# SPDX-License-Identifier: Apache-2.0
"""How images are read, of the options that `add_input_options` adds; loads nothing large."""

import argparse

from asglight.images.options import LOST_MAX, ReadOptions


def read_options(arguments: argparse.Namespace) -> ReadOptions:
    """Return how images are read, of the options of `add_input_options`."""
    return ReadOptions(arguments.layer, arguments.eye, arguments.input_colorspace, arguments.repair)


def given(reading: ReadOptions) -> dict[str, str]:
    """Return the options that say so, by name, where they are not the usual ones."""
    values = {
        "--layer": reading.layer,
        "--eye": reading.eye,
        "--input-colorspace": reading.colorspace,
        "--repair": None if reading.repair == LOST_MAX else f"{reading.repair:g}",
    }
    return {name: value for name, value in values.items() if value is not None}
