# SPDX-License-Identifier: Apache-2.0
"""What the bench measures, on maps of a few texels: that it is what it says."""

import dataclasses
import json
from typing import Any

import pytest
import torch
from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.judging.bench import run as bench
from asglight.judging.bench import scaling as bench_scaling
from asglight.judging.bench import still as bench_still
from asglight.judging.bench.plan import LOBE_COUNTS, Effort, Plan, plan_of
from asglight.judging.metrics import METRIC_NAMES, frame_errors, sequence_errors
from asglight.sphere import latlong

ROWS, LOBES = 8, 2

TINY = Plan(
    Effort.QUICK,
    LOBES,
    {"fast": (1, LOBES), "best": (LOBES,), "paper": (1, LOBES), "em": (1, LOBES)},
    paper_steps=32,
    peers=("sh",),
    checkpoints=3,
    races=2,
    crowd=3,
    repeats=1,
    frames=None,
    widths=(8, 16, 32),
    frame_counts=(2, 3, 5),
)


def follow(items: Any, label: str, count: int) -> Any:
    """Pass items on; work that is followed must have as many as it says."""
    passed = 0
    for item in items:
        passed += 1
        yield item
    assert passed == count, label


def lit_map(turned: int = 0, rows: int = ROWS) -> Tensor:
    """Return two soft lamps, which two lobes hold, so that no frame asks for more.  [H, W, 3]."""
    directions = latlong.directions(rows, 2 * rows)
    lamps = torch.tensor([[0.6, 0.0, 0.8], [0.0, 0.8, -0.6]])
    glow = torch.exp(8 * (directions @ lamps.mT - 1)) @ torch.tensor([3.0, 1.0])
    return torch.roll(glow[..., None] * torch.tensor([1.0, 0.9, 0.7]), turned, dims=1)


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    frames = [lit_map(turned) for turned in range(3)]
    given = bench.Input("sky", "sky.#.exr", (7, 8, 9), frames, lit_map(rows=2 * ROWS))
    return bench.measured(given, TINY, follow)


def of(record: dict[str, Any], method: str, lobes: int) -> dict[str, Any]:
    fits = record["fits"]
    return next(fit for fit in fits if (fit["method"], fit["lobes"]) == (method, lobes))


def test_a_record_survives_json(record: dict[str, Any]) -> None:
    whole = bench.document(TINY, [record], "asglight bench sky.#.exr")
    assert json.loads(json.dumps(whole, allow_nan=False)) == whole


@pytest.mark.parametrize("preset", [Preset.FAST, Preset.BEST])
def test_the_last_checkpoint_is_the_fit(record: dict[str, Any], preset: Preset) -> None:
    last = of(record, preset.value, LOBES)["points"][-1]
    fit = fit_frame(lit_map(), FitOptions(LOBES, preset), None)
    wanted = frame_errors(fit.lobes, lit_map()).values
    # the same fit, judged in a batch: float32 sums in another order
    assert {name: last[name] for name in METRIC_NAMES} == pytest.approx(wanted, rel=1e-3, abs=1e-6)
    # both are sums over the texels; of 128 texels a lobe's means are off by a part of its flux
    assert abs(last["energy"] - 1) == pytest.approx(last["flux"], abs=1e-6)


def test_the_paper_is_run_whole_for_each_number_of_steps(record: dict[str, Any]) -> None:
    points = of(record, "paper", LOBES)["points"]
    assert [point["steps"] for point in points] == [2, 8, 32]
    assert [point["steps"] for point in of(record, "paper", 1)["points"]] == [8]
    options = FitOptions(LOBES, Preset.PAPER, paper_steps=(8, 8))
    wanted = frame_errors(fit_frame(lit_map(), options, None).lobes, lit_map()).values
    assert points[1]["r0.5"] == pytest.approx(wanted["r0.5"], rel=1e-3)


def test_checkpoints_come_one_after_the_other(record: dict[str, Any]) -> None:
    for fit in record["fits"]:
        steps = [point["steps"] for point in fit["points"]]
        assert steps == sorted(steps)
    points = of(record, "fast", LOBES)["points"]
    assert len(points) == TINY.checkpoints + 1
    seconds = [point["cpu_seconds"] for point in points]
    assert seconds == sorted(seconds)
    assert seconds[0] > 0


