# SPDX-License-Identifier: Apache-2.0
"""The stress table: every case fitted as a user's shot is, every check measured, a verdict.

The frames of a case are written as OpenEXR files and go the whole way: read, repaired, reduced,
fitted, judged, written as a stage and read back. Cases made of known lobes are checked with those
too: no fit makes a lobe as stiff as some of them.
"""

import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

import torch

from asglight import __version__
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT, LOBES, Preset
from asglight.images import open_sequence, write_exr
from asglight.judging.clock import Clock, Point
from asglight.judging.machine import machine
from asglight.judging.stress import checks
from asglight.judging.stress.case import FLUX, FOUND, GRADIENT, IRRADIANCE, Bound, Case
from asglight.judging.stress.checks import Shader
from asglight.judging.stress.gradient import gradient_error
from asglight.lobes import Lobes, LobeTracks
from asglight.lobes.data import stack

BALLS = Bound(5e-3)
"""Of a ball's brightest pixel: the shaders' albedo table is within 3e-3
(viewer/gl/albedo_table.py), and what else they do within 1e-4."""

STAGE = Bound(1e-6)
"""Sharpness and amplitude are kept as they are, frames as float32 quaternions: 1e-7 a component."""

FINITE = Bound(0.0)

STEM = "stress."
"""Of the names of the files of a case."""


class Verdict(StrEnum):
    """What became of a case."""

    OK = "ok"
    """Within the bounds that all cases have."""
    STATED = "stated"
    """Beyond one of them, within the case's own, for which the case states a reason."""
    REFUSED = "refused"
    """Refused in one line, as it has to be."""
    FAIL = "FAIL"


class Fit(Protocol):
    """Fits a sequence as `asglight.fit_sequence` does."""

    def __call__(self, source: Path, *, lobes: int, preset: str, form: str) -> LobeTracks:
        """Return the tracks of the images in a folder."""
        ...


@dataclass(frozen=True)
class Measured:
    """The error of one check.

    Attributes:
        value: The error; None where there is nothing to measure, which `note` explains.
        bound: The largest that passes.
        common: The bound that cases have which state no reason.
        note: Why the bound is wider than `common`, or why there is no value.
    """

    value: float | None
    bound: float
    common: float
    note: str = ""

    @property
    def passes(self) -> bool:
        """Whether the error is within the bound."""
        return self.value is None or self.value <= self.bound

    @property
    def is_stated(self) -> bool:
        """Whether it passes for its stated reason only."""
        return self.passes and self.value is not None and self.value > self.common


@dataclass(frozen=True)
class Result:
    """A case that was run.

    Attributes:
        case: The case.
        measured: Check to error, in the order of the table; empty where nothing was fitted.
        lobes: Lobes that the fit came to.
        frames: Frames of the input.
        seconds: Wall and CPU seconds, by name.
        message: What ended the fit, if anything did.
        refused: Whether that was the one line that refuses an input.
    """

    case: Case
    measured: dict[str, Measured] = field(default_factory=dict)
    lobes: int = 0
    frames: int = 0
    seconds: Point = field(default_factory=dict)
    message: str = ""
    refused: bool = False

    @property
    def verdict(self) -> Verdict:
        """What became of the case."""
        if self.case.refused is not None:
            told = self.refused and self.case.refused in self.message
            return Verdict.REFUSED if told and "\n" not in self.message else Verdict.FAIL
        if self.message or not all(each.passes for each in self.measured.values()):
            return Verdict.FAIL
        stated = any(each.is_stated for each in self.measured.values())
        return Verdict.STATED if stated else Verdict.OK


@dataclass(frozen=True)
class Tools:
    """What the runner is handed, because this room may not import it.

    Attributes:
        fit: `asglight.fit_sequence`.
        shader: The viewer's shaders; None where there is no OpenGL.
        no_shader: Why there is none.
    """

    fit: Fit
    shader: Shader | None
    no_shader: str = ""


def run_case(case: Case, tools: Tools) -> Result:
    """Fit a case and measure it. What a case breaks is its result, and stops no other case."""
    clock = Clock()
    try:
        measured, lobes, frames = _measured(case, tools)
    except Exception as error:  # whatever it is, it is the finding
        refused = isinstance(error, InputError)
        message = str(error) if refused else f"{type(error).__name__}: {error}"
        message = message[max(0, message.find(STEM)) :]  # without the temporary folder
        return Result(case, seconds=clock.seconds(), message=message, refused=refused)
    return Result(case, measured, lobes, frames, clock.seconds())


def _measured(case: Case, tools: Tools) -> tuple[dict[str, Measured], int, int]:
    """Return the errors of every check, and the numbers of lobes and of frames."""
    with tempfile.TemporaryDirectory(prefix="asglight-") as name:
        folder = Path(name)
        for number, radiance in enumerate(case.frames(), start=1):
            path = folder / f"{STEM}{number:04d}.exr"
            write_exr(path, radiance, half=False, compression="none")
        tracks = tools.fit(folder, lobes=case.lobes, preset=Preset.FAST, form=case.form)
        sequence = open_sequence(folder, height=FIT_HEIGHT)
        maps = [sequence.read(frame).radiance for frame in sequence.frames]
    fitted = [tracks.at(frame) for frame in tracks.frames]
    known = [] if case.known is None else case.known()
    every = fitted + known
    pairs = list(zip(fitted, maps, strict=True))
    flux = max(checks.flux_error(*pair) for pair in pairs)
    irradiance = max(checks.irradiance_error(*pair) for pair in pairs)
    found = {
        "finite": _of(FINITE, float(sum(map(checks.not_finite, every)))),
        "flux": _of(FLUX, flux, case.flux),
        "irr": _of(IRRADIANCE, irradiance, case.irradiance),
        "gradient": _gradient(case, fitted, known, maps),
        "shader": _shader(tools, every),
        "balls": _balls(tools, every),
        "stage": _of(STAGE, max(map(checks.stage_error, (tracks, *_known_tracks(known))))),
    }
    if case.recovery is not None:
        found |= _recovered(case, fitted, known)
    return found, tracks.lobes.count, len(maps)


