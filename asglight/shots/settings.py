# SPDX-License-Identifier: Apache-2.0
"""The settings of a shot: checked before anything starts, and named for checkpoint and stage."""

import dataclasses
import math
import os
from pathlib import Path
from typing import Any

import torch

from asglight import __version__
from asglight.errors import InputError, check_number, check_whole
from asglight.fitting.options import FitOptions, Preset
from asglight.images import Sequence
from asglight.images.message import shown
from asglight.usd.options import STAGE_SUFFIXES, check_stage_name

LOBES_MAX = 512
"""Time and memory of a fit grow with the square of the number of lobes: seven minutes of a core and
3 GB for a first frame of `live` at 512 (docs/results/soak.md)."""

SEED_MAX = 2**63 - 1
"""The largest seed that every torch generator takes."""


def check_options(options: FitOptions) -> None:
    """Refuse settings that no fit can be made with.

    Raises:
        InputError: A value is out of range, or the device is not there.
    """
    for name, count in (("lobes", options.lobes), ("max lobes", options.max_lobes)):
        if count is not None:
            check_whole(name, count)
        if count is not None and not 1 <= count <= LOBES_MAX:
            raise InputError(f"{name}: {count}; expected 1 to {LOBES_MAX}.")
    _check_tolerance(options)
    check_whole("seed", options.seed)
    if not 0 <= options.seed <= SEED_MAX:
        raise InputError(f"seed: {options.seed}; expected 0 to 2^63 - 1.")
    if len(options.paper_steps) != 2 or min(options.paper_steps) < 1:
        steps = ",".join(map(str, options.paper_steps))
        raise InputError(
            f"paper steps: {steps or 'none'}; expected two whole numbers from 1, such as "
            "24000,6000: the first frame's and each next one's."
        )
    _check_device(options.device)


def _check_tolerance(options: FitOptions) -> None:
    """Refuse a tolerance that is none, and what cannot stand beside one."""
    tolerance = options.tolerance
    if tolerance is None:
        if options.max_lobes is not None:
            raise InputError(
                f"max lobes: {options.max_lobes} without a tolerance; expected both or neither. "
                "Add --tolerance 0.02, or give a fixed number with --lobes."
            )
        return
    if not 0 < tolerance < 1:
        raise InputError(
            f"tolerance: {tolerance:g}; expected a relative error above 0 and below 1, such as "
            "0.02."
        )
    if options.lobes is not None:
        raise InputError(
            f"lobes: {options.lobes} beside a tolerance, which finds their number; expected one of "
            "the two. Leave out --lobes, or bound the number with --max-lobes."
        )
    if options.preset is Preset.PAPER:
        raise InputError(
            "tolerance: given with --preset paper, which fits a fixed number of lobes; expected "
            "--preset live, fast or best."
        )


def check_fps(fps: float) -> None:
    """Refuse a frame rate that is not a positive number."""
    check_number("fps", fps)
    if not (math.isfinite(fps) and fps > 0):
        raise InputError(f"fps: {fps:g}; expected a number above 0, such as 24 or 23.976.")


def check_output(output: Path) -> None:
    """Refuse an output that cannot become a USD stage.

    Raises:
        InputError: Its name has another extension or is none that USD can refer to, or its folder
            is not there.
    """
    if output.suffix.lower() not in STAGE_SUFFIXES or "\0" in str(output):
        raise InputError(
            f"{shown(output)}: its extension is {shown(output.suffix) or 'missing'}; expected "
            f"{', '.join(STAGE_SUFFIXES[:-1])} or {STAGE_SUFFIXES[-1]}."
        )
    check_stage_name(output)
    if os.path.isdir(output):
        raise InputError(
            f"{shown(output)}: is a folder; expected a file to write. Choose another name."
        )
    if not os.path.isdir(output.parent):
        raise InputError(
            f"{shown(output)}: there is no folder {shown(output.parent)}; expected one to write "
            "into. Make it first."
        )


def settings_of(sequence: Sequence, options: FitOptions, fps: float) -> dict[str, Any]:
    """Return everything that the fit depends on, as JSON values by name."""
    return {
        "asglight": __version__,
        "source": os.path.abspath(sequence.pattern),
        **sequence.reading.as_json(),
        "missing": sequence.missing,
        "height": sequence.height,
        "frames": list(sequence.frames),
        "fps": fps,
        **options_as_json(options),
    }


def options_as_json(options: FitOptions) -> dict[str, Any]:
    """Return the options as JSON values, but for what the number of frames says."""
    values = dataclasses.asdict(options)
    del values["moving"]
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: Any) -> Any:
    """Return an enumeration's value as a bare string, and a tuple as a list."""
    if isinstance(value, str):
        return str(value)
    return list(value) if isinstance(value, tuple) else value


def _check_device(name: str) -> None:
    kind, _, index = name.partition(":")
    if kind not in ("cpu", "cuda") or (index and not (kind == "cuda" and index.isdecimal())):
        raise InputError(f"device: {shown(name) or 'none'}; expected cpu, cuda or cuda:<number>.")
    if kind == "cpu":
        return
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if count == 0:
        raise InputError(
            "device: cuda, but torch finds no CUDA device here; expected one. Use --device cpu, "
            "or install a torch built for CUDA and its driver."
        )
    if int(index or 0) >= count:
        raise InputError(f"device: {name}; expected cuda:0 to cuda:{count - 1}, which are there.")
