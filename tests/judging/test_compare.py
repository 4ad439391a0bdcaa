# SPDX-License-Identifier: Apache-2.0
"""The comparison: every method within its budget, one way of judging, what the sheet says."""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest
import torch

from asglight.judging.compare import maps as compare
from asglight.judging.compare import methods, perceptual, spheres
from asglight.judging.compare import sheet as compare_sheet
from asglight.judging.compare.methods import METHODS, Task
from asglight.judging.metrics import map_errors
from asglight.shading.balls import coverage


def lamp_map() -> torch.Tensor:
    reference = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0))
    reference[4:6, 10:13] = 30.0
    return reference


def even_balls(maps: torch.Tensor, size: int) -> torch.Tensor:
    """Return balls that all show the mean of their map: a stand-in for seconds of work."""
    mean = maps.mean((1, 2))[:, None, None, None]
    return mean * coverage(size)[:, :, None].expand(3, size, size, 1)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_keeps_its_budget_and_gives_a_map(name: str) -> None:
    reference = lamp_map()
    ticks = itertools.count()
    steps = 3 if METHODS[name].steps else 0
    task = Task(reference, 29, steps, lambda: next(ticks) and None)
    found = methods.run(METHODS[name], task)
    assert 24 <= found.floats <= 29, "less than another lobe, or degree of harmonics, is left"
    radiance = found.texel_means(16, 32)
    assert radiance.shape == reference.shape
    assert bool(torch.isfinite(radiance).all())
    assert float(radiance.sum()) > 0
    assert next(ticks) == steps


def test_long_methods_take_a_part_of_their_steps_unless_all_are_asked_for() -> None:
    taken = {
        name: [
            methods.steps_of(METHODS[name], full=full, quick=quick)
            for full, quick in ((True, False), (False, False), (False, True))
        ]
        for name in METHODS
    }
    assert taken.pop("paper") == [24_000, 2_400, 240]
    assert taken.pop("physg") == [100_000, 2_000, 200]
    assert set(itertools.chain(*taken.values())) == {0}


def followed(labels: list[str], passed: list[int]) -> compare.Follow:
    def follow(items: Iterable, label: str, count: int) -> Iterator:
        labels.append(label)
        passed.append(0)
        place = len(passed) - 1
        for item in items:
            yield item
            passed[place] += 1
        assert passed[place] == count

    return follow


def test_results_are_those_of_each_methods_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spheres, "render", even_balls)
    monkeypatch.setattr(perceptual, "hdr_flip", lambda balls, reference: 0.25)
    labels: list[str] = []
    passed: list[int] = []
    reference = lamp_map()
    plan = compare.Plan(("sh", "median-cut"), floats=30, quick=True)
    found = compare.compare(reference, plan, followed(labels, passed))
    assert labels == ["fitting sh", "fitting median-cut", "rendering balls", "judging"]
    assert passed == [1, 1, 2, 2]
    assert [result.name for result in found.results] == ["sh", "median-cut"]
    for result in found.results:
        assert result.errors == map_errors(result.radiance, reference).values
        assert result.flip == 0.25
        assert set(result.spheres) == set(spheres.SPHERES)
    harmonics, lights = found.results
    assert (harmonics.floats, lights.floats) == (27, 30)
    # both keep the flux, so that the even stand-ins for balls, but for weights of rows, agree
    assert lights.errors["flux"] < 1e-6
    assert math.isfinite(lights.psnr)
    size = compare.QUICK_BALL_SIZE
    assert found.balls.shape == lights.balls.shape == (3, size, size, 3)


def test_the_first_method_does_not_pay_what_a_process_pays_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    once, clock, fit_frame = iter((100.0,)), [0.0], methods.fit_frame

    def paying(*args: Any, **kwargs: Any) -> Any:
        clock[0] += next(once, 1.0)
        return fit_frame(*args, **kwargs)

    monkeypatch.setattr(spheres, "render", even_balls)
    monkeypatch.setattr(perceptual, "hdr_flip", lambda balls, reference: None)
    monkeypatch.setattr(methods, "fit_frame", paying)
    monkeypatch.setattr(compare.time, "process_time", lambda: clock[0])
    plan = compare.Plan(("best", "fast"), floats=16, quick=True)
    found = compare.compare(lamp_map(), plan, followed([], []))
    assert [one.seconds for one in found.results] == [1.0, 1.0]


def result(**changes: object) -> compare.Result:
    base = compare.Result(
        name="paper",
        floats=120,
        seconds=1.0,
        steps=2_400,
        errors={name: 0.0123 for name in ("env", "flux", "irr", "irrMax", "r0.5", "r0.25")},
        psnr=31.26,
        flip=0.0412,
        spheres={name: spheres.SphereErrors(0.1, 0.05, 1.0) for name in spheres.SPHERES},
        radiance=torch.ones(8, 16, 3),
        balls=torch.ones(3, 16, 16, 3),
    )
    return replace(base, **changes)


def test_a_row_names_the_part_of_the_steps_that_was_taken() -> None:
    assert compare.row_title(result()) == "Clausen et al. 2024, 2,400 of 24,000 steps"
    assert compare.row_title(result(steps=24_000)) == "Clausen et al. 2024"
    assert compare.row_title(result(name="em", steps=0)) == "vMF EM (Banerjee et al. 2005)"


def test_a_caption_gives_the_errors_and_leaves_out_a_flip_that_is_not_there() -> None:
    text = compare_sheet.caption(result())
    assert text.split("   ") == [
        "120 floats", "env 1.23 %", "irr 1.23 %", "r0.5 1.23 %", "r0.25 1.23 %",
        "PSNR 31.3 dB", "FLIP 0.041",
    ]  # fmt: skip
    assert "FLIP" not in compare_sheet.caption(result(flip=None))
    assert compare_sheet.caption(result(floats=1_098_260)).startswith("1098k floats   ")


def test_the_sheet_has_room_for_every_method(tmp_path: Path) -> None:
    reference = torch.ones(8, 16, 3)
    comparison = compare.Comparison(reference, torch.ones(3, 16, 16, 3), (result(),) * 2)
    path = tmp_path / "sheet.png"
    compare_sheet.draw(path, comparison, "a map")
    height, width, _ = matplotlib.image.imread(path).shape
    assert height == compare_sheet.TOP + 2 * compare_sheet.ROW, "three pictures, two beside another"
    assert width == 2 * compare_sheet.COLUMN + compare_sheet.LEFT
