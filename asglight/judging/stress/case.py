# SPDX-License-Identifier: Apache-2.0
"""What a stress case is: an input, how it is fitted, and what its result may be off by."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from torch import Tensor

from asglight.fitting.options import LOBES
from asglight.judging.stress.maps import render
from asglight.lobes import Form, Lobes


class Group(StrEnum):
    """What is extreme about a case."""

    STIFF = "stiff"
    RADIANCE = "radiance"
    SHAPE = "shape"
    TIME = "time"
    BROKEN = "broken"
    RECOVERY = "recovery"


@dataclass(frozen=True)
class Bound:
    """What an error may be.

    Attributes:
        value: The largest that passes.
        reason: Why it is more than other cases are allowed, as a user would be told; empty for the
            bound that all cases have.
    """

    value: float
    reason: str = ""


FLUX = Bound(5e-3)
"""Of the light of any frame: half a percent, a fiftieth of a stop."""

IRRADIANCE = Bound(5e-3)
"""irr (metrics.py) of any frame: half a percent on a white ball, which no eye tells from none."""

GRADIENT = Bound(1e-2)
"""Of the gradient's length (gradient.py). A texel's shape is held in the derivative while a
lobe moves over it (lobe_images.py); the rest is float32."""


@dataclass(frozen=True)
class Recovery:
    """How near known lobes have to be found again, in every frame.

    Attributes:
        direction: Angle to the known direction, in standard deviations of the lobe's sharper axis.
        sharpness: Relative.
        amplitude: Relative to the lobe's brightest channel.
        reason: Why more is allowed than `FOUND`.
    """

    direction: float
    sharpness: float
    amplitude: float
    reason: str = ""


FOUND = Recovery(0.05, 0.03, 0.03)
"""Three percent of a width or a brightness is what an artist may see when two pictures flip; a
twentieth of a width is below what a width's error does."""


@dataclass(frozen=True)
class Case:
    """One input and what is expected of it.

    Attributes:
        name: Unique, words with hyphens.
        group: What is extreme.
        holds: The input, in a few words.
        frames: Makes the frames as their files hold them.  One [H, W, 3] a frame
        lobes: Number of lobes fitted.
        form: Lobe function.
        known: Makes the lobes that the frames were rendered from, if they were.  One [N, .] a frame
        flux: Bound of the flux.
        irradiance: Bound of irr.
        gradient: Bound of the gradient's error.
        recovery: How near the known lobes are found again, if that can be asked.
        refused: Words of the one line that refuses the input, where it has to be.
    """

    name: str
    group: Group
    holds: str
    frames: Callable[[], list[Tensor]]
    lobes: int = LOBES
    form: Form = Form.ASG
    known: Callable[[], list[Lobes]] | None = None
    flux: Bound = FLUX
    irradiance: Bound = IRRADIANCE
    gradient: Bound = GRADIENT
    recovery: Recovery | None = None
    refused: str | None = None


def of_lobes(
    group: Group,
    name: str,
    holds: str,
    known: Callable[[], list[Lobes]],
    *,
    rows: int,
    lobes: int = 1,
    form: Form = Form.ASG,
    irradiance: Bound = IRRADIANCE,
    gradient: Bound = GRADIENT,
    recovery: Recovery | None = None,
) -> Case:
    """Return a case whose frames are rendered from known lobes.

    Args:
        group: What is extreme.
        name: Unique, words with hyphens.
        holds: The input, in a few words.
        known: Makes the lobes.  One [N, .] a frame
        rows: Of the maps, which are twice as wide.
        lobes: Number of lobes fitted.
        form: Lobe function that is fitted, as the known ones have it.
        irradiance: Bound of irr.
        gradient: Bound of the gradient's error.
        recovery: How near the known lobes are found again, if that can be asked.
    """

    def frames() -> list[Tensor]:
        return [render(each, rows) for each in known()]

    return Case(
        name,
        group,
        holds,
        frames,
        lobes=lobes,
        form=form,
        known=known,
        irradiance=irradiance,
        gradient=gradient,
        recovery=recovery,
    )