def _of(common: Bound, value: float, own: Bound | None = None) -> Measured:
    bound = common if own is None else own
    return Measured(value, bound.value, common.value, bound.reason)


def _known_tracks(known: Sequence[Lobes]) -> list[LobeTracks]:
    if not known:
        return []
    lobes = stack([lobes.to(torch.float32) for lobes in known])
    return [LobeTracks(tuple(range(1, len(known) + 1)), 24.0, lobes)]


def _gradient(
    case: Case, fitted: list[Lobes], known: list[Lobes], maps: list[torch.Tensor]
) -> Measured:
    """Check the last frame, which every other one of a shot led to."""
    few = [lobes for lobes in known[-1:] if lobes.count <= LOBES]
    subjects = [fitted[-1], *few]
    errors = [gradient_error(lobes, maps[-1]) for lobes in subjects]
    values = [error for error in errors if error is not None]
    if not values:
        return Measured(None, GRADIENT.value, GRADIENT.value, "black: nothing to differentiate")
    return _of(GRADIENT, max(values), case.gradient)


def _shader(tools: Tools, every: Sequence[Lobes]) -> Measured:
    bound = max(shader_bound(lobes) for lobes in every)
    if tools.shader is None:
        return Measured(None, bound, bound, tools.no_shader)
    errors = [
        checks.shader_error(tools.shader, part)
        for lobes in every
        for part in parts(lobes, tools.shader.lobes_max)
    ]
    return Measured(max(errors), bound, bound)


def _balls(tools: Tools, every: Sequence[Lobes]) -> Measured:
    if tools.shader is None:
        return Measured(None, BALLS.value, BALLS.value, tools.no_shader)
    errors = [
        checks.balls_error(tools.shader, part)
        for lobes in every
        for part in parts(lobes, tools.shader.lobes_max)
    ]
    return _of(BALLS, max(errors))


def shader_bound(lobes: Lobes) -> float:
    """Return what float32 allows the shaders' radiance to be off by, of the brightest.

    x = d.axis_x is rounded by about u = 2^-23, so exp(-s x^2) is off by 2 s x u of itself, at most
    sqrt(2 s / e) u of the peak; twice for the two axes, and a few u for exp and the sum.
    """
    sharpest = float(lobes.sharpness.max())
    return (2 * math.sqrt(2 * sharpest / math.e) + 32) * 2**-23


def parts(lobes: Lobes, most: int) -> Iterator[Lobes]:
    """Return lobes in parts of at most so many.  [N, .]."""
    for first in range(0, lobes.count, most):
        yield lobes.select(torch.arange(first, min(first + most, lobes.count)))


def _recovered(case: Case, fitted: list[Lobes], known: list[Lobes]) -> dict[str, Measured]:
    """Return how near the known lobes were found again, the worst frame of each number."""
    assert case.recovery is not None
    errors = [checks.recovery_errors(*pair) for pair in zip(fitted, known, strict=True)]
    return {
        name: _of(
            Bound(getattr(FOUND, name)),
            max(getattr(error, name) for error in errors),
            Bound(getattr(case.recovery, name), case.recovery.reason),
        )
        for name in ("direction", "sharpness", "amplitude")
    }


def as_document(results: Sequence[Result], tools: Tools, command: str) -> dict[str, Any]:
    """Return a run as JSON values; an infinite error is null, and its case fails."""
    verdicts = [result.verdict for result in results]
    return {
        "asglight_stress": 1,
        "asglight": __version__,
        "command": command,
        "machine": machine(),
        "opengl": {
            "name": None if tools.shader is None else tools.shader.name,
            "missing": tools.no_shader or None,
        },
        **total(results),
        "verdicts": {verdict.value: verdicts.count(verdict) for verdict in Verdict},
        "cases": [_as_json(result) for result in results],
    }


def total(results: Sequence[Result]) -> Point:
    """Return the seconds of all cases together."""
    names = ("wall_seconds", "cpu_seconds")
    return {name: sum(result.seconds.get(name, 0.0) for result in results) for name in names}


def _as_json(result: Result) -> dict[str, Any]:
    return {
        "name": result.case.name,
        "group": result.case.group.value,
        "holds": result.case.holds,
        "frames": result.frames,
        "lobes_asked": result.case.lobes,
        "lobes": result.lobes,
        "form": result.case.form.value,
        **result.seconds,
        "verdict": result.verdict.value,
        "message": result.message or None,
        "checks": {
            name: {
                "error": each.value if each.value is None or math.isfinite(each.value) else None,
                "bound": each.bound,
                "passes": each.passes,
                "note": each.note or None,
            }
            for name, each in result.measured.items()
        },
    }
