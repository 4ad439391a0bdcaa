# SPDX-License-Identifier: Apache-2.0
"""The search for samples, of errors that grow as the square of a step, and of any that grow."""

import itertools
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from asglight.usd.write.span_search import STEPS, Where, fewest_samples


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
POWERS = [1.0, 2.0, 3.5]


def is_allowed(errors: Growing, first: int, last: int) -> bool:
    ends = [torch.tensor([step / STEPS]).double() for step in (first, last)]
    return last == first + 1 or float(errors.error(*ends)) <= 1


def fewest(errors: Growing) -> int:
    """Return how many samples one span needs: from each, the next is the farthest that may be."""
    at, count = 0, 0
    while not is_allowed(errors, at, STEPS):
        at = max(last for last in range(at + 1, STEPS) if is_allowed(errors, at, last))
        count += 1
    return count


def test_every_step_is_allowed() -> None:
    for power in POWERS:
        for rate, inner in zip(RATES, samples(spans(RATES, [power] * len(RATES))), strict=True):
            ends = itertools.pairwise([0, *inner, STEPS])
            assert all(is_allowed(spans([rate], [power]), *step) for step in ends)


def test_samples_are_about_the_fewest() -> None:
    for power in (1.0, 2.0):  # of errors that grow faster it takes more
        for rate, inner in zip(RATES, samples(spans(RATES, [power] * len(RATES))), strict=True):
            needed = fewest(spans([rate], [power]))
            assert needed <= len(inner) <= needed + 1 + needed // 6


def test_spans_searched_together_take_the_samples_of_each_by_itself() -> None:
    rates = [rate for rate in RATES for _ in range(2)]
    powers = [1.0, 2.0] * len(RATES)
    alone = [samples(spans([a], [b]))[0] for a, b in zip(rates, powers, strict=True)]
    for together, one in zip(samples(spans(rates, powers)), alone, strict=True):
        # the loads of all are summed up together: rounding may decide
        assert len(together) == len(one)
        assert all(abs(a - b) <= 1 for a, b in zip(together, one, strict=True))
    assert [len(inner) for inner in alone[-2:]] == [STEPS - 1] * 2  # a step of one at the least
    assert alone[0] == []


def test_an_error_that_is_no_number_takes_steps_of_one_and_spoils_no_other_span() -> None:
    found = samples(spans([7.3, torch.nan, 31.0], [2.0] * 3))
    assert found[0] == samples(spans([7.3], [2.0]))[0]
    assert found[1] == list(range(1, STEPS))
    assert found[2] == samples(spans([31.0], [2.0]))[0]


def test_no_span_takes_none() -> None:
    assert samples(spans([], [])) == []
