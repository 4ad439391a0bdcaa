# SPDX-License-Identifier: Apache-2.0
"""How far linear interpolation strays from lobes in motion, for each kind of light.

A span is the time from one frame to the next of one lobe that is lit in both. A program
interpolates each attribute linearly between two samples in a span. The error is that of the light
which such attributes give against the light of the lobe at the same time: of its flux, of its
radiance and of its direction, each over what is allowed, the largest at the times that are probed.

The lobe's flux is linear. Mean squares and other values of the shape are known at even steps; in
between, polynomials go through their logarithms, which for narrow lobes is exact.

Here is what all kinds have in common, and what a lobe itself is; `span_lights.py` has its lights.

Symbols: S spans, Q probes, K even steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, Self

import torch
from torch import Tensor

from asglight.lobes import Lobes, asg

FLUX, RADIANCE, TURN_DEG = 3e-3, 1e-2, 0.1
"""What a light may be off between frames: its flux; the error of its radiance integrated over all
directions, over its flux; its direction."""

MARGIN = 0.5
"""Of these. The rest is for samples that are left out (layer.LIGHT_TOLERANCE) and for what a
polynomial does not tell of a shape. And where all lobes tremble, their errors of flux add up: with
0.8 the irr of `handheld2x` between frames, fitted with `live`, was 2.6 % above that of the fits
dissolved, more than was asked (`benchmarks.motion.measure`)."""

FAINT = 0.01
"""A lobe with less than this share of the flux of all counts as having it."""

PROBES = (0.25, 0.5, 0.75)
"""Of the way between two samples: errors are 0 at both and, where they matter, of second order."""


def times_between(before: Tensor, after: Tensor) -> Tensor:
    """Return when two samples are looked at: before, at the probes, after.  [S] -> [S, 1 + Q + 1].

    Args:
        before: The one sample, in shares of the span.  [S]
        after: The other.  [S]
    """
    first, last = before[:, None], after[:, None]
    return torch.cat([first, lerp(first, last), last], 1)


def at_ends(values: Tensor) -> tuple[Tensor, Tensor]:
    """Return what is at the two samples.  [S, 1 + Q + 1, ...] -> [S, 1, ...] twice."""
    return values[:, :1], values[:, -1:]


def at_probes(values: Tensor) -> Tensor:
    """Return what is at the probes.  [S, 1 + Q + 1, ...] -> [S, Q, ...]."""
    return values[:, 1:-1]


def lerp(before: Tensor, after: Tensor) -> Tensor:
    """Interpolate as a program does.  [S, 1, ...] -> [S, Q, ...]."""
    share = torch.tensor(PROBES, dtype=before.dtype).reshape(-1, *[1] * (before.ndim - 2))
    return before + share * (after - before)


class Spans(Protocol):
    """Spans of one kind of light."""

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        ...

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the largest error between two samples, over what is allowed.

        Args:
            before: The one, in shares of the span.  [S]
            after: The other.  [S]

        Returns:
            [S]
        """
        ...


