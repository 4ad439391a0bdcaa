# SPDX-License-Identifier: Apache-2.0
"""Constants of a fit, which come to a device once."""

import torch

from asglight.fitting.loss import constants


def test_constants_come_to_a_device_once() -> None:
    there = torch.empty(1, device="meta")
    one = constants.like(there, 1.0, 2.5)
    assert one.device == there.device
    assert one is constants.like(torch.empty(7, device="meta"), 1.0, 2.5)


def test_constants_are_of_the_kind_that_is_asked_for() -> None:
    for dtype in (torch.float32, torch.float64):
        made = constants.like(torch.empty(1, dtype=dtype), 1.0, 0.1)
        assert torch.equal(made, torch.tensor([1.0, 0.1], dtype=dtype))


def test_constants_made_in_a_fit_serve_who_needs_slopes() -> None:
    with torch.inference_mode():
        made = constants.like(torch.empty(1), 3.0)
    slope = torch.ones(1, requires_grad=True)
    (made * slope).sum().backward()
    assert slope.grad is not None
    assert slope.grad.tolist() == [3.0]
