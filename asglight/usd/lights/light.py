# SPDX-License-Identifier: Apache-2.0
"""The lights of one lobe, as data: what `layer` authors and `edit_layer` compares."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pxr import Gf
from torch import Tensor

from asglight.lobes.data import Form
from asglight.usd import schema

FLIP = Gf.Quatf(0, 1, 0, 0)
"""Half a turn about x: from the front of a bingham lobe to its back."""


@dataclass(frozen=True)
class Light:
    """One light of a lobe over all frames.

    Attributes:
        name: Of its prim below the lobe's; empty where the lobe's own prim is the light.
        tracks: Attributes that may change.  [F, K]
        constants: Attributes that do not.
        ops: Transform operations that follow the lobe's.
    """

    name: str
    tracks: Mapping[str, Tensor]
    constants: Mapping[str, Any] = field(default_factory=dict)
    ops: tuple[str, ...] = ()


def on_sides(lights: Sequence[Light], form: Form) -> list[Light]:
    """Return a lobe's lights: for the bingham form, each of those given in front and at the back.

    Args:
        lights: Those in front.
        form: Of the lobe.
    """
    if form is not Form.BINGHAM:
        return list(lights)
    front, back = schema.SIDES
    return [replace(light, name=_joined(front, light.name)) for light in lights] + [
        replace(
            light,
            name=_joined(back, light.name),
            constants={schema.ORIENT_BACK: FLIP, **light.constants},
            ops=(schema.ORIENT_BACK, *light.ops),
        )
        for light in lights
    ]


def _joined(side: str, name: str) -> str:
    return f"{side}_{name}" if name else side
