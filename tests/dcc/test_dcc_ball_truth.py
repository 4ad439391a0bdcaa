# SPDX-License-Identifier: Apache-2.0
"""What dcc/ball_truth.py holds Mitsuba against: directions, integrals and the verdict."""

from pathlib import Path

import numpy as np
import pytest
import torch

from asglight.lobes import Form, Lobes
from asglight.sphere import latlong
from dcc import ball_truth, scene, truth
from dcc.ball_truth import Agreement
from dcc.truth import IMAGE_ROWS


def test_texels_lie_as_mitsuba_reads_them() -> None:
    found = truth.mitsuba_directions().view(IMAGE_ROWS, 2 * IMAGE_ROWS, 3)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    torch.testing.assert_close(found[0], up.expand_as(found[0]), rtol=0, atol=1e-12)
    torch.testing.assert_close(found[-1], -up.expand_as(found[0]), rtol=0, atol=1e-12)
    # Columns are ours: the azimuth of our texels of the same column, whatever the row.
    ours = latlong.directions(2, 2 * IMAGE_ROWS, dtype=torch.float64)[0]
    azimuth = torch.atan2(found[300, :, 0], found[300, :, 2])
    torch.testing.assert_close(azimuth, torch.atan2(ours[:, 0], ours[:, 2]), rtol=0, atol=1e-12)


def test_integrals_are_a_lobe_s_own_in_closed_form() -> None:
    # Of a cosine lobe along +Z the matte ball shows pi times the mean of max(n.w, 0) / pi; at
    # n = +Z that is the integral of cos^2 over the hemisphere, 2 pi / 3, over pi.
    lobes = Lobes(
        torch.eye(3, dtype=torch.float64)[None],
        torch.full((1, 2), 1e-9, dtype=torch.float64),
        torch.tensor([[0.0, 5.0, 0.0]], dtype=torch.float64),
        Form.ASG,
    )
    found = ball_truth.integrals(lobes, 9, None)  # odd: the middle pixel is +Z
    normals = scene.normals(9, "front")
    middle = int(np.argmax(normals[:, 2]))
    assert normals[middle].tolist() == [0, 0, 1]
    assert found.shape == (2, len(normals), 1)
    assert found[0, middle, 0] == pytest.approx(5 * 2 / 3, rel=1e-3)  # of the brute force


def test_the_verdict_is_by_the_noise() -> None:
    def agreement(error: float, noise: float) -> Agreement:
        return Agreement((1.0, 1.0), "matte", error, 1.0, error, noise)

    assert agreement(0.009, 0.005).agrees
    assert not agreement(0.011, 0.005).agrees
    assert agreement(9e-4, 0).agrees  # what the brute force itself is off by
    assert not agreement(1.1e-3, 0).agrees
    text = ball_truth.table([agreement(0.011, 0.005)])
    assert text.splitlines()[-1] == "| 1 x 1 | matte | 1.10 | 0.50 | 1.0000 | 1.10 | DIFFERS |"


def test_without_a_renderer_one_line_says_how_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["--python", f"{tmp_path}/none", "-o", str(tmp_path)]
    assert ball_truth.main(line) == 2
    assert "Run `make setup-dcc` first." in capsys.readouterr().err
