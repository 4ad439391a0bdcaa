# SPDX-License-Identifier: Apache-2.0
"""The search for the fewest samples in spans, whatever the light that strays (span_errors.py).

Symbols: F frames, N lobes, S spans, M samples between frames.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.usd.write.span_errors import Spans

STEPS = 256
"""Samples lie at multiples of this part of a span. Sharpness and flux a thousand times as large
take steps of one near the dark end."""

MORE = 16
"""One step more, of so many, where as many as a span holds do not do though they are spread."""

LOADS = 1e-3, STEPS
"""Least and largest number of steps without error that a step is taken to hold: one whose error is
nothing does not vanish, and one whose error is no number is cut into steps of one."""


@dataclass(frozen=True)
class Where:
    """Spans of a shot.

    Attributes:
        place: The frame before each.  [S]
        lobe: [S]
    """

    place: Tensor
    lobe: Tensor

    @classmethod
    def of(cls, marks: Tensor) -> "Where":
        """Find marked spans.  [F - 1, N]."""
        place, lobe = torch.nonzero(marks, as_tuple=True)
        return cls(place, lobe)

    def at(self, index: Tensor) -> "Where":
        """Pick spans."""
        return Where(self.place[index], self.lobe[index])

    def pick(self, values: Tensor, step: int) -> Tensor:
        """Pick values of the frame before, or one step after it.  [F, N, ...] -> [S, ...]."""
        return values[self.place + step, self.lobe]


class Inserted(NamedTuple):
    """Samples between frames.

    Attributes:
        place: The frame before each.  [M]
        lobe: [M]
        step: How many `STEPS` of its span from there.  [M]
    """

    place: Tensor
    lobe: Tensor
    step: Tensor


class _Steps(NamedTuple):
    """Steps from sample to sample, those of a span in order.

    Attributes:
        span: That each is part of, ascending.  [K]
        begin: In `STEPS` of the span.  [K]
        end: [K]
    """

    span: Tensor
    begin: Tensor
    end: Tensor

    def at(self, index: Tensor) -> "_Steps":
        """Pick steps."""
        return _Steps(*(one[index] for one in self))


def even_steps(count: Tensor) -> Inserted:
    """Return the samples that cut spans into so many even steps.  [F - 1, N]."""
    place, lobe = torch.nonzero(count > 1, as_tuple=True)
    count = count[place, lobe].clamp(max=STEPS)
    which = torch.repeat_interleave(torch.arange(len(place)), count - 1)
    first = torch.cumsum(count - 1, 0) - (count - 1)
    number = torch.arange(len(which)) - first[which] + 1
    return Inserted(place[which], lobe[which], STEPS * number // count[which])


def fewest_samples(spans: Where, errors: Spans) -> Inserted:
    """Return about the fewest samples with which errors of spans are within what is allowed.

    Fewest are steps of one error [de Boor 1973]. It goes about as the square of the length, so a
    step of error e holds sqrt(e) steps of the error that is allowed: its load. Each round looks at
    all steps of the spans that are not within it yet, and cuts each span into as many steps of one
    load as it holds. Where that is no more than before, one round spreads them better, and the next
    takes more. A step of one is taken whatever its error.
    """
    count = len(spans.place)
    steps = _Steps(torch.arange(count), torch.zeros(count).long(), torch.full((count,), STEPS))
    number = torch.ones(count).long()  # of steps that each span was last cut into
    is_spread = torch.zeros(count).bool()
    found = [steps.at(steps.span[:0])]
    while len(steps.span):
        begin, end = steps.begin.double() / STEPS, steps.end.double() / STEPS
        error = errors.at(steps.span).error(begin, end)
        fails = ~(error <= 1) & (steps.end - steps.begin > 1)
        is_open = torch.zeros(count).bool().index_fill(0, steps.span[fails], True)
        going = is_open[steps.span]
        found.append(steps.at(~going & (steps.begin > 0)))
        steps, load = steps.at(going), error[going].sqrt().nan_to_num(LOADS[1]).clamp(*LOADS)
        whole = torch.zeros(count).double().index_add(0, steps.span, load)
        is_spread = ~is_spread & (whole <= number)
        more = torch.maximum(whole.ceil().long(), number + 1 + number // MORE)
        number = torch.where(is_spread, number, more)
        steps = _evened(steps, load, torch.nonzero(is_open).flatten(), whole, number)
    taken = _Steps(*map(torch.cat, zip(*found, strict=True)))
    return Inserted(spans.place[taken.span], spans.lobe[taken.span], taken.begin)


def _evened(steps: _Steps, load: Tensor, spans: Tensor, whole: Tensor, number: Tensor) -> _Steps:
    """Return steps of about one load, along which that of the given ones is spread evenly.

    Args:
        steps: All steps of some spans.  [K]
        load: Of each.  [K]
        spans: Which spans these are, ascending.
        whole: The load of every span.  [S]
        number: How many steps every span shall have; those shorter than one become one.  [S]
    """
    own, upto = number[spans], load.cumsum(0)
    span = spans.repeat_interleave(own)
    place = torch.arange(len(span)) - (own.cumsum(0) - own).repeat_interleave(own)
    before = (whole[spans].cumsum(0) - whole[spans]).repeat_interleave(own)
    target = before + place / number[span] * whole[span]
    among = torch.searchsorted(upto, target, right=True)
    part = 1 - (upto[among] - target) / load[among]
    begin, end = steps.begin[among], steps.end[among]
    at = (begin + part * (end - begin)).round().long().clamp(max=STEPS - 1)
    found = torch.unique(span * STEPS + torch.where(place == 0, 0, at))  # ascending
    span, begin = found // STEPS, found % STEPS
    is_last = torch.ones(len(found)).bool()
    is_last[:-1] = span[1:] != span[:-1]
    return _Steps(span, begin, torch.where(is_last, STEPS, begin.roll(-1)))
