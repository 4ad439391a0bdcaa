# SPDX-License-Identifier: Apache-2.0
"""Lobes and lobe tracks as plain data.

A lobe is one anisotropic spherical Gaussian (ASG): an orthonormal frame whose z axis points at the
light, two sharpnesses along the frame's x and y, and the RGB radiance at the lobe's centre. A track
is one lobe followed over frames: index N means the same light in every frame.

Dimension letters: F frames, N lobes, 3 RGB or xyz.
"""

import itertools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Self

import torch
from torch import Tensor

from asglight.errors import InputError

FRAMES_MAX = 1_000_000
"""Of a shot: eleven hours at 24 frames a second. A range beyond it is damage, and would fill the
memory."""

FRAME_MAX = 2**31 - 1
"""The largest frame number: USD holds whole numbers of 32 bits."""

SLANT = 7
"""Numbers of a lobe's slant."""


class Form(StrEnum):
    """The function of direction that a lobe stands for; x, y, z are components in its frame."""

    ASG = "asg"
    """`max(z, 0) exp(-sx x^2 - sy y^2)` (Xu et al. 2013). The default."""
    BINGHAM = "bingham"
    """`exp(-sx x^2 - sy y^2)` (Clausen et al. 2024, taken literally): the same at d and -d."""
    SG = "sg"
    """`exp(s (z - 1))`, isotropic; both sharpnesses hold s."""
    FLAT = "flat"
    """`max(z, 0) (1 - (1 - exp(-sx x^2 - sy y^2))^3)`: a lamp with an edge (lobes/flat.py)."""


@dataclass(frozen=True)
class Lobes:
    """N lobes of one form, with any leading batch shape.

    Examples:
        >>> tracks.at(1001)
        <Lobes: 2 of form asg, 2 lit, float32 on cpu>

    Attributes:
        axes: Rows axis_x, axis_y, axis_z of a right-handed orthonormal frame.  [..., N, 3, 3]
        sharpness: (sx, sy), dimensionless, > 0.  [..., N, 2]
        amplitude: Linear RGB radiance at axis_z, >= 0 but for `flat.terms`.  [..., N, 3]
        form: The lobe function, the same for all lobes.
        slant: Of keys, how their cards stand beside the ones that face the origin
            (lobes/rectangles.py); None of other lobes.  [..., N, 7]
    """

    axes: Tensor
    sharpness: Tensor
    amplitude: Tensor
    form: Form = Form.ASG
    slant: Tensor | None = None

    def __post_init__(self) -> None:
        """Check the shapes."""
        batch = self.axes.shape[:-2]
        wanted_shapes = {"axes": (3, 3), "sharpness": (2,), "amplitude": (3,), "slant": (SLANT,)}
        for name, expected in wanted_shapes.items():
            values: Tensor | None = getattr(self, name)
            shape = (*batch, *expected) if values is None else values.shape
            if tuple(shape) != (*batch, *expected):
                wanted = ", ".join(["..., N", *map(str, expected)])
                raise ValueError(f"{name}: shape {tuple(shape)}, expected [{wanted}]")

    def __repr__(self) -> str:
        """Say how many of which form, and where."""
        batch = list(self.axes.shape[:-3])
        of = f", of each {batch}" if batch else ""
        lit = int((self.amplitude > 0).any(-1).sum())
        where = f"{str(self.amplitude.dtype).removeprefix('torch.')} on {self.amplitude.device}"
        return f"<Lobes: {self.count} of form {self.form}{of}, {lit} lit, {where}>"

    @property
    def axis_x(self) -> Tensor:
        """Direction of the first sharpness.  [..., N, 3]."""
        return self.axes[..., 0, :]

    @property
    def axis_y(self) -> Tensor:
        """Direction of the second sharpness.  [..., N, 3]."""
        return self.axes[..., 1, :]

    @property
    def axis_z(self) -> Tensor:
        """Direction of the light.  [..., N, 3]."""
        return self.axes[..., 2, :]

    @property
    def count(self) -> int:
        """N, the number of lobes."""
        return self.axes.shape[-3]

    def __getitem__(self, index: Any) -> Self:
        """Index the leading dimensions, as one would index each tensor."""
        return self.each(lambda values: values[index])

    def to(self, *args: Any, **kwargs: Any) -> Self:
        """Move or convert every tensor, as `torch.Tensor.to`."""
        return self.each(lambda values: values.to(*args, **kwargs))

    def clone(self) -> Self:
        """Copy every tensor."""
        return self.each(torch.clone)

    def each(self, change: Callable[[Tensor], Tensor]) -> Self:
        """Return lobes of which every tensor is changed."""
        return replace(
            self,
            axes=change(self.axes),
            sharpness=change(self.sharpness),
            amplitude=change(self.amplitude),
            slant=None if self.slant is None else change(self.slant),
        )

    def select(self, lobes: Tensor) -> Self:
        """Pick lobes by index or mask along N."""
        return replace(
            self,
            axes=self.axes[..., lobes, :, :],
            sharpness=self.sharpness[..., lobes, :],
            amplitude=self.amplitude[..., lobes, :],
            slant=None if self.slant is None else self.slant[..., lobes, :],
        )

    def split(self, count: int) -> tuple[Self, Self]:
        """Return the first so many lobes and the others."""
        every = torch.arange(self.count, device=self.axes.device)
        return self.select(every[:count]), self.select(every[count:])

    def replaced(self, lobes: Tensor, others: "Lobes") -> Self:
        """Return a copy with other lobes in the places that `select` picks.

        Args:
            lobes: Indices or mask along N.
            others: As many as are picked.
        """
        found = self.clone()
        found.axes[..., lobes, :, :] = others.axes
        found.sharpness[..., lobes, :] = others.sharpness
        found.amplitude[..., lobes, :] = others.amplitude
        if found.slant is not None and others.slant is not None:
            found.slant[..., lobes, :] = others.slant
        return found


