# SPDX-License-Identifier: Apache-2.0
"""The one option of scripts that measure every map of a folder: `--maps`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from torch import Tensor

from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong


def maps_given(program: str, text: str | None, argv: Sequence[str] | None) -> dict[str, Tensor]:
    """Parse the command line and read the maps.

    Args:
        program: Name of the script.
        text: What `--help` says of it.
        argv: Its arguments; None for those of the process.

    Returns:
        Repaired radiance [H, 2 H, 3] by name.

    Raises:
        SystemExit: There is no map; one line says so.
    """
    parser = argparse.ArgumentParser(prog=program, description=text)
    parser.add_argument("--maps", type=Path, required=True, metavar="DIR", help="latlong OpenEXR")
    folder = parser.parse_args(argv).maps
    paths = sorted(folder.glob("*.exr"))
    if not paths:
        parser.error(f"--maps: {folder}: has no .exr; expected latlong OpenEXR files")
    return {path.stem: read_latlong(path, height=FIT_HEIGHT).radiance for path in paths}
