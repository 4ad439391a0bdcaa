# SPDX-License-Identifier: Apache-2.0
"""How wrong a fit is: the errors that every table and report of asglight uses.

The truth is the map with negative and non-finite texels set to 0. Texels weigh by their exact solid
angle, RGB is summed, lobes narrower than a texel are integrated over it. Filtered radiance is taken
at 768 Fibonacci directions; max and mean run over directions and channels alike.

    env      sum omega |fit - ref| / sum omega ref
    flux     |sum omega fit / sum omega ref - 1|
    irr      sum |dE| / sum E        E: irradiance (Lambert's cosine)
    irrMax   max |dE| / mean E
    r0.5     sum |dL| / sum L        L: GGX-filtered radiance, N = V = R, alpha = roughness^2
    r0.25    the same at roughness 0.25
    flicker  sum over frames and directions of |change of fit - change of ref| / sum of ref,
             of the r0.25 radiance from each frame to the next
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from asglight.lobes import Lobes, texels
from asglight.shading import kernels
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions
from asglight.threads import one_thread

DIRECTION_COUNT = 768
LOBE_ROWS = 64
"""Of the maps that two shots of lobes are compared on. Texels have the lobes' exact means; what is
left is the cosine's change over a texel, nearly the same for both."""

ROWS_MIN = 32
"""Of the grid that `irradiance_error` works on. A map is constant over each of its texels; one of a
few rows, taken at their centres, would shine on a ball from a few points."""

FRAMES_AT_ONCE = 32
"""Maps of two sets of lobes filtered together: 6 MB."""

METRIC_NAMES = ("env", "flux", "irr", "irrMax", "r0.5", "r0.25")
FLICKER = "flicker"
"""The one of a sequence, beside those of its frames."""


@dataclass(frozen=True)
class FrameErrors:
    """The errors of one frame, and the filtered radiance that flicker needs.

    Attributes:
        values: Metric name to value, in the order of `METRIC_NAMES`.
        fit_filtered: r0.25 radiance of the fit.  [P, 3]
        reference_filtered: The same of the reference.  [P, 3]
    """

    values: dict[str, float]
    fit_filtered: Tensor = field(repr=False)
    reference_filtered: Tensor = field(repr=False)


@one_thread()
def frame_errors(lobes: Lobes, reference: Tensor) -> FrameErrors:
    """Judge the lobes of one frame against its map.

    On one thread of the processor: its blocks are small, and with two threads beside another
    program on a machine of two cores a frame took up to a minute, for 0.2 s.

    Args:
        lobes: N lobes.  [N, .]
        reference: Repaired radiance.  [H, W, 3]
    """
    height, width, _ = reference.shape
    return map_errors(texels.texel_means(lobes.to(torch.float32), height, width), reference)


def map_errors(fit: Tensor, reference: Tensor) -> FrameErrors:
    """Judge a reconstructed map against the reference, both [H, W, 3].

    A black reference has no scale: its errors are 0 for a black fit and infinite otherwise.
    """
    return maps_errors(fit[None], reference)[0]


def maps_errors(fits: Tensor, reference: Tensor) -> list[FrameErrors]:
    """Judge several maps against one reference: the kernels, which cost most, are computed once.

    Args:
        fits: Reconstructed maps.  [K, H, W, 3]
        reference: Repaired radiance.  [H, W, 3]
    """
    return _errors(list(fits), [reference], [0] * len(fits))


def frames_errors(fits: Sequence[Tensor], references: Sequence[Tensor]) -> list[FrameErrors]:
    """Judge maps against a reference each; the kernels are computed once for all.

    Args:
        fits: Reconstructed maps.  F times [H, W, 3]
        references: Repaired radiance.  F times [H, W, 3]
    """
    return _errors(fits, references, list(range(len(fits))))


@one_thread()
def _errors(
    fits: Sequence[Tensor], references: Sequence[Tensor], which: Sequence[int]
) -> list[FrameErrors]:
    """Judge maps, each against one of some references.

    Maps are filtered in units of their reference's mean, so that neither the sums of bright ones
    leave float32 nor dim ones lose their digits.

    Args:
        fits: Reconstructed maps.  K times [H, W, 3]
        references: Repaired radiance.  R times [H, W, 3]
        which: The reference of each map.
    """
    height, width, _ = references[0].shape
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    units = [_unit(reference, solid_angle) for reference in references]
    dtype = fits[0].dtype
    truths = [(own.double() / unit).to(dtype) for own, unit in zip(references, units, strict=True)]
    shown = [(own.double() / units[r]).to(dtype) for own, r in zip(fits, which, strict=True)]
    directions = fibonacci_directions(DIRECTION_COUNT, dtype=dtype)
    every = torch.stack([*truths, *shown])
    irradiance, rough, glossy = (
        kernels.filtered(every, kernel, directions).double()
        for kernel in (kernels.LAMBERT, 0.5, 0.25)
    )
    fluxes = [(solid_angle * truth).sum() for truth in truths]
    return [
        FrameErrors(
            {
                "env": _ratio((solid_angle * (fit - truths[r]).abs()).sum(), fluxes[r]),
                "flux": _ratio(((solid_angle * fit).sum() - fluxes[r]).abs(), fluxes[r]),
                **_lambert_errors(irradiance[k], irradiance[r]),
                "r0.5": _relative(rough[k], rough[r]),
                "r0.25": _relative(glossy[k], glossy[r]),
            },
            glossy[k] * units[r],
            glossy[r] * units[r],
        )
        for k, (fit, r) in enumerate(zip(shown, which, strict=True), start=len(truths))
    ]


