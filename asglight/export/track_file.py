# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks as a JSON file for engines, and back. docs/reference/export.md describes the file.

A lobe has a quaternion, a sharpness and an amplitude. Each is one vector, or where it changes a
list of vectors, one for each frame. Numbers are float32, written in the fewest digits that give
them back.
"""

import itertools
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.errors import InputError
from asglight.export.keyed import KeyedLight, key_rows, rest_row
from asglight.images.message import shown
from asglight.images.output import written_beside
from asglight.lobes import Form, Lobes, LobeTracks, frames

FORMAT, VERSION = "asglight lobes", 1
"""What the file says it is; the version rises when an older reader would misread it."""

SAMPLES_MAX = 1_000_000
"""Frames times lobes: 46 minutes of 15 lobes at 24 frames a second, 36 MB in memory."""

FRAME_MAX = 2**31 - 1
"""Frame numbers have 32 bits, as in most programs that read them."""

BYTES_MAX = 256_000_000
"""A file of SAMPLES_MAX is half as large; more is no track file and would fill the memory."""

UNIT_ERROR_MAX = 1e-3
"""Of a quaternion's length: what four digits leave. More is damage."""

CONVENTION = (
    "Right-handed, +Y up. quaternion (w, x, y, z), unit, turns +X, +Y, +Z into a lobe's axes "
    "x, y, z; z points at the light. amplitude: linear Rec.709 RGB, relative radiance at z. "
    "The radiance from a unit direction d is the sum over the lobes of amplitude times {formula}, "
    "with x, y, z the components of d along the axes and (sx, sy) the sharpness."
)

FORMULAS = {
    Form.ASG: "max(z, 0) exp(-sx x^2 - sy y^2)",
    Form.BINGHAM: "exp(-sx x^2 - sy y^2)",
    Form.SG: "exp(sx (z - 1))",
    Form.FLAT: "max(z, 0) (1 - (1 - exp(-sx x^2 - sy y^2))^3)",
}


KEYED_CONVENTION = (
    "Light with the lobes, or with keys and rest, which are the same light; never with both. A key "
    "is a rectangle of one radiance with its middle at distance 1 in the direction center, along "
    "axis_x and axis_y, half_size from its middle either way; it faces the origin only where both "
    "are at right angles to center. irradiance: on a surface that faces center. images: latlong, "
    "one a frame, +Y up, the rest, in the linear space that their chromaticities state, Rec.709 "
    "where they state none; all numbers here are Rec.709. irradiance_sh: of the rest on a normal "
    "(x, y, z), c0 + c1 y + c2 z + c3 x + c4 x y + c5 y z + c6 (3 z^2 - 1) + c7 x z "
    "+ c8 (x^2 - y^2), and 0 where that is negative."
)


def write_json(
    path: str | Path,
    tracks: LobeTracks,
    names: Sequence[str],
    keyed: KeyedLight | None = None,
) -> None:
    """Write tracks as a JSON file.

    Args:
        path: The target; its folder must exist.
        tracks: N lobes in F frames.
        names: Of the N lobes.
        keyed: Keys and rest of the same frames, where the stage has them.

    Raises:
        InputError: The file cannot be written there, or there are more samples than SAMPLES_MAX.
    """
    path = Path(path)
    check_samples(path, len(tracks.frames), tracks.lobes.count)
    lobes = tracks.lobes.to("cpu")
    turns = frames.continuous_quaternions(frames.quaternion_from_axes(lobes.axes.double()))
    header = {
        "format": FORMAT,
        "version": VERSION,
        "form": str(lobes.form),
        "fps": tracks.fps,
        "frames": list(tracks.frames),
        "convention": CONVENTION.format(formula=FORMULAS[lobes.form]),
    }
    rows = [
        {
            "name": name,
            "quaternion": _track(turns[:, index]),
            "sharpness": _track(lobes.sharpness[:, index]),
            "amplitude": _track(lobes.amplitude[:, index]),
        }
        for index, name in enumerate(names)
    ]
    lists = {"lobes": rows}
    if keyed is not None:
        header["keyed_convention"] = KEYED_CONVENTION
        header["rest"] = rest_row(keyed, path.parent)
        lists["keys"] = [
            {"name": name, **{key: _track(values) for key, values in columns.items()}}
            for name, columns in key_rows(keyed)
        ]
    with written_beside(path) as place:
        place.write_text(_document(header, lists), encoding="utf-8")


def read_json(path: str | Path) -> LobeTracks:
    """Read tracks that `write_json` wrote.

    Args:
        path: The file.

    Returns:
        Tracks with float32 lobes on the CPU.

    Raises:
        InputError: There is no such file, or it is damaged.
    """
    path = Path(path)
    document = _parsed(path)
    if document.get("format") != FORMAT:
        _fail(path, "is no lobe track file", f'"format": "{FORMAT}"')
    version = document.get("version")
    if type(version) is not int or not 1 <= version <= VERSION:
        _fail(path, f"version {_brief(version)}", f"a number up to {VERSION}")
    form = document.get("form")
    if form not in list(Form):
        _fail(path, f"form {_brief(form)}", f"one of {', '.join(Form)}")
    numbers, fps = _frames(path, document.get("frames")), document.get("fps")
    if not (_is_number(fps) and 0 < fps < math.inf):
        _fail(path, f"fps {_brief(fps)}", "a number above 0")
    return LobeTracks(numbers, float(fps), _lobes(path, document.get("lobes"), numbers, Form(form)))


