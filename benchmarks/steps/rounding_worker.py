# SPDX-License-Identifier: Apache-2.0
"""The fit in one arithmetic: lobes fitted to maps, or J and the judge looking at given lobes.

    python -m benchmarks.steps.rounding_worker float64 cpu maps.npz found.npz

In float64 the same source runs with every float32 in it made float64, constants and grids too: this
process gives `torch.float32` that meaning before it loads asglight. Results are float64 for both.
Arrays are named `map/what`; with `axes`, `sharpness` and `amplitude` of a map's lobes it is looked
at instead of fitted.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

Arrays = dict[str, np.ndarray]

MOVED = 1.2
"""Factor on the sharpness of every lobe whose slope is taken: at a fit's end there is hardly any,
and what is left is rounding itself."""


def main(argv: list[str]) -> int:
    """Read maps, fit or look at them, write what was found."""
    arithmetic, device, source, target = argv
    if arithmetic == "float64":
        in_float64()
    with np.load(source) as stored:
        given = dict(stored)
    found: Arrays = {}
    for name in dict.fromkeys(key.rpartition("/")[0] for key in given):
        own = {key.rpartition("/")[2]: value for key, value in given.items() if _is_of(key, name)}
        work: Callable[[Arrays, str], Arrays] = look if "axes" in own else fit
        found |= {f"{name}/{what}": value for what, value in work(own, device).items()}
    np.savez(target, **found)  # pyright: ignore[reportArgumentType]
    return 0


def in_float64() -> None:
    """Let float32 mean float64 in all that is loaded from here on."""
    names: Any = torch
    names.float32 = names.float = torch.float64
    names.Tensor.float = torch.Tensor.double
    torch.set_default_dtype(torch.float64)


def fit(own: Arrays, device: str) -> Arrays:
    """Fit a map from nothing.

    Args:
        own: `map` [H, 2 H, 3], `lobes` and `form`.
        device: Of torch.

    Returns:
        `axes` [N, 3, 3], `sharpness` [N, 2], `amplitude` [N, 3], in float64.
    """
    from asglight.fitting.options import FitOptions
    from asglight.fitting.sequence import fit_frame
    from asglight.lobes import Form

    options = FitOptions(int(own["lobes"]), form=Form(str(own["form"])))
    radiance = torch.from_numpy(own["map"]).to(device, torch.float32)
    lobes = fit_frame(radiance, options, None).lobes
    return {
        name: getattr(lobes, name).cpu().double().numpy()
        for name in ("axes", "sharpness", "amplitude")
    }


def look(own: Arrays, device: str) -> Arrays:
    """Take J, its slope and its matrix at given lobes, what they show, and the judge's errors.

    Args:
        own: As of `fit`, and the lobes.
        device: Of torch.

    Returns:
        `J`; `slope` [8 N] and `matrix` [8 N, 8 N], both of J at sharper lobes; `shown`, the means
        over the cells of J's grid [3, C]; `cells`, those that are refined [R]; `irr`; `r0.5`.
    """
    from asglight.fitting.first_frame.fit import exposed
    from asglight.fitting.loss import adaptive_cells, lobe_images, objective
    from asglight.fitting.steps import equations
    from asglight.judging.metrics import frame_errors
    from asglight.lobes import Form, Lobes

    radiance = torch.from_numpy(own["map"]).to(device, torch.float32)
    axes, sharpness, amplitude = (
        torch.from_numpy(own[name]).to(device, torch.float32)
        for name in ("axes", "sharpness", "amplitude")
    )
    form = Form(str(own["form"]))
    frame = exposed(radiance)
    if frame.exposure <= 0:
        return {}
    places = adaptive_cells.adaptive_cells(frame.radiance)
    target = objective.target(frame.radiance, places=places)
    light = (amplitude.double() / frame.exposure).to(torch.float32)
    there = Lobes(axes[None], sharpness[None], light[None], form)
    seen = lobe_images.images(there, places)
    sharper = Lobes(axes[None], MOVED * sharpness[None], light[None], form)
    moved = lobe_images.images(sharper, places)
    matrix, slope = equations.normal_equations(
        moved, objective.loss_gradient(moved.radiance, target), target
    )
    # the judge works on the processor
    errors = frame_errors(Lobes(axes, sharpness, amplitude, form).to("cpu"), radiance.cpu()).values
    found = {
        "J": objective.value(seen.radiance, target)[0],
        "slope": slope[0],
        "matrix": matrix[0],
        "shown": seen.radiance[0, :, : places.count],
        "cells": places.refined[0].sort().values,
        "irr": torch.tensor(errors["irr"]),
        "r0.5": torch.tensor(errors["r0.5"]),
    }
    return {name: value.cpu().double().numpy() for name, value in found.items()}


def _is_of(key: str, name: str) -> bool:
    return key.rpartition("/")[0] == name


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