def combined(every: Sequence[Lobes], combine: Callable[[list[Tensor]], Tensor]) -> Lobes:
    """Return lobes whose every tensor comes of those of several, of the first one's form.

    Args:
        every: The lobes. Of keys and other lobes together, the others are not slanted.
        combine: From one tensor of each to that of the result.
    """
    slants = [one.slant for one in every]
    are_keys = any(slant is not None for slant in slants)
    still = [one.axes.new_zeros(*one.axes.shape[:-2], SLANT) for one in every] if are_keys else []
    return Lobes(
        axes=combine([one.axes for one in every]),
        sharpness=combine([one.sharpness for one in every]),
        amplitude=combine([one.amplitude for one in every]),
        form=every[0].form,
        slant=combine(
            [rest if own is None else own for own, rest in zip(slants, still, strict=True)]
        )
        if are_keys
        else None,
    )


def stack(frames: list[Lobes]) -> Lobes:
    """Stack equally many lobes of F frames along a new first dimension.  [F, N, .]."""
    return combined(frames, torch.stack)


def joined(one: Lobes, other: Lobes) -> Lobes:
    """Return the frames of two, the other's last.  [F, N, .] and [F', N, .] -> [F + F', N, .]."""
    return combined([one, other], torch.cat)


def chosen(first: Tensor, one: Lobes, other: Lobes) -> Lobes:
    """Return the one's lobes where marked and the other's elsewhere.

    Args:
        first: Which are the one's: of frames [F], of lobes in all frames [1, N], or of each [F, N].
        one: Lobes of every frame.  [F, N, .]
        other: As many.  [F, N, .]
    """

    def of(pair: list[Tensor]) -> Tensor:
        return torch.where(first.reshape(*first.shape, *[1] * (pair[0].ndim - first.ndim)), *pair)

    return combined([one, other], of)


