# SPDX-License-Identifier: Apache-2.0
"""What a stage's keys and rest show together, against the images (docs/guides/keys.md).

    python -m benchmarks.keyed.measure ../shared/hdri/*.exr ../shared/sequences/*
    python -m benchmarks.keyed.measure ../shared/hdri/*.exr --texture
    python -m benchmarks.keyed.measure --synthetic 100 --seed 1

The keys of each input are cut, and the stage is read by pxr alone: lights are what UsdLux says,
seen from the origin along rays through every texel, and the rest is its image.
The errors are those of docs/results/measures.md; of a sequence the worst frame counts. `flux` is
the largest error of a channel, `rim` the largest gradient of the rest within the rim of a matte
over that of the map around it, `pump` how much more the rest changes from frame to frame within the
mattes than around them, both of the logarithm of radiance.

Synthetic cases are those of `cases.py`. Their `corners` are the largest distance of a card's corner
from the one of the rectangle that it shows, over the rectangle's shorter side (or three texels,
where that is more). A second table has the worst of each kind and of all.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch

from asglight.fitting.options import FIT_HEIGHT
from asglight.images import open_sequence
from benchmarks.given import refused_in_a_line
from benchmarks.keyed.rows import SHOWN, Row, print_head, print_row, stage_row, written
from benchmarks.keyed.synthetic import key_options, print_synthetic


def main(argv: Sequence[str] | None = None) -> int:
    """Cut every input and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.keyed.measure", description=__doc__)
    parser.add_argument("inputs", nargs="*", metavar="INPUT", help="images, folders or patterns")
    parser.add_argument("--texture", action="store_true", help="keys carry the pixels of lamps")
    parser.add_argument("--keys", type=int, metavar="N", help="so many keys (default: auto)")
    parser.add_argument("--step", type=int, default=1, metavar="N", help="judge every Nth frame")
    parser.add_argument("--synthetic", type=int, default=0, metavar="N", help="cases by chance")
    parser.add_argument("--seed", type=int, default=1, help="of chance")
    parser.add_argument("--rows", type=int, default=128, help="of a synthetic map")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    heads = ["input", "keys", "keyed %", *SHOWN, "flux", "rim", "pump"]
    if options.inputs:
        print_head([*heads, "MB"])
    for source in options.inputs:
        with refused_in_a_line(parser):
            print_row(judged(source, options).cells())
    if options.synthetic:
        print_synthetic(options, [*heads, "corners"])
    return 0


def judged(source: str, options: argparse.Namespace) -> Row:
    """Cut the keys of an input and judge its stage."""
    keys = key_options(options)
    written_from = open_sequence(source, missing="hold", height=keys.rest_height)
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "keys.usdc"
        report = written(written_from, keys, stage)
        sequence = open_sequence(source, missing="hold", height=FIT_HEIGHT)
        return stage_row(sequence, stage, report.keys or {}, report.bytes, options.step)


if __name__ == "__main__":
    sys.exit(main())
