# SPDX-License-Identifier: Apache-2.0
"""The lobes of one frame of a live feed as a line of JSON (docs/reference/export.md)."""

import json
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from asglight.lobes import Lobes, asg, frames

FORMAT, VERSION = "asglight frame", 1
"""What a line says it is; the version rises when an older reader would misread it."""


def frame_line(lobes: Lobes, names: Sequence[str], **about: Any) -> str:
    """Return a line, without its end.

    Args:
        lobes: Of the frame, all tracks.  [N, .]
        names: Theirs.  N
        about: What else there is to say of the frame, as JSON values: its number first.
    """
    lobes = lobes.to("cpu", torch.float32)
    moments = asg.moments(lobes.to(torch.float64))
    spread = (moments.second[..., :2].sum(-1) / moments.zeroth).clamp(0, 1).sqrt()
    columns = {
        "quaternion": frames.quaternion_from_axes(lobes.axes),
        "direction": lobes.axis_z,
        "sharpness": lobes.sharpness,
        "amplitude": lobes.amplitude,
        "flux": asg.flux(lobes),
        "width_deg": torch.rad2deg(torch.asin(spread)),
    }
    listed = {name: _shortest(values) for name, values in columns.items()}
    rows = [
        {"name": name, **{column: values[place] for column, values in listed.items()}}
        for place, name in enumerate(names)
    ]
    document = {"format": FORMAT, "version": VERSION, **about, "form": str(lobes.form)}
    return json.dumps({**document, "lobes": rows}, separators=(",", ":"), allow_nan=False)


def _shortest(values: Tensor) -> list[Any]:
    """Return numbers in the fewest digits that give their float32 back."""
    rows = values.float().numpy()
    if rows.ndim == 1:
        return [float(str(value)) for value in rows]
    return [[float(str(value)) for value in row] for row in rows]
