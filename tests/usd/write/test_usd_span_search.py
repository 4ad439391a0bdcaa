# SPDX-License-Identifier: Apache-2.0
"""The search for samples, of errors that grow as the square of a step, and of any that grow."""

import itertools
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from asglight.usd.write.span_search import CLOSE, STEPS, Where, fewest_samples


@dataclass(frozen=True)
class Growing:
    """Spans whose error is (rate * step) ** power, the rate twice as large at the end.  S each."""

    rate: Tensor
    power: Tensor

    def at(self, index: Tensor) -> Self:
        return type(self)(self.rate[index], self.power[index])

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        return (self.rate * (1 + (before + after) / 2) * (after - before)) ** self.power


def spans(rate: list[float], power: list[float]) -> Growing:
    return Growing(torch.tensor(rate).double(), torch.tensor(power).double())


def samples(errors: Growing) -> list[list[int]]:
    """Return the samples of each span, in order."""
    count = len(errors.rate)
    where = Where(torch.zeros(count, dtype=torch.long), torch.arange(count))
    found = fewest_samples(where, errors)
    pairs = sorted(zip(found.lobe.tolist(), found.step.tolist(), strict=True))
    return [[step for lobe, step in pairs if lobe == span] for span in range(count)]


RATES = [0.3, 0.8, 2.0, 7.3, 31.0, 90.0, 1000.0]


def test_each_step_is_about_the_longest_that_may_be() -> None:
    for power in (1.0, 2.0, 3.5):
        for rate, inner in zip(RATES, samples(spans(RATES, [power] * len(RATES))), strict=True):
            ends = [0, *inner, STEPS]
            one = spans([rate], [power])
            for first, last in itertools.pairwise(ends):
                at = [torch.tensor([step / STEPS]).double() for step in (first, last, last + 1)]
                error, longer = (float(one.error(at[0], end)) for end in at[1:])
                assert error <= 1 or last == first + 1
                assert error > CLOSE or longer > 1 or last == STEPS


def test_spans_searched_together_take_the_samples_of_each_by_itself() -> None:
    rates = [rate for rate in RATES for _ in range(2)]
    powers = [1.0, 2.0] * len(RATES)
    alone = [samples(spans([a], [b]))[0] for a, b in zip(rates, powers, strict=True)]
    assert samples(spans(rates, powers)) == alone
    assert [len(inner) for inner in alone[-2:]] == [STEPS - 1] * 2  # a step of one at the least
    assert alone[0] == []


def test_no_span_takes_none() -> None:
    assert samples(spans([], [])) == []