def _document(header: dict[str, Any], lists: dict[str, list[dict[str, Any]]]) -> str:
    """Return the JSON text: a line for each entry of the header, for each lobe and each key."""
    compact: dict[str, Any] = {"separators": (",", ":"), "allow_nan": False}
    entries = [
        f"{json.dumps(key)}: {json.dumps(value, **compact)}" for key, value in header.items()
    ]
    for name, rows in lists.items():
        listed = ",\n".join(json.dumps(row, **compact) for row in rows)
        entries.append(f"{json.dumps(name)}: [\n{listed}\n]")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _track(values: Tensor) -> list[Any]:
    """Return one vector where all are equal, else all.  [F, K]."""
    rows = values.float().numpy()
    shortest = [[float(str(value)) for value in row] for row in rows]
    return shortest[0] if bool((rows == rows[0]).all()) else shortest


def _parsed(path: Path) -> dict[str, Any]:
    try:
        size = path.stat().st_size
        if not (path.is_file() or path.is_dir()):  # it would be waited for
            _fail(path, "is a pipe or a device", "a lobe track file")
        text = path.read_bytes() if size <= BYTES_MAX else b""
    except OSError as error:
        finding = error.strerror or type(error).__name__
        raise InputError(
            f"{shown(path)}: cannot be read ({finding}); expected a lobe track file."
        ) from error
    if size > BYTES_MAX:
        _fail(path, f"has {size} bytes", f"at most {BYTES_MAX}")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        _fail(path, "is no whole JSON object", "a lobe track file")
    return document


def _frames(path: Path, listed: Any) -> tuple[int, ...]:
    is_whole = isinstance(listed, list) and all(
        type(frame) is int and abs(frame) <= FRAME_MAX for frame in listed
    )
    if not is_whole or not listed or any(b <= a for a, b in itertools.pairwise(listed)):
        _fail(path, "frames are damaged", "ascending whole numbers of 32 bits")
    return tuple(listed)


def _lobes(path: Path, rows: Any, numbers: tuple[int, ...], form: Form) -> Lobes:
    """Read the lobes of all frames and check them.  [F, N, .]."""
    if not (isinstance(rows, list) and rows and all(isinstance(row, dict) for row in rows)):
        _fail(path, "lobes are damaged", "a list of objects")
    check_samples(path, len(numbers), len(rows))

    def stacked(
        key: str, width: int, is_good: Callable[[NDArray[np.float32]], Any], expected: str
    ) -> Tensor:
        """Return one key of all lobes, checked.  [F, N, width]."""
        tracks = []
        for index, row in enumerate(rows):
            values = _values(row.get(key), len(numbers), width)
            good = values is not None and np.isfinite(values).all(-1) & is_good(values)
            if values is None or not np.all(good):
                _fail(path, f"{key} of lobe {index} is damaged", expected)
            tracks.append(np.broadcast_to(values, (len(numbers), width)))
        return torch.from_numpy(np.stack(tracks, axis=1))

    def is_turn(values: NDArray[np.float32]) -> Any:
        length = np.linalg.norm(values.astype(np.float64), axis=-1)
        return np.abs(length - 1) <= UNIT_ERROR_MAX

    each = f"for all frames or each of {len(numbers)}"
    turns = stacked("quaternion", 4, is_turn, f"a unit (w, x, y, z) {each}")
    return Lobes(
        axes=frames.axes_from_quaternion(turns.double()).float(),
        sharpness=stacked("sharpness", 2, lambda v: (v > 0).all(-1), f"two numbers above 0 {each}"),
        amplitude=stacked(
            "amplitude", 3, lambda v: (v >= 0).all(-1), f"three numbers from 0 up {each}"
        ),
        form=form,
    )


def _values(value: Any, count: int, width: int) -> NDArray[np.float32] | None:
    """Return one vector or `count` of them as rows; None where it is something else."""
    if not (isinstance(value, list) and value):
        return None
    is_varying = isinstance(value[0], list)
    rows = value if is_varying else [value]
    if is_varying and len(rows) != count:
        return None
    for row in rows:
        if not (isinstance(row, list) and len(row) == width and all(map(_is_number, row))):
            return None
    # What float32 does not hold becomes infinite, which is refused afterwards.
    with np.errstate(over="ignore"):
        return np.array(rows, dtype=np.float64).astype(np.float32)


def _is_number(value: Any) -> TypeGuard[float]:
    # A whole number of more than 64 bits cannot be converted; 2^63 is beyond any lobe.
    return type(value) is float or (type(value) is int and abs(value) < 2**63)


def check_samples(path: Path, frame_count: int, lobe_count: int) -> None:
    """Refuse more samples than SAMPLES_MAX.

    Raises:
        InputError: There are more.
    """
    if frame_count * lobe_count > SAMPLES_MAX:
        raise InputError(
            f"{shown(path)}: {lobe_count} lobes in {frame_count} frames; expected at most "
            f"{SAMPLES_MAX} together. Split the shot."
        )


def _brief(value: Any) -> str:
    """Return a value of the file for a message: short and on one line."""
    return shown(repr(value)[:40])


def _fail(path: Path, found: str, expected: str) -> NoReturn:
    raise InputError(f"{shown(path)}: {found}; expected {expected}. Export it anew.")