def test_peers_keep_within_the_floats_of_the_lobes(record: dict[str, Any]) -> None:
    assert {fit["method"] for fit in record["fits"]} == {"fast", "best", "paper", "em", "sh"}
    for fit in record["fits"]:
        assert 0 < fit["floats"] <= 8 * fit["lobes"]
    assert {len(seconds) for seconds in record["races"].values()} == {TINY.races}


def test_scaling_has_every_size_and_its_exponent(record: dict[str, Any]) -> None:
    scaling = record["scaling"]
    assert scaling["texels"]["source_columns"] == 4 * ROWS
    assert scaling["texels"]["methods"]["em"]["sizes"] == [32, 128, 512]
    assert scaling["texels"]["methods"]["em"]["law"]["points"] == 3
    assert scaling["lobes"]["methods"]["fast"]["sizes"] == [1, LOBES]
    assert scaling["lobes"]["methods"]["fast"]["law"] is None
    live = scaling["frames"]["methods"][bench_scaling.LIVE]
    assert live["sizes"] == [2, 3, 5]
    assert live["cpu_seconds"] == sorted(live["cpu_seconds"])
    assert len(live["r0.25"]) == 3


def test_a_sequence_is_followed_by_every_preset(record: dict[str, Any]) -> None:
    methods = record["sequence"]["methods"]
    assert list(methods) == ["live", "fast", "best", "independent", "em", "paper"]
    assert record["sequence"]["paper_steps"] == [32, 8]
    for found in methods.values():
        assert len(found["cpu_seconds"]) == len(found["errors"]["irr"]) == 3
        assert found["next_cpu_seconds"] == pytest.approx(sum(found["cpu_seconds"][1:]) / 2)
    frames = [lit_map(turned) for turned in range(3)]
    previous, earlier, judged = None, None, []
    for index, frame in enumerate(frames):
        fit = fit_frame(frame, FitOptions(LOBES, Preset.LIVE, moving=True), previous, earlier)
        judged.append((index, frame_errors(fit.lobes, frame)))
        previous, earlier = fit.lobes, previous
    wanted = sequence_errors(judged).mean
    assert methods["live"]["mean"] == pytest.approx(wanted, rel=1e-3, abs=1e-6)


def test_a_still_has_no_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("runs", "races"):
        monkeypatch.setattr(bench_still, name, lambda *_: [])
    monkeypatch.setattr(bench_scaling, "measured", lambda *_: {})
    given = bench.Input("sky", "sky.exr", (1,), [lit_map()], lit_map())
    assert "sequence" not in bench.measured(given, TINY, follow)


def test_frames_go_there_and_back_and_turn_exactly() -> None:
    frames = [torch.full((4, 8, 3), float(level)) for level in (1, 2, 3)]
    levels = [float(bench_scaling.moved(frames, index).mean()) for index in range(6)]
    assert levels == [1, 2, 3, 2, 1, 2]
    still = [lit_map()]
    turned = bench_scaling.moved(still, 5)
    assert torch.equal(turned[:, 5:], still[0][:, :-5])
    assert torch.equal(bench_scaling.moved(still, 2 * ROWS), still[0])


@pytest.mark.parametrize("steps", [0, 1, 5, 200])
def test_steps_are_spread_from_the_first_to_the_last(steps: int) -> None:
    found = bench_still.spread_steps(steps, 6)
    assert len(found) <= min(steps, 6)
    assert found == sorted(set(found))
    assert steps == 0 or (found[0], found[-1]) == (1, steps)


def test_a_full_run_leaves_nothing_out() -> None:
    full = plan_of(Effort.FULL)
    assert set(full.counts.values()) == {LOBE_COUNTS}
    assert full.paper_steps == 24_000
    assert (full.widths[0], full.widths[-1]) == (64, 4096)
    assert (full.frame_counts[0], full.frame_counts[-1]) == (10, 10_000)
    assert full.frames is None


@pytest.mark.parametrize("effort", Effort)
def test_the_number_of_lobes_is_measured_whatever_it_is(effort: Effort) -> None:
    plan = plan_of(effort, lobes=11, paper_steps=100)
    assert all(11 in counts for counts in plan.counts.values())
    assert plan.floats == 88
    assert plan.paper_ladder(11) == (6, 25, 100)
    assert plan.paper_ladder(4) == (25,)
    assert dataclasses.replace(plan, paper_steps=1).paper_ladder(4) == (1,)
