# SPDX-License-Identifier: Apache-2.0
"""Samples between frames: as many as linear interpolation needs to show lobes in motion.

Between two frames a lobe's flux is linear and the logarithm of its sharpness too (lobes/motion.py),
but a program interpolates each attribute by itself. Where what comes out strays by more than
`span_errors` allows, samples are added, about the fewest that will do (`span_search`). Orientations
turn by slerp, so a lobe that also turns about its own direction needs samples on its way.

The light of a lobe that is black at one end needs none: it goes up or down in one shape. Only where
the black sample has another shape than the light beside it, one sample stands close to it.

Symbols: F frames, N lobes, S spans, M samples between frames, T samples of a lobe.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import starmap

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.lobes import Lobes, asg, frames, motion
from asglight.lobes.data import combined
from asglight.usd.lights import cards
from asglight.usd.lights.emission import intensity_and_color, tinted
from asglight.usd.write.samples import DOT_MIN
from asglight.usd.write.span_errors import (
    FAINT,
    MARGIN,
    RADIANCE,
    TURN_DEG,
    Flux,
    LobeSpans,
    Together,
)
from asglight.usd.write.span_lights import CardSpans, DiscSpans
from asglight.usd.write.span_search import STEPS, Inserted, Where, even_steps, fewest_samples

SMALL = 5e-4
"""Changes x of log sharpness and y of log flux in a span with x (x + y) below this are within half
of what is allowed, whatever the light (tests/usd/write/test_usd_between.py)."""

TINTED = 1e-3
"""Changes x of a colour and y of log intensity in a span with x y below this are within half of
what is allowed of flux, whatever the shape: intensity and colour, each interpolated by itself, are
off by 1.1 x y of the flux at most."""

CHANGES, PLACES = (0.5, 2.0), (3, 5, 41)
"""Spans whose log sharpness changes by no more than so much are looked at in so many places, all
others in the last number. A change of 23, as much as there can be, is then cut into ten pieces, and
polynomials through five places each (`span_errors.Curve`) are off by less than 1 % of a mean
square. One through five places of a change of 7 is off by 20 %: it bends in another place."""

SLANT_STEP = 0.12
"""Of each number of a slant, between samples: size, place and light, each interpolated by itself,
then stray by the square of half of it, 4e-3."""

BESIDE_BLACK = 2.0**-10
"""Of a span, from a black sample to the one that has the shape of the light beside it."""

SAME = 1e-6
"""Of axes and colours, and relative of sharpness: float32 rounding."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sampled:
    """A lobe at its frames and between them.

    Attributes:
        times: In frame numbers, ascending.  [T]
        lobes: [T, 1, .]
    """

    times: Array
    lobes: Lobes


@dataclass(frozen=True)
class SampledLobe:
    """What a lobe is at its frames and between them.

    Attributes:
        shape: With the samples that its sharpness and amplitude need.
        turns: With those that its orientation needs.
    """

    shape: Sampled
    turns: Sampled


@dataclass(frozen=True)
class SampledLight(Sampled):
    """A lobe in the shapes of its light.

    Attributes:
        moments: Those of the lobes.  [T, 1, .]
    """

    moments: asg.Moments


