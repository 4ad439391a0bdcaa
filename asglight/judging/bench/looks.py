# SPDX-License-Identifier: Apache-2.0
"""How the bench draws each method, on a dark ground or in the colours of a page.

Every method has its colour, its marker and its kind of line, the same in all pictures [colours:
Okabe and Ito 2008, "Color universal design", which every kind of colour vision tells apart].
"""

import hashlib
import re
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from asglight.judging.pictures.layout import LIGHT, Theme


@dataclass(frozen=True)
class Look:
    """How a method is drawn.

    Attributes:
        dark: Colour on a dark ground.
        light: Colour on a light ground.
        marker: As matplotlib names it.
        line: Likewise.
    """

    dark: str
    light: str
    marker: str
    line: Any = "-"


LOOKS = {
    "fast": Look("#56b4e9", "#0072b2", "o"),
    "best": Look("#009e73", "#009e73", "s", (0, (6, 2))),
    "paper": Look("#e69f00", "#d55e00", "D", (0, (2, 2))),
    "live": Look("#f0e442", "#000000", "^", (0, (6, 2, 1, 2))),
    "independent": Look("#cc79a7", "#b3578a", "P", (0, (1, 1))),
    "em": Look("#b4b5b7", "#5c5d5f", "v", (0, (3, 1, 1, 1))),
}
PEER = Look("#b4b5b7", "#5c5d5f", "x")
"""Any other method, which has its name beside it."""

NAMES = {
    "paper": "paper: Clausen et al. 2024",
    "em": "em: vMF EM",
    "independent": "independent: fast, each frame from nothing",
}

PAGE_THEME = Theme("#fe0001", "#fe0002", "#fe0003", "#fe0004")
"""Stand-ins: `svg` puts the page's variables in their place."""

PAGE_COLOURS = {name: f"#fe01{place:02x}" for place, name in enumerate([*LOOKS, "peer"])}
PAGE_VARIABLES = {
    PAGE_THEME.background: "ground",
    PAGE_THEME.text: "text",
    PAGE_THEME.faint: "faint",
    PAGE_THEME.line: "line",
    **{colour: name for name, colour in PAGE_COLOURS.items()},
}
"""Name of the page's variable by stand-in."""


def svg(figure: Figure) -> str:
    """Return a picture as an element for a page, text as text, colours as the page's variables.

    Its heading is its name for those who have the page read to them.
    """
    text = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "asglight"}):
        unsaid = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", dpi=72, metadata=unsaid)
    element = text.getvalue()
    element = element[element.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r' xmlns(:xlink)?="[^"]*"', "", element)  # a page knows these
    element = re.sub(r' (width|height)="[\d.]+pt"', "", element, count=2)
    # a page has several pictures, whose parts have the same names
    own = hashlib.sha256(element.encode()).hexdigest()[:8]
    element = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{own}-", element)
    for colour, name in PAGE_VARIABLES.items():
        element = element.replace(colour, f"var(--{name})")
    heading = escape(figure.texts[0].get_text())
    return element.replace("<svg", f'<svg role="img" aria-label="{heading}"', 1)


def colour_of(name: str, theme: Theme) -> str:
    """Return the colour of a method on a ground."""
    if theme is PAGE_THEME:
        return PAGE_COLOURS[name if name in PAGE_COLOURS else "peer"]
    look = LOOKS.get(name, PEER)
    return look.light if theme is LIGHT else look.dark