def lobe_names(count: int, first: int = 0, kind: str = "lobe") -> tuple[str, ...]:
    """Return `lobe_00`, `lobe_01`, ..., of equal length so that they sort in order.

    Args:
        count: How many.
        first: Number of the first.
        kind: What is named.
    """
    digits = max(2, len(str(first + count - 1)))
    return tuple(f"{kind}_{index:0{digits}d}" for index in range(first, first + count))


def first_unused(names: Iterable[str], kind: str = "lobe") -> int:
    """Return the number after the highest one that names a lobe, or another kind."""
    numbered = (re.fullmatch(rf"{kind}_(\d+)", name) for name in names)
    return max((int(match[1]) + 1 for match in numbered if match), default=0)


def check_frames(frames: Sequence[int]) -> None:
    """Refuse frame numbers that a stage cannot have.

    Raises:
        InputError: They are too far apart, or have more digits than USD holds.
    """
    first, last = frames[0], frames[-1]
    if max(-first, last) > FRAME_MAX:
        raise InputError(
            f"frames: {first} to {last}; expected numbers up to {FRAME_MAX:,}. Are they times? "
            "Number the images anew."
        )
    if last - first >= FRAMES_MAX:
        raise InputError(
            f"frames: {first} to {last}; expected fewer than {FRAMES_MAX:,} from the first to the "
            "last. Write them to stages of their own with --frames."
        )


@dataclass(frozen=True)
class LobeTracks:
    """N lobes followed over F frames.

    Examples:
        >>> tracks.names
        ('lobe_00', 'lobe_01')

    Attributes:
        frames: Frame numbers, ascending; they are the USD time codes.
        fps: Frames per second.
        lobes: The lobes of every frame.  [F, N, .]
        metadata: What made them: version, preset, options, source, errors. JSON values only.
        names: What each lobe is called, for good: lights are linked by name. None are `lobe_00`,
            `lobe_01` and so on.  N
        display_names: What a person calls some of them, by name; any text.
    """

    frames: tuple[int, ...]
    fps: float
    lobes: Lobes
    metadata: Mapping[str, Any] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    display_names: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Name the lobes where nobody did; check that frames, lobes and names agree."""
        if not self.names:
            object.__setattr__(self, "names", lobe_names(self.lobes.count))
        if self.lobes.axes.ndim != 4 or len(self.frames) != self.lobes.axes.shape[0]:
            raise ValueError(
                f"frames: {len(self.frames)} frame numbers for lobes of shape "
                f"{tuple(self.lobes.axes.shape[:-2])}; expected [F, N]"
            )
        if any(b <= a for a, b in itertools.pairwise(self.frames)):
            raise ValueError("frames: not ascending")
        if len(self.names) != self.lobes.count or len(set(self.names)) != len(self.names):
            raise ValueError(f"names: {self.names} for {self.lobes.count} lobes; expected one each")

    def __repr__(self) -> str:
        """Say how many, which frames, and what made them."""
        count = len(self.frames)
        span = f" {self.frames[0]}-{self.frames[-1]}" if count else ""
        frames = f"frame {self.frames[0]}" if count == 1 else f"{count} frames{span}"
        known = {name: self.metadata.get(name) for name in ("preset", "source")}
        made = "".join(f", {name} {value}" for name, value in known.items() if value)
        return (
            f"<LobeTracks: {self.lobes.count} lobes of form {self.lobes.form}, {frames} at "
            f"{self.fps:g} fps{made}>"
        )

    def at(self, frame: int) -> Lobes:
        """Return the lobes of one frame.  [N, .].

        Raises:
            KeyError: There is no such frame.
        """
        try:
            return self.lobes[self.frames.index(frame)]
        except ValueError:
            raise KeyError(
                f"frame {frame}: not in {self.frames[0]}-{self.frames[-1]} ({len(self.frames)})"
            ) from None
