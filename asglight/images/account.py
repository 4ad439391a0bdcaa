# SPDX-License-Identifier: Apache-2.0
"""What was read of an image, and what was assumed, for a user and for the stage's metadata."""

from collections.abc import Mapping
from typing import Any

from asglight.images.decoding.header import Header
from asglight.images.message import listing


def read_as(header: Header) -> dict[str, Any]:
    """Return what was read of an image and what was assumed, as JSON values.

    Returns:
        `layer` and the names of the `other_layers`; `eye` of a stereo image, else None; `colours`
        and who says so, `stated_by`, None where they are assumed; `notes` and `warnings`.
    """
    return {
        "layer": header.layer.label,
        "other_layers": list(header.layer.others),
        "eye": header.eye or None,
        "colours": header.colour.name,
        "stated_by": header.colour.said_by or None,
        "notes": list(header.notes),
        "warnings": list(header.warnings),
    }


def image_line(account: Mapping[str, Any]) -> str:
    """Return layer, eye and colours as one line; empty where there was nothing to choose."""
    is_plain = not (account["other_layers"] or account["eye"] or account["stated_by"])
    return "" if is_plain else f"image: {image_words(account)}"


def image_words(account: Mapping[str, Any]) -> str:
    """Return layer, eye and colours as clauses."""
    layer = f"layer {account['layer']}"
    if account["other_layers"]:
        layer += f" (not {listing(account['other_layers'])})"
    eye = [f"{account['eye']} eye"] if account["eye"] else []
    by = account["stated_by"]
    colours = f"colours {account['colours']} ({by or 'assumed: the file states none'})"
    return "; ".join([layer, *eye, colours])


def warning_lines(account: Mapping[str, Any]) -> list[str]:
    """Return one line for each thing that may make wrong light."""
    return [f"warning: {one}" for one in account["warnings"]]
