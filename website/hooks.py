# SPDX-License-Identifier: Apache-2.0
"""What mkdocs calls while it builds (`hooks` of mkdocs.yml).

Pages on a git host are plain Markdown. Two of them hold a mark where the site has what is made of
the code: every option of every command, and the signature and docstring of every public name.
"""

from typing import Any

import asglight
from website.commands import reference
from website.equations import with_mathml

COMMANDS_MARK = "<!-- here the site has every option -->"
NAMES_MARK = "<!-- here the site has every signature -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with its marks filled and its equations as MathML."""
    page = with_mathml(markdown)
    if COMMANDS_MARK in page:
        page = page.replace(COMMANDS_MARK, reference())
    return page.replace(NAMES_MARK, public_names())


def public_names() -> str:
    """Return the directive of mkdocstrings for every public name but the version."""
    names = [name for name in asglight.__all__ if not name.startswith("__")]
    return "\n\n".join(f"::: {getattr(asglight, name).__module__}.{name}" for name in names)