class Shot:
    """Lobes over frames, and the samples that they and their lights need between."""

    def __init__(self, lobes: Lobes, numbers: Array) -> None:
        """Look for the spans in which attributes interpolated by themselves can go wrong.

        Args:
            lobes: Continuous in time, float64.  [F, N, .]
            numbers: Frame numbers, ascending.  [F]
        """
        self._lobes, self._numbers = lobes, numbers
        self._moments = motion.resting_moments(lobes)
        self._black = motion.is_black(lobes)
        self._lit = ~self._black[1:] & ~self._black[:-1]
        self._colour_flux = lobes.amplitude * self._moments.zeroth[..., None]
        flux = lobes.amplitude.sum(-1) * self._moments.zeroth
        self._faint = FAINT * flux.sum(-1)  # [F]
        shape = (lobes.sharpness[1:] / lobes.sharpness[:-1]).log().abs().amax(-1)
        bright = flux.maximum(self._faint[:, None])
        light = torch.where(self._lit, bright[1:] / bright[:-1], 1.0).log().abs()
        # how much an error counts, where a lobe is faint at both ends
        ratio = (flux / bright).nan_to_num(0.0)  # of a frame that is black
        self._weight = torch.maximum(ratio[1:], ratio[:-1])
        is_tinted = self._changes_of_colour() > TINTED
        self._bent = self._lit & ((self._weight * shape * (shape + light) > SMALL) | is_tinted)
        self._reshaped = self._lit & ((shape > SAME) | is_tinted)
        bounds = torch.tensor(CHANGES, dtype=shape.dtype)
        self._places = torch.tensor(PLACES)[torch.bucketize(shape, bounds)]

    def _changes_of_colour(self) -> Tensor:
        """Return changes of colour times those of log intensity.  [F - 1, N]."""
        peak, color = intensity_and_color(self._colour_flux)
        least = torch.minimum(peak[1:], peak[:-1]).maximum(self._faint[:-1, None])
        brightening = ((peak[1:] - peak[:-1]).abs() / least).log1p()
        return (color[1:] - color[:-1]).abs().amax(-1) * brightening

    def of_lobes(self) -> list[SampledLobe]:
        """Return each lobe with the samples that its own attributes need.  N."""
        inserted = [
            fewest_samples(one.where, LobeSpans.of(self._flux(one.where), one.lobes, one.moments))
            for one in self._bent_spans
        ]
        shapes = self._sampled(inserted, self._beside_black())
        turns = self._sampled([self._turning()], torch.zeros_like(self._lit, dtype=torch.long))
        return list(map(SampledLobe, shapes, turns))

    def of_cards(self, kinds: Sequence[cards.Kind]) -> list[SampledLight]:
        """Return each lobe, in the shapes of its light, with the samples that its cards need.

        Args:
            kinds: What each lobe is in them.  N
        """
        inserted = []
        for kind, levels in cards.LEVELS.items():
            mine = torch.tensor([one is kind for one in kinds], dtype=torch.bool)
            for found in self._bent_spans if levels else ():
                own = found.at(mine[found.where.lobe])
                if not len(own.where.place):
                    continue
                squares, flux = cards.mean_squares(own.moments), self._flux(own.where)
                is_textured = kind is cards.Kind.TEXTURED
                of_kind = [
                    CardSpans.of(flux.part(share), squares, pieces, is_textured=is_textured)
                    for share, pieces in levels
                ]
                inserted.append(fewest_samples(own.where, Together(of_kind)))
        return self._of_lights([*inserted, *self._slanting()])

    def _turning(self) -> Inserted:
        """Return the samples by which slerp keeps the direction of lobes: even steps, few enough.

        Half-way between two samples slerp leaves the great circle by

            sin delta = sin(a / 2) sin(b / 2) / (1 + cos(a / 2) cos(b / 2))

        where the direction turns by a and the frame by b about it: about a b / 8, so with k steps
        by a k^2-th of that. A Gaussian aside by delta differs in its radiance, integrated over all
        directions, by sqrt(2 / pi) delta / sigma of its flux.
        """
        axes = self._lobes.axes
        _, swing, twist = frames.swing_and_twist(axes[:-1], axes[1:])
        half_swing, half_twist = swing / 2, twist / 2
        cosine = half_swing.cos() * half_twist.cos()  # of half of the whole turn
        off = half_swing.sin() * half_twist.sin().abs() / (1 + cosine)
        narrow = (asg.per_variance(self._lobes.form) * self._lobes.sharpness.amax(-1)).rsqrt()
        sigma = torch.minimum(narrow[1:], narrow[:-1])
        of_radiance = math.sqrt(math.pi / 2) * RADIANCE * sigma / self._weight
        allowed = MARGIN * of_radiance.clamp(max=math.radians(TURN_DEG))
        count = (off / allowed).sqrt().ceil().clamp(min=1)
        # where rounding would decide which way is the shorter, the middle says it
        count = torch.where(cosine.abs() < DOT_MIN, count.clamp(min=2), count)
        is_dark = self._black[1:] & self._black[:-1]
        return even_steps(torch.where(is_dark, 1, count.long()))

    def _slanting(self) -> list[Inserted]:
        """Return the samples that keys need whose cards slant on: even steps, small enough."""
        if self._lobes.slant is None:
            return []
        change = (self._lobes.slant[1:] - self._lobes.slant[:-1]).abs().amax(-1) * self._lit
        return [even_steps((change / SLANT_STEP).ceil().clamp(min=1).long())]

    def of_distant(self, threefold: Sequence[bool]) -> list[SampledLight]:
        """Return each lobe, in the shapes of its light, with what its distant lights need.

        Args:
            threefold: Which lobes have three.  N
        """
        inserted = []
        three = torch.tensor(list(threefold), dtype=torch.bool)
        for is_three, needed in ((False, self._bent & ~three), (True, self._reshaped & three)):
            for one in self._spans(needed):
                unit = replace(one.lobes, amplitude=torch.ones_like(one.lobes.amplitude))
                facing = asg.facing_irradiance(unit, one.moments)[..., 0] / one.moments.zeroth
                squares = cards.mean_squares(one.moments)
                discs = DiscSpans.of(self._flux(one.where), facing, squares, is_three=is_three)
                inserted.append(fewest_samples(one.where, discs))
        return self._of_lights(inserted)

    def _flux(self, spans: Where) -> Flux:
        first, last = (spans.pick(self._colour_flux, step) for step in (0, 1))
        faint = torch.stack([self._faint[spans.place], self._faint[spans.place + 1]], -1)
        return Flux(first, last, faint)

    @cached_property
    def _bent_spans(self) -> list["_Steps"]:
        return list(self._spans(self._bent))

    def _spans(self, marks: Tensor) -> Iterator["_Steps"]:
        """Yield marked spans by size, with lobes and moments at even steps."""
        for count in PLACES:
            spans = Where.of(marks & (self._places == count))
            if not len(spans.place):
                continue
            first, last = (self._lobes[spans.place + step, spans.lobe] for step in (0, 1))
            inner_steps = torch.arange(1, count - 1, dtype=torch.float64) / (count - 1)
            flux = spans.pick(self._colour_flux, 0), spans.pick(self._colour_flux, 1)
            inner = [motion.between(first, last, step, flux) for step in inner_steps]
            steps = [first, *inner, last]
            lobes = replace(
                first,
                axes=torch.stack([one.axes for one in steps], 1),
                sharpness=torch.stack([one.sharpness for one in steps], 1),
                amplitude=torch.stack([one.amplitude for one in steps], 1),
                slant=None,
            )
            inner_moments = asg.moments(lobes[:, 1:-1])
            moments = asg.Moments(
                *(
                    torch.cat(
                        [spans.pick(whole, 0)[:, None], mid, spans.pick(whole, 1)[:, None]], 1
                    )
                    for whole, mid in zip(self._moments, inner_moments, strict=True)
                )
            )
            yield _Steps(spans, lobes, moments)

    def _beside_black(self) -> Tensor:
        """Mark spans whose black end has another sharpness than the light.

        Returns:
            -1 for the first end, 1 for the last.  [F - 1, N]
        """
        sharpness = (self._lobes.sharpness[1:] / self._lobes.sharpness[:-1]).log().abs() > SAME
        differ = sharpness.any(-1)
        first, last = self._black[:-1], self._black[1:]
        return torch.where(differ, (last & ~first).long() - (first & ~last).long(), 0)

    def _sampled(self, inserted: Sequence[Inserted], beside: Tensor) -> list[Sampled]:
        """Return lobes at frames and between, as `_between`."""
        moved, merging = self._between(inserted, beside)
        return [Sampled(one.times, one.lobes(self._lobes, moved)) for one in merging]

    def _of_lights(self, inserted: Sequence[Inserted]) -> list[SampledLight]:
        """Return lobes in the shapes that their lights have: black ones, those of a lit frame."""
        lobes = motion.resting(self._lobes)
        intensity, own_color = intensity_and_color(lobes.amplitude)
        color = tinted(intensity, own_color)
        appears = self._black[:-1] & ~self._black[1:]
        sharpness = (lobes.sharpness[1:] / lobes.sharpness[:-1]).log().abs() > SAME
        differ = sharpness.any(-1) | ((color[1:] - color[:-1]).abs() > SAME).any(-1)
        moved, merging = self._between(inserted, torch.where(appears & differ, -1, 0))
        pairs = list(zip(self._moments, asg.moments(moved), strict=True))
        return [
            SampledLight(one.times, one.lobes(lobes, moved), asg.Moments(*starmap(one.both, pairs)))
            for one in merging
        ]

    def _between(
        self, inserted: Sequence[Inserted], beside: Tensor
    ) -> tuple[Lobes, list["_Merging"]]:
        """Return the samples between frames, and how each lobe's come among its frames.

        Args:
            inserted: Samples between.
            beside: Which spans have a sample close to an end: -1 the first, 1 the last.  [F - 1, N]

        Returns:
            The lobes at the samples [M, .], and one of each lobe.
        """
        place, lobe, part = _in_order(inserted, beside)
        span, which = torch.from_numpy(place), torch.from_numpy(lobe)
        first, last = self._lobes[span, which], self._lobes[span + 1, which]
        flux = self._colour_flux[span, which], self._colour_flux[span + 1, which]
        moved = motion.between(first, last, torch.from_numpy(part), flux)
        times = self._numbers[place] + part * (self._numbers[place + 1] - self._numbers[place])
        bounds = np.searchsorted(lobe, np.arange(self._lobes.count + 1))
        merging = []
        for index in range(self._lobes.count):
            own = slice(int(bounds[index]), int(bounds[index + 1]))
            every = np.concatenate([self._numbers, times[own]])
            order = np.argsort(every, kind="stable")
            merging.append(_Merging(index, own, torch.from_numpy(order), every[order]))
        return moved, merging


