# SPDX-License-Identifier: Apache-2.0
"""The gate: what it lets pass, what it stops, and what it refuses to compare."""

import copy
import json
from pathlib import Path
from typing import Any

import bench_records
import pytest
from places import ROOT

from asglight.errors import InputError
from asglight.judging.bench import gate as bench_gate
from asglight.judging.bench.plan import CROWDED, Effort, plan_of
from asglight.judging.metrics import METRIC_NAMES

PATH = Path("base.json")


@pytest.fixture
def document() -> dict[str, Any]:
    return bench_records.document(bench_records.still(), bench_records.sequence())


@pytest.fixture
def before(document: dict[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(bench_gate.baseline(document)))


def names(before: dict[str, Any], document: dict[str, Any]) -> list[str]:
    return [each.metric for each in bench_gate.compared(before, PATH, document)]


def test_the_same_run_passes(before: dict[str, Any], document: dict[str, Any]) -> None:
    assert names(before, document) == []


def test_one_error_may_grow_by_less_than_half(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    last = document["inputs"][0]["fits"][1]["points"][-1]
    last["irr"], last["r0.5"] = 1.49 * 0.02, 1.51 * 0.02
    (found,) = bench_gate.compared(before, PATH, document)
    assert (found.input, found.metric) == ("sky", "fast, 15 lobes, r0.5")
    assert (found.before, found.now) == pytest.approx((0.02, 0.0302))


def test_all_errors_of_a_method_may_grow_by_less_than_a_tenth(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    def grow(factor: float) -> None:
        for fit in document["inputs"][0]["fits"]:
            if fit["method"] == "fast":
                last = fit["points"][-1]
                fit["points"][-1] = last | {key: factor * last[key] for key in METRIC_NAMES}

    grow(1.09)
    assert names(before, document) == []
    grow(1.02)
    (found,) = bench_gate.compared(before, PATH, document)
    assert found.metric == "fast, errors over those before, mean"
    assert (found.before, found.now) == pytest.approx((1, 1.09 * 1.02))


def test_chance_that_goes_both_ways_passes(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    last = document["inputs"][0]["fits"][1]["points"][-1]
    last["irr"], last["r0.5"], last["env"] = 1.4 * 0.02, 1.4 * 0.02, 0.02 / 1.6
    assert names(before, document) == []


def test_errors_that_nobody_sees_may_grow_by_any_ratio(document: dict[str, Any]) -> None:
    last = document["inputs"][0]["fits"][1]["points"][-1]
    last["flux"] = 1e-8
    before = bench_gate.baseline(document)
    last["flux"] = 1e-4
    assert names(before, document) == []
    last["flux"] = 1.6e-4
    assert names(before, document) == ["fast, 15 lobes, flux"]


def test_what_gets_better_passes(before: dict[str, Any], document: dict[str, Any]) -> None:
    for fit in document["inputs"][0]["fits"]:
        fit["points"][-1]["irr"] = 0.0
    document["inputs"][0]["races"]["fast"] = [0.1]
    assert names(before, document) == []


def test_peers_are_not_held_to_anything(before: dict[str, Any], document: dict[str, Any]) -> None:
    for fit in document["inputs"][0]["fits"][3:]:
        fit["points"][-1]["irr"] = 9.0
    assert names(before, document) == []


def test_a_machine_ten_times_slower_passes(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    for record in document["inputs"]:
        record["races"] = {key: [10 * s for s in each] for key, each in record["races"].items()}
    for found in document["inputs"][1]["sequence"]["methods"].values():
        found["next_cpu_seconds"] *= 10
    assert names(before, document) == []


def test_a_preset_that_slows_down_beside_em_is_stopped(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    document["inputs"][0]["races"]["fast"] = [3.3, 3.4, 3.5]  # median 3.4 for 2.1: 1.6 times
    document["inputs"][1]["sequence"]["methods"]["live"]["next_cpu_seconds"] = 0.8
    assert names(before, document) == ["fast, time over em", "live, sequence, time over em"]


def test_a_preset_that_grows_faster_with_its_lobes_is_stopped(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    race = document["inputs"][0]["races"]
    race[CROWDED] = [1.4 * seconds for seconds in race[CROWDED]]
    assert names(before, document) == []
    race[CROWDED] = [1.1 * seconds for seconds in race[CROWDED]]
    assert names(before, document) == ["fast, time of a crowd over em"]


def test_flicker_and_errors_of_a_sequence_are_held(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    document["inputs"][1]["sequence"]["methods"]["best"]["mean"]["flicker"] = 0.016
    assert names(before, document) == ["best, sequence, flicker"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "dusk"}, r"base.json: has no input dusk; expected one of sky, shot. Leave"),
        ({"rows": 64}, r"base.json: sky had 16 rows, this run has 64; expected the same input"),
        ({"frames": [1, 2]}, r"base.json: sky had 1 frames, this run has 2"),
        ({"mean_radiance": 0.51}, r"sky had a mean radiance of 0.5, this run has 0.51"),
    ],
)
def test_another_input_is_not_compared(
    before: dict[str, Any], document: dict[str, Any], change: dict[str, Any], message: str
) -> None:
    record = document["inputs"][0] | change
    with pytest.raises(InputError, match=message):
        bench_gate.check_inputs(before, PATH, {record["name"]: bench_gate.described(record)})


def test_known_inputs_are_compared(before: dict[str, Any], document: dict[str, Any]) -> None:
    same = {each["name"]: bench_gate.described(each) for each in document["inputs"]}
    bench_gate.check_inputs(before, PATH, same)


def test_a_number_that_is_gone_is_named(before: dict[str, Any], document: dict[str, Any]) -> None:
    document["inputs"][0]["fits"] = []
    message = r"base.json: sky has fast, 2 lobes, env, .* and 10 more, this run has not"
    with pytest.raises(InputError, match=message):
        bench_gate.compared(before, PATH, document)


def test_more_than_the_baseline_has_is_measured_without_complaint(
    before: dict[str, Any], document: dict[str, Any]
) -> None:
    more = copy.deepcopy(document["inputs"][0]["fits"][0]) | {"lobes": 4}
    more["points"][-1]["irr"] = 9.0
    document["inputs"][0]["fits"].append(more)
    assert names(before, document) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is no JSON; expected a baseline that --baseline wrote"),
        ("[]", "is no baseline of this version"),
        ('{"asglight_bench": 1}', "is no baseline of this version"),
        ('{"asglight_bench_baseline": 2}', "is no baseline of this version"),
        ('{"asglight_bench_baseline": 1}', "is a baseline with a part missing or damaged; exp"),
        ('{"asglight_bench_baseline": 1, "inputs": []}', "is a baseline with a part missing"),
        (
            '{"asglight_bench_baseline": 1, "inputs": {"a": {}}}',
            "is a baseline with a part missing",
        ),
        ("\udcff", "is no JSON"),
        (None, "No such file or directory; expected a baseline. Write one with --baseline"),
    ],
)
def test_a_file_that_is_no_baseline_is_refused(
    tmp_path: Path, text: str | None, message: str
) -> None:
    path = tmp_path / "b.json"
    if text is not None:
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=message):
        bench_gate.read_baseline(path)


@pytest.mark.parametrize("numbers", [{}, {"fast, 2 lobes, env": float("inf")}])
def test_a_baseline_that_nothing_can_be_worse_than_is_refused(
    tmp_path: Path, before: dict[str, Any], numbers: dict[str, float]
) -> None:
    path = tmp_path / "b.json"
    before["inputs"]["sky"]["numbers"] = numbers
    path.write_text(json.dumps(before))
    with pytest.raises(InputError, match="is a baseline with a part missing or damaged"):
        bench_gate.read_baseline(path)


@pytest.mark.parametrize("key", ["rows", "columns", "frames", "mean_radiance", "numbers"])
def test_a_baseline_whose_input_lacks_a_part_is_refused(
    tmp_path: Path, before: dict[str, Any], key: str
) -> None:
    path = tmp_path / "b.json"
    path.write_text(json.dumps(before))
    assert bench_gate.read_baseline(path) == before
    before["inputs"]["sky"][key] = None
    path.write_text(json.dumps(before))
    with pytest.raises(InputError, match="is a baseline with a part missing or damaged"):
        bench_gate.read_baseline(path)


def test_a_run_that_asks_for_something_else_is_refused(before: dict[str, Any]) -> None:
    bench_gate.check_asked(before, PATH, {"effort": "quick", "lobes": 15, "paper_steps": 240})
    with pytest.raises(InputError, match="was written with lobes 15, this run has 8; expected"):
        bench_gate.check_asked(before, PATH, {"effort": "quick", "lobes": 8})


def test_the_baseline_of_the_repository_is_for_a_quick_run() -> None:
    path = ROOT / "benchmarks" / "bench-baseline.json"
    if not path.parent.is_dir():
        pytest.skip("benchmarks/ is in the repository alone")
    before = bench_gate.read_baseline(path)
    plan = plan_of(Effort.QUICK)
    asked = {"effort": plan.effort.value, "lobes": plan.lobes, "paper_steps": plan.paper_steps}
    bench_gate.check_asked(before, path, asked)
    assert set(before["inputs"]) == {"lobby", "tunnel"}
    for known in before["inputs"].values():
        for count in plan.counts["fast"]:
            name = "1 lobe" if count == 1 else f"{count} lobes"
            assert known["numbers"][f"fast, {name}, irr"] > 0
    assert "live, sequence, flicker" in before["inputs"]["tunnel"]["numbers"]
