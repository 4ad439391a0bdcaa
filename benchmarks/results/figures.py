# SPDX-License-Identifier: Apache-2.0
"""Bring what `asglight figures` wrote into the docs: small pictures, and captions as one page.

    python -m benchmarks.results.figures figures-output figures-output/small

Pictures get 200 colours with dither, which a reader does not see and which takes half as much.
`make results PART=figures` brings both into docs/results.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from asglight.cli.folders import write_text
from asglight.images.output import written_beside

FIGURES = ("lobes", "losses", "time", "forms")

COLOURS = 200
"""With them the largest of the four is below 400 kB."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write figure-*.png and figures.md into a folder."""
    source, target = map(Path, sys.argv[1:] if argv is None else argv)
    target.mkdir(parents=True, exist_ok=True)
    for name in FIGURES:
        shrink(source / f"figure-{name}.png", target / f"figure-{name}.png")
    captions = [(source / f"figure-{name}.md").read_text() for name in FIGURES]
    write_text(target / "figures.md", assembled(captions))
    return 0


def shrink(source: Path, target: Path) -> None:
    """Write a picture with few colours."""
    with Image.open(source) as picture:
        colours = picture.convert("RGB")
    # the palette of the octree keeps rare hues, which the median cut drops
    palette = colours.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    dithered = colours.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
    with written_beside(target) as temporary:
        dithered.save(temporary, optimize=True)


def assembled(captions: Sequence[str]) -> str:
    """Return captions one after the other, with their pictures in images/."""
    sections = [caption.replace("](figure-", "](images/figure-").rstrip() for caption in captions]
    return "\n\n".join(sections) + "\n"


if __name__ == "__main__":
    raise SystemExit(main())
