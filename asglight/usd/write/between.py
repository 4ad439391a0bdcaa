# SPDX-License-Identifier: Apache-2.0
"""Samples between frames: as many as linear interpolation needs to show lobes in motion.

Between two frames a lobe's flux is linear and the logarithm of its sharpness too (lobes/motion.py),
but a program interpolates each attribute by itself. Where what comes out strays by more than
`span_errors` allows, samples are added, each as far from the one before as may be: no choice needs
fewer. Orientations need none; slerp is what the rule says.

A lobe that is black at one end needs none: its light goes up or down in one shape. Only where the
black sample has another shape than the light beside it, one sample stands close to it.

Symbols: F frames, N lobes, S spans, M samples between frames, T samples of a lobe.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.lobes import Lobes, asg, frames, motion
from asglight.lobes.data import combined
from asglight.usd.lights import cards
from asglight.usd.lights.emission import intensity_and_color, tinted
from asglight.usd.write.samples import DOT_MIN
from asglight.usd.write.span_errors import FAINT, Flux, LobeSpans, Spans, Together
from asglight.usd.write.span_lights import CardSpans, DiscSpans

STEPS = 256
"""Samples lie at multiples of this part of a span. Sharpness and flux a thousand times as large
take steps of one near the dark end."""

CLOSE = 0.9
"""Error of a step, over what is allowed, from which a longer one is not sought. To 85,400
samples in 1,000 frames of a tunnel it adds 400, and saves half of the search."""

SMALL = 5e-4
"""Changes x of log sharpness and y of log flux in a span with x (x + y) below this are within half
of what is allowed, whatever the light (tests/usd/write/test_usd_between.py)."""

LARGE = 0.5
"""Of log sharpness: spans that change by more are looked at in five places, others in three."""

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


class Shot:
    """Lobes over frames, and the samples that they and their lights need between."""

    def __init__(self, lobes: Lobes, numbers: Array) -> None:
        """Look for the spans in which attributes interpolated by themselves can go wrong.

        Args:
            lobes: Continuous in time, float64.  [F, N, .]
            numbers: Frame numbers, ascending.  [F]
        """
        self._lobes, self._numbers = lobes, numbers
        self._moments = asg.moments(lobes)
        self._black = motion.is_black(lobes)
        self._lit = ~self._black[1:] & ~self._black[:-1]
        flux = lobes.amplitude.sum(-1) * self._moments.zeroth
        self._faint = FAINT * flux.sum(-1)  # [F]
        shape = (lobes.sharpness[1:] / lobes.sharpness[:-1]).log().abs().amax(-1)
        bright = flux.maximum(self._faint[:, None])
        light = torch.where(self._lit, bright[1:] / bright[:-1], 1.0).log().abs()
        # how much an error counts, where a lobe is faint at both ends
        ratio = flux / bright
        weight = torch.maximum(ratio[1:], ratio[:-1])
        self._bent = self._lit & (weight * shape * (shape + light) > SMALL)
        self._reshaped = self._lit & (shape > SAME)
        self._large = shape > LARGE

    def of_lobes(self) -> list[Sampled]:
        """Return each lobe with the samples that its own attributes need.  N."""
        inserted = [
            _needed(one.where, LobeSpans.of(self._flux(one.where), one.lobes, one.moments.zeroth))
            for one in self._bent_spans
        ]
        # where rounding would decide which way is the shorter, the middle says it
        turns = frames.quaternion_from_axes(self._lobes.axes)
        is_half = (turns[1:] * turns[:-1]).sum(-1).abs() < DOT_MIN
        halves = _Where.of(self._lit & is_half)
        half = _Inserted(halves.place, halves.lobe, torch.full(halves.place.shape, STEPS // 2))
        return self._sampled(self._lobes, [half, *inserted], self._beside_black())

    def of_cards(self, kinds: Sequence[cards.Kind]) -> list[Sampled]:
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
                inserted.append(_needed(own.where, Together(of_kind)))
        return self._of_lights([*inserted, *self._slanting()])

    def _slanting(self) -> list["_Inserted"]:
        """Return the samples that keys need whose cards slant on: even steps, small enough."""
        if self._lobes.slant is None:
            return []
        change = (self._lobes.slant[1:] - self._lobes.slant[:-1]).abs().amax(-1) * self._lit
        place, lobe = torch.nonzero(change > SLANT_STEP, as_tuple=True)
        count = (change[place, lobe] / SLANT_STEP).ceil().long()
        which = torch.repeat_interleave(torch.arange(len(place)), count - 1)
        first = torch.cumsum(count - 1, 0) - (count - 1)
        number = torch.arange(len(which)) - first[which] + 1
        return [_Inserted(place[which], lobe[which], STEPS * number // count[which])]

    def of_distant(self, threefold: Sequence[bool]) -> list[Sampled]:
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
                inserted.append(_needed(one.where, discs))
        return self._of_lights(inserted)

    def _flux(self, spans: "_Where") -> Flux:
        first, last = (
            spans.pick(self._lobes.amplitude, step)
            * spans.pick(self._moments.zeroth, step)[..., None]
            for step in (0, 1)
        )
        faint = torch.stack([self._faint[spans.place], self._faint[spans.place + 1]], -1)
        return Flux(first, last, faint)

    @cached_property
    def _bent_spans(self) -> list["_Steps"]:
        return list(self._spans(self._bent))

    def _spans(self, marks: Tensor) -> Iterator["_Steps"]:
        """Yield marked spans by size, with lobes and moments at even steps."""
        for is_large, count in ((False, 3), (True, 5)):
            spans = _Where.of(marks & (self._large == is_large))
            if not len(spans.place):
                continue
            first, last = (self._lobes[spans.place + step, spans.lobe] for step in (0, 1))
            steps = [
                motion.between(first, last, torch.tensor(step / (count - 1), dtype=torch.float64))
                for step in range(count)
            ]
            lobes = replace(
                first,
                axes=torch.stack([one.axes for one in steps], 1),
                sharpness=torch.stack([one.sharpness for one in steps], 1),
                amplitude=torch.stack([one.amplitude for one in steps], 1),
                slant=None,
            )
            inner = asg.moments(lobes[:, 1:-1])
            moments = asg.Moments(
                *(
                    torch.cat(
                        [spans.pick(whole, 0)[:, None], mid, spans.pick(whole, 1)[:, None]], 1
                    )
                    for whole, mid in zip(self._moments, inner, strict=True)
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

    def _of_lights(self, inserted: Sequence["_Inserted"]) -> list[Sampled]:
        """Return lobes in the shapes that their lights have: black ones, those of a lit frame."""
        lobes = motion.resting(self._lobes)
        intensity, own_color = intensity_and_color(lobes.amplitude)
        color = tinted(intensity, own_color)
        appears = self._black[:-1] & ~self._black[1:]
        sharpness = (lobes.sharpness[1:] / lobes.sharpness[:-1]).log().abs() > SAME
        differ = sharpness.any(-1) | ((color[1:] - color[:-1]).abs() > SAME).any(-1)
        return self._sampled(lobes, inserted, torch.where(appears & differ, -1, 0))

    def _sampled(
        self, lobes: Lobes, inserted: Sequence["_Inserted"], beside: Tensor
    ) -> list[Sampled]:
        """Return lobes with samples between.

        Args:
            lobes: At the frames.  [F, N, .]
            inserted: Samples between.
            beside: Which spans have a sample close to an end: -1 the first, 1 the last.  [F - 1, N]
        """
        place, lobe, part = _in_order(inserted, beside)
        span, which = torch.from_numpy(place), torch.from_numpy(lobe)
        moved = motion.between(
            self._lobes[span, which], self._lobes[span + 1, which], torch.from_numpy(part)
        )
        times = self._numbers[place] + part * (self._numbers[place + 1] - self._numbers[place])
        bounds = np.searchsorted(lobe, np.arange(lobes.count + 1))
        found = []
        for index in range(lobes.count):
            extra = slice(int(bounds[index]), int(bounds[index + 1]))
            every = np.concatenate([self._numbers, times[extra]])
            order = torch.from_numpy(np.argsort(every, kind="stable"))

            def merged(
                own: Tensor,
                more: Tensor,
                index: int = index,
                extra: slice = extra,
                order: Tensor = order,
            ) -> Tensor:
                """Return the frames of a lobe and its samples between, in order."""
                return torch.cat([own[:, index], more[extra]])[order][:, None]

            joined = combined([lobes, moved], lambda pair, merged=merged: merged(pair[0], pair[1]))
            found.append(Sampled(np.sort(every), joined))
        return found


@dataclass(frozen=True)
class _Where:
    """Spans of a shot.

    Attributes:
        place: The frame before each.  [S]
        lobe: [S]
    """

    place: Tensor
    lobe: Tensor

    @classmethod
    def of(cls, marks: Tensor) -> "_Where":
        """Find marked spans.  [F - 1, N]."""
        place, lobe = torch.nonzero(marks, as_tuple=True)
        return cls(place, lobe)

    def at(self, index: Tensor) -> "_Where":
        """Pick spans."""
        return _Where(self.place[index], self.lobe[index])

    def pick(self, values: Tensor, step: int) -> Tensor:
        """Pick values of the frame before, or one step after it.  [F, N, ...] -> [S, ...]."""
        return values[self.place + step, self.lobe]


@dataclass(frozen=True)
class _Steps:
    """Lobes of spans at even steps from frame to frame.

    Attributes:
        where: Which spans.  S
        lobes: [S, K, .]
        moments: Theirs.  [S, K, .]
    """

    where: _Where
    lobes: Lobes
    moments: asg.Moments

    def at(self, index: Tensor) -> "_Steps":
        """Pick spans."""
        moments = asg.Moments(*(one[index] for one in self.moments))
        return _Steps(self.where.at(index), self.lobes[index], moments)


class _Inserted(NamedTuple):
    """Samples between frames.

    Attributes:
        place: The frame before each.  [M]
        lobe: [M]
        step: How many `STEPS` of its span from there.  [M]
    """

    place: Tensor
    lobe: Tensor
    step: Tensor


def _needed(spans: _Where, errors: Spans) -> _Inserted:
    """Return about the fewest samples with which errors of spans are within what is allowed.

    From each sample the next is about the farthest that may be (`CLOSE`): the longer a step, the
    larger its error, about as its square, which guides the search from the length of the step
    before. A step of one is taken whatever its error.
    """
    found = [_Inserted(spans.place[:0], spans.lobe[:0], spans.lobe[:0])]
    at = torch.zeros_like(spans.place)
    length = torch.full_like(at, STEPS)
    going = torch.arange(len(at))
    while len(going):
        good, bad = at[going] + 1, torch.full_like(going, STEPS + 1)
        step, open_ = (at + length)[going].clamp(max=STEPS), torch.arange(len(going))
        while len(open_):
            begin, tried = at[going[open_]], step[open_]
            error = errors.at(going[open_]).error(begin.double() / STEPS, tried.double() / STEPS)
            reaches = error <= 1
            good[open_] = torch.where(reaches, tried, good[open_])
            bad[open_] = torch.where(reaches, bad[open_], tried).maximum(good[open_] + 1)
            guess = begin + (tried - begin) * error.clamp(min=1e-6).rsqrt()
            step[open_] = guess.floor().long().maximum(good[open_] + 1).minimum(bad[open_] - 1)
            open_ = open_[((bad - good)[open_] > 1) & ~(reaches & (error > CLOSE))]
        length[going] = good - at[going]
        at[going] = good
        going = going[good < STEPS]
        found.append(_Inserted(spans.place[going], spans.lobe[going], at[going]))
    return _Inserted(*map(torch.cat, zip(*found, strict=True)))


def _in_order(
    inserted: Sequence[_Inserted], beside: Tensor
) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
    """Return all samples between frames, by lobe and time.

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
    lobe, place, part = np.unique(np.stack([lobe, place, part]), axis=1)
    return place.astype(int), lobe.astype(int), part
