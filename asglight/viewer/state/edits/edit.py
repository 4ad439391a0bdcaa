# SPDX-License-Identifier: Apache-2.0
"""Edits of lobes as plain data: what is done to which lobe, in which frames.

An edit of a light says by how much, not to what, so the same edit of all frames keeps what a lobe
does over time. Muting, deleting, adding and renaming are edits as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.lobes import frames

LOG2_MAX = 64.0
"""Largest factor of one edit, as a power of 2: nineteen decades, more than the sun over starlight,
and no product of it with a float32 leaves float64."""

TINT_MIN = 2.0**-20
"""Least component of a tint, a millionth: black on every display, and it can be turned up again."""

IDENTITY = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Span:
    """Frames in which an edit holds in full, and how softly it comes and goes around them.

    Attributes:
        first: Place of the first frame in `tracks.frames`.
        last: Place of the last one.
        soft: Frames over which it comes before the first and goes after the last.
    """

    first: int
    last: int
    soft: int = 0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: The span ends before it begins, or is soft over less than no frame.
        """
        if not 0 <= self.first <= self.last or self.soft < 0:
            raise ValueError(f"span: {self.first} to {self.last}, soft {self.soft}")

    @classmethod
    def at(cls, place: int) -> "Span":
        """Return the span of one frame."""
        return cls(place, place)

    def weights(self, numbers: Sequence[int]) -> Tensor:
        """Return how much of the edit each frame takes, from 0 to 1, float64.  [F].

        Outside of the span it falls as `1 - 3 t^2 + 2 t^3` of the distance in frames, so that light
        neither jumps nor bends where it begins to change.

        Args:
            numbers: The frame numbers of the tracks.

        Raises:
            ValueError: The span leaves the tracks.
        """
        if self.last >= len(numbers):
            raise ValueError(f"span: {self.first} to {self.last} of {len(numbers)} frames")
        frame = torch.tensor(numbers, dtype=torch.float64)
        outside = torch.maximum(numbers[self.first] - frame, frame - numbers[self.last])
        t = (outside.clamp(min=0) / (self.soft + 1)).clamp(max=1)
        return 1 - t * t * (3 - 2 * t)

    def words(self, numbers: Sequence[int]) -> str:
        """Say which frames it takes."""
        first, last = numbers[self.first], numbers[self.last]
        where = f"frame {first}" if first == last else f"frames {first}-{last}"
        return f"{where}, soft {self.soft}" if self.soft else where


@dataclass(frozen=True)
class Edit:
    """What is done to the light of one lobe.

    Attributes:
        lobe: Index of the lobe.
        span: Where; None for all frames.
        gain_log2: Stops by which red, green and blue of the amplitude grow.
        sharpness_log2: Powers of 2 by which the sharpness along x and y grows.
        rotation: Quaternion (w, x, y, z) by which the lobe turns, about the world's axes.
    """

    lobe: int
    span: Span | None = None
    gain_log2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sharpness_log2: tuple[float, float] = (0.0, 0.0)
    rotation: tuple[float, float, float, float] = IDENTITY

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: A power is not finite or beyond LOG2_MAX, or the quaternion has no length.
        """
        powers = (*self.gain_log2, *self.sharpness_log2)
        if not all(math.isfinite(power) and abs(power) <= LOG2_MAX for power in powers):
            raise ValueError(f"powers of 2: {powers}, expected at most +-{LOG2_MAX:g}")
        length = math.hypot(*self.rotation)
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"rotation: {self.rotation}, expected a quaternion")

    @property
    def what(self) -> str:
        """What is done, in a few words."""
        if any(self.rotation[1:]):
            degrees = math.degrees(2 * math.acos(min(abs(self.rotation[0]), 1.0)))
            return f"turn by {degrees:.1f} deg"
        if any(self.sharpness_log2):
            return "width and height"
        red, green, blue = self.gain_log2
        return f"intensity {red:+.2f} EV" if red == green == blue else "colour"

    @property
    def is_identity(self) -> bool:
        """Whether nothing changes."""
        return not any((*self.gain_log2, *self.sharpness_log2, *self.rotation[1:]))


@dataclass(frozen=True)
class Mute:
    """A lobe that lights is muted in all frames, and a muted one lights again."""

    lobe: int

    @property
    def what(self) -> str:
        """What is done."""
        return "mute on or off"


@dataclass(frozen=True)
class Delete:
    """A lobe goes."""

    lobe: int

    @property
    def what(self) -> str:
        """What is done."""
        return "deleted"


@dataclass(frozen=True)
class Restore:
    """A lobe becomes what it was before any edit, in all frames."""

    lobe: int

    @property
    def what(self) -> str:
        """What is done."""
        return "as it was fitted"


@dataclass(frozen=True)
class Rename:
    """A lobe is called otherwise.

    Attributes:
        lobe: Index of the lobe.
        name: What it is called from now on; empty for the name that it has in the stage.
    """

    lobe: int
    name: str

    @property
    def what(self) -> str:
        """What is done."""
        return f"called {self.name}" if self.name else "called as in the stage"


@dataclass(frozen=True)
class Add:
    """A round lobe comes, or a square key, the same in all frames.

    Attributes:
        lobe: Its index: the number of lobes before.
        direction: Unit vector.
        sharpness: Along both axes.
        amplitude: Linear RGB.
        is_key: Whether it is a key, which is named as such.
    """

    lobe: int
    direction: tuple[float, float, float]
    sharpness: float
    amplitude: tuple[float, float, float]
    is_key: bool = False

    @property
    def what(self) -> str:
        """What is done."""
        return "added"


AnyEdit = Edit | Mute | Delete | Restore | Rename | Add


def turn(lobe: int, span: Span | None, source: Sequence[float], target: Sequence[float]) -> Edit:
    """Turn a lobe the shortest way that takes one direction to another.

    Args:
        lobe: Index of the lobe.
        span: Where; None turns all frames alike.
        source: Direction of any length, such as that at which a drag began.  [3]
        target: Direction to which it goes.  [3]
    """
    return Edit(lobe, span, rotation=shortest_rotation(source, target))


def shortest_rotation(
    source: Sequence[float], target: Sequence[float]
) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of the smallest rotation between two directions.

    It is the product of the target and the mean direction: (mean . source, source x mean). For
    opposite directions it is a half turn about some axis at right angles to them.

    Args:
        source: Direction of any length.  [3]
        target: Direction of any length.  [3]
    """
    start, end = (_unit(direction) for direction in (source, target))
    mean = start + end
    if float(mean.norm()) < 1e-7:  # opposite to rounding: the sum has lost its direction
        x, y, z = frames.axes_around(start)[0].tolist()
        return (0.0, x, y, z)
    middle = mean / mean.norm()
    x, y, z = torch.linalg.cross(start, middle).tolist()
    return (float(start @ middle), x, y, z)


def _unit(direction: Sequence[float]) -> Tensor:
    return torch.nn.functional.normalize(torch.as_tensor(direction, dtype=torch.float64), dim=0)