def _unit(reference: Tensor, solid_angle: Tensor) -> float:
    """Return the mean radiance over the sphere and RGB; 1 for a black map.

    Args:
        reference: [H, W, 3]
        solid_angle: In float64.  [H, W, 1]
    """
    mean = float((solid_angle * reference).sum()) / (12 * math.pi)
    return mean if mean > 0 else 1.0


def _lambert_errors(fit: Tensor, reference: Tensor) -> dict[str, float]:
    worst = (fit - reference).abs().max()
    return {"irr": _relative(fit, reference), "irrMax": _ratio(worst, reference.mean())}


def _relative(fit: Tensor, reference: Tensor) -> float:
    return _ratio((fit - reference).abs().sum(), reference.sum())


def irradiance_error(lobes: Lobes, reference: Tensor) -> float:
    """Return irr of the lobes of one frame alone, at a third of the cost of `frame_errors`.

    The map is taken as constant within its texels, which makes a difference if they are large.

    Args:
        lobes: N lobes.  [N, .]
        reference: Repaired radiance.  [H, W, 3]
    """
    reference = latlong.split(reference, ROWS_MIN)
    height, width, _ = reference.shape
    fit = texels.texel_means(lobes.to(torch.float32), height, width)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    both = torch.stack([fit, reference]).double() / _unit(reference, solid_angle)
    directions = fibonacci_directions(DIRECTION_COUNT, dtype=torch.float32)
    both = kernels.filtered(both.float(), kernels.LAMBERT, directions).double()
    return _relative(both[0], both[1])


def irradiance_errors(lobes: Lobes, reference: Lobes) -> list[float]:
    """Return irr of each frame of a shot whose reference is a shot of lobes too.

    Args:
        lobes: N lobes.  [F, N, .]
        reference: M lobes.  [F, M, .]
    """
    directions = fibonacci_directions(DIRECTION_COUNT, dtype=torch.float32)
    errors: list[float] = []
    for first in range(0, len(lobes.axes), FRAMES_AT_ONCE):
        some = slice(first, first + FRAMES_AT_ONCE)
        shown, truth = (
            kernels.filtered(_maps(shot[some]), kernels.LAMBERT, directions).double()
            for shot in (lobes, reference)
        )
        errors += map(_relative, shown, truth)
    return errors


def _maps(lobes: Lobes) -> Tensor:
    """Return the texel means of each frame.  [F, LOBE_ROWS, 2 LOBE_ROWS, 3]."""
    exact = lobes.to(torch.float32)
    frames = (exact[index] for index in range(len(exact.axes)))
    return torch.stack([texels.texel_means(frame, LOBE_ROWS, 2 * LOBE_ROWS) for frame in frames])


@dataclass(frozen=True)
class SequenceErrors:
    """The errors of a sequence.

    Attributes:
        frames: Frame number to its metrics.
        mean: Mean of each metric over the frames; of flicker, the sequence's value.
        worst: Frame number with the largest value of each metric.
    """

    frames: dict[int, dict[str, float]]
    mean: dict[str, float]
    worst: dict[str, int]


def sequence_errors(judged: Iterable[tuple[int, FrameErrors]]) -> SequenceErrors:
    """Gather per-frame errors in frame order; holds one frame's filtered radiance at a time."""
    rows: dict[int, dict[str, float]] = {}
    change, total = 0.0, 0.0
    previous: FrameErrors | None = None
    for frame, errors in judged:
        rows[frame] = errors.values
        total += float(errors.reference_filtered.sum())
        if previous is not None:
            fit_change = errors.fit_filtered - previous.fit_filtered
            reference_change = errors.reference_filtered - previous.reference_filtered
            change += float((fit_change - reference_change).abs().sum())
        previous = errors
    mean = {name: _mean(row[name] for row in rows.values()) for name in METRIC_NAMES}
    if len(rows) > 1:
        mean[FLICKER] = change / total if total > 0 else (0.0 if change == 0 else float("inf"))
    worst = {name: max(rows, key=lambda frame: rows[frame][name]) for name in METRIC_NAMES}
    return SequenceErrors(rows, mean, worst)


def _mean(values: Iterator[float]) -> float:
    listed = list(values)
    return sum(listed) / len(listed)


def _ratio(part: Tensor, whole: Tensor) -> float:
    if float(whole) > 0:
        return float(part) / float(whole)
    return 0.0 if float(part) == 0 else float("inf")
