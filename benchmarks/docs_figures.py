# SPDX-License-Identifier: Apache-2.0
"""Bring what `asglight figures` wrote into the docs: small pictures, and captions as one page.

    python benchmarks/docs_figures.py figures-output docs

The head of docs/results/figures.md, up to the first section, stays as it is; what follows is the
captions. Pictures get 200 colours with dither, which a reader does not see and which takes half as
much.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

FIGURES = ("lobes", "losses", "time", "forms")

COLOURS = 200
"""With them the largest of the four is below 400 kB."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write docs/results/images/figure-*.png and docs/results/figures.md."""
    source, docs = map(Path, sys.argv[1:] if argv is None else argv)
    for name in FIGURES:
        shrink(source / f"figure-{name}.png", docs / "results" / "images" / f"figure-{name}.png")
    page = docs / "results" / "figures.md"
    captions = [(source / f"figure-{name}.md").read_text() for name in FIGURES]
    page.write_text(assembled(page.read_text(), captions))
    return 0


def shrink(source: Path, target: Path) -> None:
    """Write a picture with few colours."""
    with Image.open(source) as picture:
        colours = picture.convert("RGB")
    # the palette of the octree keeps rare hues, which the median cut drops
    palette = colours.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    dithered = colours.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
    dithered.save(target, optimize=True)


def assembled(page: str, captions: Sequence[str]) -> str:
    """Return a page with its head, and captions whose pictures are in images/."""
    head = page.partition("\n## ")[0].rstrip()
    sections = [caption.replace("](figure-", "](images/figure-").rstrip() for caption in captions]
    return "\n\n".join([head, *sections]) + "\n"


if __name__ == "__main__":
    raise SystemExit(main())
