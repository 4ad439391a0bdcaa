# SPDX-License-Identifier: Apache-2.0
"""Arithmetic of tables, and captions: `method`, `growth` and `figures` of benchmarks/."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bench_scripts import module
from lobe_cases import sky_and_sun
from PIL import Image

from asglight.cli.progress import Lines
from asglight.fitting.paper.losses import Loss
from asglight.images import write_exr
from asglight.judging.bench.plan import Effort, plan_of
from asglight.judging.metrics import METRIC_NAMES
from asglight.lobes import Form
from tests.support.old_files import old_files

method = module("shots.method")
docs_figures = module("results.figures")
growth = module("steps.growth")


def errors(value: float, **others: float) -> dict[str, float]:
    return dict.fromkeys(METRIC_NAMES, value) | others


def test_spread_is_from_least_to_largest_and_their_factor() -> None:
    found = {
        "one": {"fast": [errors(0.1), errors(0.2), errors(0.15)]},
        "two": {"fast": [errors(0.1), errors(0.3), errors(0.1)]},
        "three": {"fast": [errors(0.1), errors(0.1), errors(0.1, irr=0.5)]},
    }
    table = method.spread_table(found, "fast").splitlines()
    assert table[0] == "| fast | env | irr | r0.5 | r0.25 |"
    assert table[2].startswith("| one | 0.1000 to 0.2000 | 0.1000 to 0.2000 |")
    assert table[-2] == "| median factor | x 2.00 | x 3.00 | x 2.00 | x 2.00 |"
    assert table[-1] == "| largest factor | x 3.00 | x 5.00 | x 3.00 | x 3.00 |"


def test_losses_have_their_geometric_mean_and_their_wins() -> None:
    first = {loss.value: [errors(0.4)] for loss in Loss} | {"L1": [errors(0.1, flux=1.0)]}
    second = {loss.value: [errors(0.1)] for loss in Loss} | {"L2": [errors(1e-6)]}
    table = method.means_table({"first": first, "second": second}, "loss").splitlines()
    rows = {row.split(" | ")[0].strip("| "): row for row in table[2:]}
    assert rows["L1"].startswith("| L1 | 0.1000 (1) | 0.3162 (0) |")  # sqrt(1 x 0.1)
    # counted as 1e-4: sqrt(0.4 x 1e-4)
    assert rows["L2"].startswith(f"| L2 | {math.sqrt(4e-5):.4f} (1) |")
    assert rows["L1 + L_D"].startswith("| L1 + L_D | 0.2000 (0) | 0.2000 (1) |")


def test_a_map_is_turned_and_its_fit_turned_back(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    original = method.fit_frame

    def fit(reference: torch.Tensor, *arguments: Any) -> Any:
        seen.append(reference)
        return original(reference, *arguments)

    monkeypatch.setattr(method, "fit_frame", fit)
    small = {"REPEATS": 2, "LOBES": 2, "FLOATS": 12}
    for name, value in small.items():
        monkeypatch.setattr(method, name, value)
    reference = sky_and_sun(20.0, 16)
    found = method.judged(list(method.spread(reference, Lines(), "sky")), reference)
    assert {name: len(each) for name, each in found.items()} == {"fast": 2, "em": 2}
    assert torch.equal(seen[1], reference.roll(method.STEP % 32, dims=1))
    # Not turned back, a sun of half the light would be at another place: an env near 1 or above.
    assert found["fast"][1]["env"] == pytest.approx(found["fast"][0]["env"], abs=0.1)
    assert max(each["env"] for each in found["fast"]) < 0.5


def test_every_map_of_a_folder_is_in_the_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one", "two"):
        write_exr(tmp_path / f"{name}.exr", sky_and_sun(20.0, 16))
    monkeypatch.setattr(method, "FORMS", {(Form.SG, 2): "round", (Form.ASG, 1): "long"})
    for name, value in {"LOBES": 2, "STEPS": 3, "ROWS": 8}.items():
        monkeypatch.setattr(method, name, value)
    words = ["--maps", str(tmp_path), "--parts", "forms", "losses", "-o", str(tmp_path / "o.json")]
    linked = old_files(tmp_path, "o.json")
    assert method.main(words) == 0
    assert [kept.read_text() for kept in linked] == ["old"]
    out = capsys.readouterr().out
    assert "| round | " in out
    assert "| L2 of sRGB | " in out
    found = json.loads((tmp_path / "o.json").read_text())
    assert list(found["forms"]) == ["one", "two"]
    assert set(found["losses"]["one"]) == {loss.value for loss in Loss}


def test_a_folder_without_maps_is_refused_and_a_folder_for_the_numbers_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit):
        method.main(["--maps", str(tmp_path)])
    assert "has no .exr; expected latlong OpenEXR files" in capsys.readouterr().err
    write_exr(tmp_path / "sky.exr", sky_and_sun(20.0, 16))
    monkeypatch.setattr(method, "FORMS", {(Form.SG, 1): "round"})
    target = tmp_path / "new" / "o.json"
    assert method.main(["--maps", str(tmp_path), "--parts", "forms", "-o", str(target)]) == 0
    assert list(json.loads(target.read_text())["forms"]) == ["sky"]


def test_captions_become_a_page_with_its_pictures_beside_it() -> None:
    captions = ["## One\n\n![One](figure-lobes.png)\n\ntext\n", "## Two\n"]
    found = docs_figures.assembled(captions)
    assert found == "## One\n\n![One](images/figure-lobes.png)\n\ntext\n\n## Two\n"


def test_pictures_keep_their_looks_in_few_colours(tmp_path: Path) -> None:
    x = np.linspace(0, 1, 120)
    ramp = np.stack(np.broadcast_arrays(x[:, None], x[None], 0.4), -1)
    ramp[50:60, 50:60] = (1, 0, 0)  # a rare hue
    before = (255 * ramp).astype(np.uint8)
    Image.fromarray(before).save(tmp_path / "a.png")
    docs_figures.shrink(tmp_path / "a.png", tmp_path / "b.png")
    with Image.open(tmp_path / "b.png") as picture:
        assert picture.mode == "P"
        after = np.asarray(picture.convert("RGB")).astype(float)
    blocks = [image.reshape(12, 10, 12, 10, 3).mean((1, 3)) for image in (before, after)]
    # dither keeps means; what is left is what it carries over a block's edge
    assert np.abs(blocks[0] - blocks[1]).max() < 12


def test_growth_alone_is_measured_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few = replace(plan_of(Effort.QUICK, 2), widths=(32, 64, 128), frame_counts=(1, 2, 3))
    monkeypatch.setattr(growth, "plan_of", lambda effort: few)
    write_exr(tmp_path / "sky.exr", sky_and_sun(20.0, 32))
    target = tmp_path / "growth.json"
    linked = old_files(tmp_path, "growth.json")
    assert growth.main([str(tmp_path / "sky.exr"), "-o", str(target)]) == 0
    assert [kept.read_text() for kept in linked] == ["old"]
    found = json.loads(target.read_text())
    assert found["texels"]["methods"]["fast"]["sizes"] == [512, 2048, 8192]
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "| texels | 512 | 2,048 | 8,192 | exponent |"
    assert told[-4] == "| frames | 1 | 2 | 3 | exponent |"
    seconds = found["frames"]["methods"]["live, a next frame"]["cpu_seconds"]
    assert seconds == sorted(seconds)
    assert told[-2].startswith(f"| live, a next frame, CPU s | {seconds[0]:.2f} | ")


def test_growth_without_a_law_or_memory_has_dashes() -> None:
    measured = {"sizes": [10, 20], "cpu_seconds": [1.0, 1234.5], "peak_bytes": [None, None]}
    account = {"unit": "lobes", "methods": {"em": measured | {"law": None}}}
    assert growth.table(account).splitlines()[2:] == ["| em, CPU s | 1.00 | 1234.50 | – |"]
    # a peak that is not known of one size is not none
    account["methods"]["em"]["peak_bytes"] = [None, 3_000_000]
    assert growth.table(account).splitlines()[3] == "| em, peak MB | – | 3 | |"
