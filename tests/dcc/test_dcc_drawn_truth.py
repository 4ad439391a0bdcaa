# SPDX-License-Identifier: Apache-2.0
"""What dcc/drawn_truth.py holds Mitsuba's balls against, and by how much noise it excuses."""

from pathlib import Path

import numpy as np
import pytest
import torch

from asglight.lobes import Form, Lobes
from asglight.shading.balls import ROUGHNESS, coverage
from dcc import drawn_truth
from dcc.drawn_truth import Drawn


def test_drawn_balls_face_the_view_that_they_are_named_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(drawn_truth, "ROUGHNESS", (1.0,))  # the sharp ones take a minute
    monkeypatch.setattr(drawn_truth, "MAP_ROWS", 64)
    towards = torch.tensor([[[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]])  # z to the front camera
    lobes = Lobes(towards, torch.full((1, 2), 4.0), torch.tensor([[1.0, 2.0, 4.0]]), Form.ASG)
    front, back = drawn_truth.drawn(lobes, 16)
    assert front.shape == (1, 16, 16, 3)
    assert front[-1].sum() > 5 * back[-1].sum()
    assert front[0, 8, 8] == pytest.approx(front[0, 8, 8, 0] * np.array([1, 2, 4]))
    assert (front[:, coverage(16).numpy() == 0] == 0).all()


def test_blocks_are_means_of_their_pixels() -> None:
    balls = np.random.default_rng(0).random((2, 8, 8, 3))
    found = drawn_truth.block_means(balls, 4)
    assert found.shape == (2, 2, 2, 3)
    assert found[1, 0, 1] == pytest.approx(balls[1, :4, 4:].mean((0, 1)))
    assert drawn_truth.block_means(balls, 1) == pytest.approx(balls)


def test_the_noise_is_the_error_that_it_makes() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.5, 2, (2, 100, 100))
    seeds = truth + 0.2 * rng.standard_normal((4, 2, 100, 100))
    error = np.abs(seeds.mean(0) - truth).sum() / truth.sum()
    # 20,000 pixels: both sums are known to 1 %
    assert drawn_truth.absolute_noise(seeds) == pytest.approx(error, rel=0.03)


def test_every_roughness_has_its_block_and_its_limit() -> None:
    assert set(drawn_truth.BLOCK) == set(drawn_truth.LIMITS) == set(ROUGHNESS)


def test_the_verdict_is_noise_and_what_is_stated() -> None:
    def ball(error: float, noise: float) -> Drawn:
        return Drawn((40.0, 10.0), 0.25, error, noise, 0.999, error)

    assert ball(0.029, 0.01).agrees
    assert not ball(0.031, 0.01).agrees
    text = drawn_truth.table([ball(0.031, 0.01)])
    assert text.splitlines()[-1] == "| 0.25 | 40 x 10 | 3.10 | 1.00 | 0.9990 | 3.10 | DIFFERS |"


def test_without_a_renderer_one_line_says_how_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["--python", f"{tmp_path}/none", "-o", str(tmp_path)]
    assert drawn_truth.main(line) == 2
    assert "Run `make setup-dcc` first." in capsys.readouterr().err