@dataclass(frozen=True)
class _Merging:
    """How the samples of a lobe between frames come among its frames.

    Attributes:
        index: The lobe.
        own: Which of all samples between are its.
        order: Of the frames and then those, in time.  [T]
        times: In frame numbers, ascending.  [T]
    """

    index: int
    own: slice
    order: Tensor
    times: Array

    def both(self, at_frames: Tensor, between: Tensor) -> Tensor:
        """Return what is at frames and at all samples.  [F, N, ...], [M, ...] -> [T, 1, ...]."""
        return torch.cat([at_frames[:, self.index], between[self.own]])[self.order][:, None]

    def lobes(self, at_frames: Lobes, between: Lobes) -> Lobes:
        """Return the lobe.  [F, N, .], [M, .] -> [T, 1, .]."""
        return combined([at_frames, between], lambda pair: self.both(*pair))


@dataclass(frozen=True)
class _Steps:
    """Lobes of spans at even steps from frame to frame.

    Attributes:
        where: Which spans.  S
        lobes: [S, K, .]
        moments: Theirs.  [S, K, .]
    """

    where: Where
    lobes: Lobes
    moments: asg.Moments

    def at(self, index: Tensor) -> "_Steps":
        """Pick spans."""
        moments = asg.Moments(*(one[index] for one in self.moments))
        return _Steps(self.where.at(index), self.lobes[index], moments)


def _in_order(
    inserted: Sequence[Inserted], beside: Tensor
) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
    """Return all samples between frames, each once, by lobe and time.

    Args:
        inserted: Those that spans need.
        beside: Which have a sample close to an end.  [F - 1, N]

    Returns:
        The frame before each, its lobe, and how far it is to the next frame.  Three of [M]
    """
    by, close = torch.nonzero(beside, as_tuple=True)
    at = torch.where(beside[by, close] < 0, BESIDE_BLACK, 1 - BESIDE_BLACK)
    place = torch.cat([*(one.place for one in inserted), by]).numpy()
    lobe = torch.cat([*(one.lobe for one in inserted), close]).numpy()
    part = torch.cat([*(one.step / STEPS for one in inserted), at]).double().numpy()
    order = np.lexsort((part, place, lobe))
    place, lobe, part = place[order], lobe[order], part[order]
    is_new = np.ones(len(part), dtype=bool)
    is_new[1:] = (np.diff(lobe) != 0) | (np.diff(place) != 0) | (np.diff(part) != 0)
    return place[is_new], lobe[is_new], part[is_new]
