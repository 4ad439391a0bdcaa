# SPDX-License-Identifier: Apache-2.0
"""LaTeX in Markdown as MathML, which browsers draw without a script.

Pages write equations as git hosts read them: a fence ```` ```math ````, or `` $`...`$ `` in a line.
"""

import re

from latex2mathml.converter import convert

FENCE = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"\$`([^`]+)`\$")


def with_mathml(markdown: str) -> str:
    """Return a page whose equations are MathML.

    Raises:
        ValueError: An equation is no LaTeX that can be converted; the message holds it.
    """
    page = FENCE.sub(lambda found: _block(found[1]), markdown)
    return INLINE.sub(lambda found: _mathml(found[1], "inline"), page)


def _block(latex: str) -> str:
    return f'<div class="equation">{_mathml(latex, "block")}</div>\n'


def _mathml(latex: str, display: str) -> str:
    """Return one line of MathML: a blank line would end a block of HTML in Markdown."""
    text = " ".join(latex.split())
    try:
        return " ".join(convert(text, display=display).split())
    except Exception as error:  # the package raises a class of its own for each mistake
        raise ValueError(f"equation {text!r}: {type(error).__name__} {error}") from error
