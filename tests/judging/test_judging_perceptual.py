# SPDX-License-Identifier: Apache-2.0
"""PSNR against a value by hand; HDR-FLIP through NVIDIA's package, and without it."""

import math
import sys

import pytest
import torch

from asglight.judging.compare import perceptual
from asglight.shading.balls import coverage


def even(value: float) -> torch.Tensor:
    return torch.full((3, 32, 32, 3), value)


def test_psnr_is_of_what_a_screen_shows() -> None:
    """The reference's 0.36 stays, sRGB 162; 0.18 is 118: 20 log10(255 / 44)."""
    assert perceptual.psnr(even(0.18), even(0.36)) == pytest.approx(20 * math.log10(255 / 44))


def test_psnr_does_not_depend_on_the_scale_of_the_scene() -> None:
    ball = even(1.0) * torch.rand(3, 32, 32, 3, generator=torch.Generator().manual_seed(0))
    once = perceptual.psnr(1.3 * ball, ball)
    # powers of two are exact, so the same 8-bit values come out
    assert perceptual.psnr(64 * 1.3 * ball, 64 * ball) == once


def test_equal_balls_have_an_infinite_psnr() -> None:
    assert perceptual.psnr(even(0.2), even(0.2)) == math.inf


def test_pixels_beside_the_balls_do_not_count_in_psnr() -> None:
    ball = even(0.36)
    ball[:, coverage(32) == 0] = 7.0
    assert perceptual.psnr(ball, even(0.36)) == math.inf


def test_hdr_flip_grows_with_the_error() -> None:
    pytest.importorskip("flip_evaluator", reason="needs the report extra")
    generator = torch.Generator().manual_seed(1)
    reference = torch.rand(3, 32, 32, 3, generator=generator) * coverage(32)[..., None]
    reference[0, 10, 10] = 500.0
    found = [perceptual.hdr_flip(reference * gain, reference) for gain in (1.0, 1.1, 1.5)]
    assert found[0] == 0
    assert 0 < found[1] < found[2] < 1
    dark = reference.clone()
    dark[0, 0, 0] = -1.0  # negative radiance counts as none
    assert perceptual.hdr_flip(dark, reference) == 0


def test_hdr_flip_is_left_out_where_it_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert perceptual.hdr_flip(even(0.2), even(0.1)) is None
