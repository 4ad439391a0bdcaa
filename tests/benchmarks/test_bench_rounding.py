# SPDX-License-Identifier: Apache-2.0
"""Rounding, the ridge and what a clean scene does not need: three scripts of benchmarks/.

The bounds of float32 against float64 hold on the built-in environment;
docs/results/parts-of-a-fit.md has the figures of real maps.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bench_scripts import float32_here, module
from elsewhere import DEVICE, watched
from lobe_cases import KNOWN, sky_and_sun

from asglight.errors import InputError
from asglight.images import write_exr
from asglight.lobes import Form, texels
from asglight.sky import SkyConfig, radiance

rounding = module("steps.rounding")
worker = module("steps.rounding_worker")
ridge = module("steps.ridge")
clean_scene = module("shots.clean_scene")

ROWS, LOBES = {"1001": 16, "1030": 8}, {"1001": 3, "1030": 2}
"""Of the frames of the built-in environment that are fitted in float32 and in float64."""


def exponent_rounding(rows: int) -> float:
    """Return what float32 leaves open of the exponent of a lobe as narrow as a texel.

    The mean over a texel of side h is a lobe of sharpness 1 / (2 (sigma^2 + h^2 / 12)), at most
    6 / h^2, and the exponent is a sum of products of that size, each rounded by 2^-24 of itself.
    """
    return 6 * (rows / math.pi) ** 2 * 2**-24


@pytest.fixture(scope="module")
def comparison() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return float32 against float64 by map, and what processes of float64 found: fits, looks."""
    apart: list[dict[str, Any]] = []
    worked = rounding.worked

    def kept(given: dict[str, Any], arithmetic: str, device: str) -> dict[str, Any]:
        found = worked(given, arithmetic, device)
        if arithmetic == "float64":
            apart.append(found)
        return found

    given = {
        name: rounding.of_map(radiance(SkyConfig(), int(name), rows), LOBES[name])
        for name, rows in ROWS.items()
    }
    with pytest.MonkeyPatch.context() as patch:
        float32_here(patch)
        patch.setattr(rounding, "worked", kept)
        return rounding.compared(given, "float64", "cpu"), apart


def test_float32_is_near_to_float64_on_the_built_in_environment(
    comparison: tuple[dict[str, Any], list[dict[str, Any]]],
) -> None:
    found, _ = comparison
    assert found.keys() == ROWS.keys()
    for frame, figures in found.items():
        most = exponent_rounding(ROWS[frame])
        assert 0 < figures["shown"] < most
        # a slope is what is left of derivatives that cancel but for a twentieth or so
        assert 0 < figures["slope"] < 20 * most
        assert 0 < figures["matrix"] < 20 * most
        # J is a mean of norms of what is shown and wrong, which is a tenth of what is shown
        assert 0 < figures["J"] < 10 * most
        # the judge's sums of 10^4 texels in float32
        assert figures["irr"] < 1e-3
        assert figures["r0.5"] < 1e-3
        # rounding may decide which split is kept, for an end as good: a tenth on real maps
        for name in rounding.JUDGED:
            ends = figures[f"fitted {name}"] / figures[f"fitted {name} float32"]
            assert 0.7 < ends < 1.4, name


def test_the_process_of_float64_computes_in_float64(
    comparison: tuple[dict[str, Any], list[dict[str, Any]]],
) -> None:
    _, (fits, looks) = comparison
    for name in ("axes", "sharpness", "amplitude"):
        found = fits["1001"][name]
        assert not np.array_equal(found, found.astype(np.float32)), name
    for name in ("slope", "matrix", "shown"):
        found = looks["1001"][name]
        assert not np.array_equal(found, found.astype(np.float32)), name
    slope = looks["1001"]["slope"]
    assert slope.shape == (8 * LOBES["1001"],)
    assert np.isfinite(slope).all()


def test_differences_are_relative_to_the_exact_in_units_of_its_curvature() -> None:
    exact = {
        "cells": np.array([3, 4]),
        "J": np.array(2.0),
        "slope": np.array([2.0, 300.0]),
        "matrix": np.diag([4.0, 1e4]),
        "shown": np.ones((3, 2)),
        "irr": np.array(0.01),
        "r0.5": np.array(0.02),
    }
    found = exact | {
        "J": np.array(2.5),
        "slope": np.array([2.0 + 0.02, 300.0]),
        "matrix": np.diag([4.0, 1.1e4]),
        "shown": 1.5 * np.ones((3, 2)),
        "irr": np.array(0.011),
    }
    apart = rounding.differences(found, exact)
    assert apart["J"] == pytest.approx(0.25)
    assert apart["slope"] == pytest.approx(0.01 / math.hypot(1, 3))  # (1, 3) in those units
    assert apart["matrix"] == pytest.approx(0.1 / math.sqrt(2))
    assert apart["shown"] == pytest.approx(0.5)
    assert apart["irr"] == pytest.approx(0.1)
    assert apart["r0.5"] == 0
    others = rounding.differences(found | {"cells": np.array([3, 5])}, exact)
    assert math.isnan(others["J"])
    assert others["shown"] == pytest.approx(0.5)