@dataclass(frozen=True)
class Together:
    """Spans of several lights that share their samples."""

    parts: Sequence[Spans]

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return type(self)([part.at(index) for part in self.parts])

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the largest error of any light."""
        return torch.stack([part.error(before, after) for part in self.parts]).amax(0)


@dataclass(frozen=True)
class Flux:
    """The flux of lobes over their spans.

    Attributes:
        first: At the beginning.  [S, 3]
        last: At the end.  [S, 3]
        faint: The least that errors are relative to, at both ends.  [S, 2]
    """

    first: Tensor
    last: Tensor
    faint: Tensor

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return type(self)(self.first[index], self.last[index], self.faint[index])

    def part(self, share: float) -> Self:
        """Return a share of it."""
        return type(self)(share * self.first, share * self.last, share * self.faint)

    def when(self, time: Tensor) -> Tensor:
        """Return it at shares of the span.  [S, Q] -> [S, Q, 3]."""
        first, last = self.first[:, None], self.last[:, None]
        return first + time[..., None] * (last - first)

    def scale(self, time: Tensor, whole: Tensor) -> Tensor:
        """Return what errors are relative to.

        Args:
            time: In shares of the span.  [S, Q]
            whole: The flux then, the channels together.  [S, Q]

        Returns:
            [S, Q]
        """
        first, last = self.faint[:, :1], self.faint[:, 1:]
        return torch.maximum(whole, first + time * (last - first))


def worst(flux: Tensor, radiance: Tensor, scale: Tensor) -> Tensor:
    """Return the largest of errors of flux and radiance over what is allowed.  [S, Q] -> [S]."""
    over = torch.maximum(flux.abs() / FLUX, radiance / RADIANCE) / scale
    return over.amax(-1) / MARGIN


def total(light: Tensor) -> Tensor:
    """Return the sum of the channels; `sum` takes five times as long.  [..., 3] -> [...]."""
    red, green, blue = light.unbind(-1)
    return red + green + blue


PIECE = 4
"""Steps of one polynomial, at most. More of them in one do not help: a mean square is a power of
the sharpness of narrow lobes and stays as it is of broad ones, and a polynomial of a high degree
swings about such a bend."""


@dataclass(frozen=True)
class Curve:
    """Polynomials, one after the other, through what is known at even steps.

    Attributes:
        terms: Coefficients of 1, t, t^2, ..., t from 0 to 1 in each piece.  [K, S, pieces, ...]
    """

    terms: Tensor

    @classmethod
    def through(cls, nodes: Tensor) -> Self:
        """Take what is known at 0, 1 / (K - 1), ..., 1.  [S, K, ...]."""
        step = min(nodes.shape[1] - 1, PIECE)
        pieces = torch.stack(
            [nodes[:, first : first + step + 1] for first in range(0, nodes.shape[1] - 1, step)], 1
        )
        return cls(torch.einsum("jk,spk...->jsp...", _powers_from_nodes(step + 1), pieces))

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return type(self)(self.terms[:, index])

    def when(self, time: Tensor) -> Tensor:
        """Return its value at shares of the span.  [S, Q] -> [S, Q, ...]."""
        terms, count = self.terms, self.terms.shape[2]
        if count > 1:  # of one piece, all times have the same
            piece = (time * count).long().clamp(max=count - 1)
            time = time * count - piece
            terms = terms[:, torch.arange(len(piece))[:, None], piece]
        way = time.reshape(*time.shape, *[1] * (terms.ndim - 3))
        value = terms[-1]
        for term in reversed(terms[:-1].unbind()):  # Horner's scheme
            value = term + way * value
        return value


@cache
@torch.inference_mode(False)
def _powers_from_nodes(count: int) -> Tensor:
    """Return what makes coefficients of 1, t, t^2, ... of values at even steps.  [K, K]."""
    steps = torch.linspace(0, 1, count, dtype=torch.float64)
    return torch.linalg.inv(torch.vander(steps, increasing=True))


def gaussian_radiance(flux: Tensor, wanted: Tensor, shapes: Tensor) -> Tensor:
    """Return the integral of the error of a Gaussian's radiance, from above.

    With exponents u and v along its axes, each distributed as Gamma(1/2, 1), a change of the
    sharpness by xi and eta in the logarithm and of the flux by phi changes the radiance by
    phi - xi (u - 1/2) - eta (v - 1/2); its mean absolute value is at most the root of its mean
    square, phi^2 + (xi^2 + eta^2) / 2.

    Args:
        flux: As interpolated.  [S, Q, 3]
        wanted: As it should be.  [S, Q, 3]
        shapes: xi and eta.  [S, Q, 2]
    """
    spread = wanted.square() * (shapes[..., :1].square() + shapes[..., 1:].square()) / 2
    return total(((flux - wanted).square() + spread).sqrt())


@dataclass(frozen=True)
class LobeSpans:
    """Spans of what a lobe is: sharpness and amplitude.

    Attributes:
        flux: Its flux.
        sharpness: Its logarithm at both ends.  [S, 2, 2]
        integral: Logarithm of the unit lobe's integral.  S
        slopes: Its slopes along the logarithms of the sharpness.  S of 2
    """

    flux: Flux
    sharpness: Tensor
    integral: Curve
    slopes: Curve

    @classmethod
    def of(cls, flux: Flux, lobes: Lobes, moments: asg.Moments) -> Self:
        """Take lobes at even steps, and their moments.  [S, K, .]."""
        integral = Curve.through(moments.zeroth.log())
        slopes = Curve.through(asg.log_slopes(lobes, moments))
        return cls(flux, lobes.sharpness[:, [0, -1]].log(), integral, slopes)

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return type(self)(
            self.flux.at(index),
            self.sharpness[index],
            self.integral.at(index),
            self.slopes.at(index),
        )

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the largest error."""
        times = times_between(before, after)
        log, whole, light = self._log(times), self.integral.when(times), self.flux.when(times)
        shapes = lerp(*(end.exp() for end in at_ends(log))).log() - at_probes(log)
        amplitude = lerp(*at_ends(light / whole.exp()[..., None]))
        now, wanted = at_probes(times), at_probes(light)
        integral = at_probes(whole) + (self.slopes.when(now) * shapes).sum(-1)
        flux = amplitude * integral.exp()[..., None]
        return worst(
            total(flux - wanted),
            gaussian_radiance(flux, wanted, shapes),
            self.flux.scale(now, total(wanted)),
        )

    def _log(self, time: Tensor) -> Tensor:
        first, last = self.sharpness[:, :1], self.sharpness[:, 1:]
        return first + time[..., None] * (last - first)  # [S, Q, 2]
