# SPDX-License-Identifier: Apache-2.0
"""Attributes on the level of Sdf: a default alone, or a default and the samples that are needed.

The stage level would take twice the time for the same file. An attribute that does not change
beyond its tolerance has a default only; any other has a default (the first frame's) and time
samples, without those that interpolation reproduces (samples.py). Lights of one lobe have
tracks in common, such as their colour: each is authored once and copied, which takes a tenth of the
time, and a crate stores it once.

Between frames, lights have the samples that linear interpolation needs (between.py).

Symbols: F frames, T samples in time, K components.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Sdf, Vt
from torch import Tensor

from asglight.usd import schema
from asglight.usd.check.limits import number_findings
from asglight.usd.write import samples


class TrackAuthor:
    """Authors tracks over the same frames and counts their samples.

    Attributes:
        frames: Frame numbers.  [F]
        written: Time samples authored.
        between: How many of them lie between frames.
        left_out: Frames without a sample: interpolation or a constant default reproduces them.
        checked: Attributes whose numbers were looked at.
        findings: Numbers that no light can have, a line each as of the lint.
    """

    def __init__(self, frames: tuple[int, ...]) -> None:
        """Start counting."""
        self.frames = np.asarray(frames, dtype=np.float64)
        self.written = 0
        self.between = 0
        self.left_out = 0
        self.checked: set[Sdf.Path] = set()
        self.findings: list[str] = []
        self._authored: dict[
            tuple[str, float, bytes, bytes], tuple[Sdf.Path, NDArray[np.bool_]]
        ] = {}

    def track(
        self,
        prim: Sdf.PrimSpec,
        name: str,
        values: Tensor,
        tolerance: float,
        times: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Author one attribute over all frames.

        Args:
            prim: Owner.
            name: Attribute.
            values: One value a time; quaternions as (w, x, y, z).  [T, K]
            tolerance: Relative error of a sample left out; quaternions have their own.
            times: Of the values: all frames, and some between.  [T]

        Returns:
            What was authored: the default, then the samples.  [1 + samples, K]
        """
        rounded = values.to(torch.float32).numpy()
        kind = schema.VALUE_TYPES[name]
        key = str(kind), tolerance, rounded.tobytes(), times.tobytes()
        place = prim.path.AppendProperty(name)
        self.findings += [f"{place}: {text}" for text in number_findings(name, rounded, rounded)]
        self.checked.add(place)
        same = self._authored.get(key)
        if same is None:
            keep = _needed(rounded, kind, tolerance, times)
            self._author(prim, name, _to_gf(rounded, kind), keep, times)
            self._authored[key] = place, keep
        else:
            path, keep = same
            Sdf.CopySpec(prim.layer, path, prim.layer, place)
            self._count(keep, times)
        return np.concatenate([rounded[:1], rounded[keep]])

    def held(
        self, prim: Sdf.PrimSpec, name: str, values: list[Any], keep: NDArray[np.bool_]
    ) -> None:
        """Author one attribute from F values, of which the marked ones become samples.

        Args:
            prim: Owner.
            name: Attribute.
            values: One value a frame, as USD stores it.
            keep: Marks the samples; none leaves the default alone.  [F]
        """
        self._author(prim, name, values, keep, self.frames)

    def _author(
        self,
        prim: Sdf.PrimSpec,
        name: str,
        values: list[Any],
        keep: NDArray[np.bool_],
        times: NDArray[np.float64],
    ) -> None:
        path = constant(prim, name, values[0]).path
        set_sample, codes = prim.layer.SetTimeSample, times.tolist()
        for index in np.flatnonzero(keep).tolist():
            set_sample(path, codes[index], values[index])
        self._count(keep, times)

    def _count(self, keep: NDArray[np.bool_], times: NDArray[np.float64]) -> None:
        at_frames = int(keep[np.searchsorted(times, self.frames)].sum())
        self.written += int(keep.sum())
        self.between += int(keep.sum()) - at_frames
        self.left_out += len(self.frames) - at_frames


def _needed(
    values: NDArray[np.float32],
    kind: Sdf.ValueTypeName,
    tolerance: float,
    times: NDArray[np.float64],
) -> NDArray[np.bool_]:
    exact = values.astype(np.float64)
    if kind == Sdf.ValueTypeNames.Quatf:
        return samples.kept_quaternions(exact, times)
    return samples.kept(exact, times, tolerance)


def constant(prim: Sdf.PrimSpec, name: str, value: Any) -> Sdf.AttributeSpec:
    """Author an attribute with a default value."""
    uniform = name in schema.UNIFORM
    variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
    attribute = Sdf.AttributeSpec(prim, name, schema.VALUE_TYPES[name], variability)
    attribute.default = value
    return attribute


def _to_gf(values: NDArray[np.float32], kind: Sdf.ValueTypeName) -> list[Any]:
    """Convert rows to what USD stores: float, Vec2f, Vec3f, Vec3d or Quatf.  [F, K] -> F values."""
    if kind == Sdf.ValueTypeNames.Float:
        return values[:, 0].tolist()
    if kind == Sdf.ValueTypeNames.Quatf:  # whose arrays have the real part last
        return list(Vt.QuatfArray.FromNumpy(np.roll(values, -1, axis=-1)))
    if kind == Sdf.ValueTypeNames.Double3:
        return list(Vt.Vec3dArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float64)))
    is_pair = kind == Sdf.ValueTypeNames.Float2
    arrays = Vt.Vec2fArray if is_pair else Vt.Vec3fArray
    return list(arrays.FromNumpy(np.ascontiguousarray(values)))
