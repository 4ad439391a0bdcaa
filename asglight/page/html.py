# SPDX-License-Identifier: Apache-2.0
"""The page: template, style, script, shaders, numbers and pictures in one file."""

import base64
import json
import math
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from asglight.images.output import written_beside
from asglight.lobes import LobeTracks
from asglight.page.numbers import Numbers, numbers_of
from asglight.page.reference import BALL, DARKEST, ROWS, Reference
from asglight.page.shaders import es_shader
from asglight.shader_files import VERTEX_SHADER, enum_number
from asglight.viewer.state.balls import Ball, ball_row
from asglight.viewer.state.display import ViewTransform
from asglight.viewer.uniforms.albedo_values import SIZE, albedo_values
from asglight.viewer.uniforms.shader_defines import SURROUND

PARTS = Path(__file__).resolve().parent / "parts"
"""Template, style and script."""


def page_balls() -> tuple[Ball, ...]:
    """Return the balls of a page: the row that the viewer opens with, from mirror to matte."""
    return ball_row()


def write_page(
    path: Path, tracks: LobeTracks, title: str, reference: Reference | None = None
) -> None:
    """Write a shot as one HTML file.

    Args:
        path: The target.
        tracks: Lobes of F frames.
        title: Of the page.
        reference: What they are held against.

    Raises:
        InputError: It cannot be written there.
    """
    text = page(tracks, title, reference)
    with written_beside(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def page(tracks: LobeTracks, title: str, reference: Reference | None = None) -> str:
    """Return a shot as HTML, as `write_page`."""
    balls = page_balls()
    numbers = numbers_of(tracks, balls)
    template = Template((PARTS / "page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title.encode("utf-8", "replace").decode()),  # half a surrogate pair is no text
        style=(PARTS / "page.css").read_text(encoding="utf-8"),
        script=(PARTS / "page.js").read_text(encoding="utf-8"),
        shot=_in_script(_document(numbers, title, reference)),
        shaders=_in_script(_shaders(numbers)),
    )


def _shaders(numbers: Numbers) -> dict[str, str]:
    """Return the sources by name, compiled for this shot."""
    document = numbers.document
    room = {"MAX_SHEETS": document["sheetCount"], "MAX_LOBES": document["lobeCount"]}
    srgb = {"TRANSFORM": enum_number(ViewTransform.SRGB)}
    filmic = {"TRANSFORM": enum_number(ViewTransform.FILMIC)}
    return {
        "vertex": es_shader(VERTEX_SHADER),
        "balls": es_shader("balls.frag", {**room, "WINDOW": document["window"]}),
        "lobes": es_shader("lobes.frag", room),
        "srgb": es_shader("display.frag", srgb),
        "filmic": es_shader("display.frag", filmic),
    }


def _document(numbers: Numbers, title: str, reference: Reference | None) -> dict[str, Any]:
    """Return all that the script needs, as JSON values; arrays as base64."""
    arrays = {
        "sheets": _base64(numbers.sheets),
        "layers": _base64(numbers.layers),
        "lobes": _base64(numbers.lobes),
        "albedo": _base64(albedo_values()),
        "outlines": base64.b64encode(numbers.outlines).decode(),
        "balls": base64.b64encode(numbers.balls).decode(),
    }
    return {
        **numbers.document,
        "title": title,
        "albedoSize": SIZE,
        "surround": SURROUND,
        "arrays": arrays,
        "reference": None if reference is None else _reference(reference),
    }


def _reference(reference: Reference) -> dict[str, Any]:
    return {
        "name": reference.name,
        "rows": ROWS,
        "ball": BALL,
        "darkest": DARKEST,
        "ranges": [[round(end, 4) for part in one for end in part] for one in reference.ranges],
        "errors": [
            {name: _error(value) for name, value in one.items()} for one in reference.errors
        ],
        "pictures": [base64.b64encode(one).decode() for one in reference.pictures],
    }


def _error(value: float) -> float | None:
    """Return an error in four digits; None of light beside a black reference, which is infinite."""
    return float(f"{value:.4g}") if math.isfinite(value) else None


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def _in_script(document: Any) -> str:
    """Return JSON that cannot end the script element it stands in."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