@pytest.mark.usefixtures("torch_steps")
def test_lobes_are_looked_at_on_another_device() -> None:
    lobes = KNOWN.to(torch.float64)
    own = rounding.of_map(texels.texel_means(KNOWN, 16, 32).float())
    arrays = {name: getattr(lobes, name).numpy() for name in ("axes", "sharpness", "amplitude")}
    with watched():
        there = worker.look(own | arrays, str(DEVICE))
    here = worker.look(own | arrays, "cpu")
    for name, found in there.items():
        np.testing.assert_allclose(found, here[name], rtol=1e-5, atol=1e-7, err_msg=name)


def test_no_cuda_is_said_in_one_line_and_no_maps_in_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_exr(tmp_path / "sky.exr", sky_and_sun(30.0, 16))
    figures = dict.fromkeys((*rounding.LOOKS, *fitted()), 1e-5)
    monkeypatch.setattr(rounding, "compared", lambda *_: {"sky": figures})
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert rounding.main(["--maps", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1] == "cuda: skipped: torch finds no CUDA device here"
    assert "| sky | 1.0e-05 |" in out
    for program in (rounding, ridge):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(SystemExit):
            program.main(["--maps", str(tmp_path / "empty")])
        assert "has no .exr; expected latlong OpenEXR files" in capsys.readouterr().err


def fitted() -> list[str]:
    return [f"fitted {name}{suffix}" for name in rounding.JUDGED for suffix in ("", " float32")]


def test_stress_maps_are_repaired_and_have_light(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("speckled", "square", "all-nan", "black", "1024x2048", "one-sg")
    monkeypatch.setattr(rounding, "CASES", [c for c in rounding.CASES if c.name in names])
    maps = dict(rounding.stress_maps())
    assert set(maps) == {"broken-speckled", "recovery-one-sg"}
    assert (maps["broken-speckled"]["map"] >= 0).all()
    assert np.isfinite(maps["broken-speckled"]["map"]).all()
    assert str(maps["recovery-one-sg"]["form"]) == "sg"


def test_the_ridge_leaves_lobes_apart_as_they_are() -> None:
    name, apart, change, traded, _, flux = ridge.measured("sky", sky_and_sun(30.0, 64))
    assert (name, apart + traded) == ("sky", 15)
    assert apart > 0
    # Between neighbours that amplify errors 20 times the Gram matrix of unit diagonal has an
    # eigenvalue of 1 / 400. The ridge, 1e-5, keeps 4e-3 of what the last step does there, and that
    # step changes an amplitude by less than a quarter.
    assert change < 1e-3
    assert flux < 1e-5


def test_every_part_of_a_fit_is_found_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "sky.exr"
    write_exr(path, sky_and_sun(30.0, 16))
    for places in clean_scene.PARTS.values():
        for place in places:
            owner, name = clean_scene.owner_of(place)
            assert callable(getattr(owner, name))
    before = clean_scene.owner_of("asglight.shots.tracks.simplified")
    own = getattr(*before)
    found = clean_scene.taken([str(path), "--lobes", "2", "--preset", "live"])
    assert getattr(*before) is own
    assert found["fit of the frames"][0] == 1
    assert 0 < found["fit of the frames"][1] < found[clean_scene.WHOLE][1]
    assert found[clean_scene.OTHER][1] > 0
    with pytest.raises(LookupError):
        clean_scene.owner_of("nowhere.at_all")
    with pytest.raises(InputError, match="is not there"):
        clean_scene.taken([str(tmp_path / "none.exr")])


def test_the_table_of_parts_has_medians_and_shares() -> None:
    parts = dict.fromkeys(clean_scene.PARTS, (0, 0.0)) | {clean_scene.OTHER: (1, 0.0)}
    runs = [
        parts | {clean_scene.WHOLE: (1, whole), "repairs": (3, part)}
        for whole, part in ((2.0, 0.1), (4.0, 0.5), (2.5, 0.2))
    ]
    lines = clean_scene.table({"sky, fast": clean_scene.middle(runs)}).splitlines()
    assert lines[0] == "| part | sky, fast |"
    assert "| repairs | 200.0 ms, 8.00 %, 3x |" in lines
    assert "| preroll | – |" in lines


def test_the_process_of_another_arithmetic_begins_where_the_benchmarks_are() -> None:
    assert (rounding.ROOT / "benchmarks" / "steps" / "rounding_worker.py").is_file()


def test_a_form_goes_to_the_process_and_back() -> None:
    given = rounding.of_map(torch.ones(2, 4, 3), 2, Form.SG)
    assert (str(given["form"]), int(given["lobes"]), given["map"].shape) == ("sg", 2, (2, 4, 3))
