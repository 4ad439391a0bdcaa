# SPDX-License-Identifier: Apache-2.0
"""A stress case becomes a verdict, whatever the fit does; results become a page and JSON."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from asglight.errors import InputError
from asglight.judging.stress import page as stress_page
from asglight.judging.stress import run as stress
from asglight.judging.stress.case import FOUND, Bound, Case, Group, of_lobes
from asglight.judging.stress.maps import SUN, constant, lobe
from asglight.judging.stress.run import Measured, Result, Tools, Verdict, run_case, shader_bound
from asglight.lobes import Lobes, LobeTracks

LAMP = lobe(SUN, 60.0, (2.0, 1.0, 0.5))
CASE = of_lobes(Group.RECOVERY, "lamp", "one lamp", lambda: [LAMP], rows=32, recovery=FOUND)
NO_SHADER = "no OpenGL here"


def tools(lobes: Lobes = LAMP, error: Exception | None = None) -> Tools:
    """Return a fit that finds given lobes, or fails, and no shaders."""

    def fit(source: Path, *, lobes: int, preset: str, form: str) -> LobeTracks:
        assert [path.suffix for path in source.iterdir()] == [".exr"]
        if error is not None:
            raise error
        return found

    found = LobeTracks((1,), 24.0, lobes.to(torch.float32)[None])
    return Tools(fit, None, NO_SHADER)


def result(value: float, own: Bound, common: float = 0.01) -> Result:
    measured = Measured(value, own.value, common, own.reason)
    return Result(CASE, {"irr": measured}, 1, 1)


def test_a_fit_that_finds_its_lobes_is_ok() -> None:
    found = run_case(CASE, tools())
    assert found.verdict is Verdict.OK, found
    assert list(found.measured) == [
        *("finite", "flux", "irr", "gradient", "shader", "balls", "stage"),
        *("direction", "sharpness", "amplitude"),
    ]
    for name in ("shader", "balls"):
        assert found.measured[name].value is None
        assert found.measured[name].note == NO_SHADER
    assert found.measured["amplitude"].value == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        (replace(LAMP, amplitude=LAMP.amplitude * 1.04), "flux"),
        (lobe((0.5, 0.5, 0.7), 60.0, (2.0, 1.0, 0.5)), "direction"),
        (lobe(SUN, 70.0, (2.33, 1.17, 0.58)), "sharpness"),
    ],
)
def test_a_fit_that_is_wrong_fails_by_the_check_that_is_for_it(wrong: Lobes, check: str) -> None:
    found = run_case(CASE, tools(wrong))
    assert found.verdict is Verdict.FAIL
    assert not found.measured[check].passes
    assert any(text.startswith(f"{check} ") for text in stress_page.reasons(found))


def test_a_fit_that_ends_is_a_failed_case_and_no_traceback() -> None:
    found = run_case(CASE, tools(error=RuntimeError("values that are not finite")))
    assert found.verdict is Verdict.FAIL
    assert found.message == "RuntimeError: values that are not finite"
    assert run_case(CASE, tools(error=InputError("no."))).verdict is Verdict.FAIL


def test_an_input_to_be_refused_has_to_be_refused_in_the_right_words() -> None:
    case = Case("x", Group.BROKEN, "broken", lambda: [constant(1.0, 8)], refused="expected a 2:1")
    refused = InputError("a.exr: is 1 x 1; expected a 2:1 latlong.")
    assert run_case(case, tools(error=refused)).verdict is Verdict.REFUSED
    for wrong in (InputError("a.exr: cannot be read."), RuntimeError("expected a 2:1"), None):
        assert run_case(case, tools(error=wrong)).verdict is Verdict.FAIL
    two_lines = InputError("expected a 2:1\nlatlong")
    assert run_case(case, tools(error=two_lines)).verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(0.005, Verdict.OK), (0.05, Verdict.STATED), (0.2, Verdict.FAIL), (math.inf, Verdict.FAIL)],
)
def test_only_what_is_beyond_the_common_bound_needs_its_reason(
    value: float, verdict: Verdict
) -> None:
    assert result(value, Bound(0.1, "Squares have corners.")).verdict is verdict


@pytest.mark.parametrize("sharpness", [1e-3, 1e2, 1e7])
def test_the_shaders_bound_is_above_what_float32_does(sharpness: float) -> None:
    """exp(-s x^2) with every number rounded to float32, against float64."""
    angle = torch.linspace(0, 4, 2001, dtype=torch.float64) / max(1.0, 2 * sharpness) ** 0.5
    axis = torch.nn.functional.normalize(torch.tensor([0.48, -0.6, 0.64]).double(), dim=0)
    across = torch.nn.functional.normalize(
        torch.linalg.cross(axis, torch.tensor([0.0, 1.0, 0.0]).double()), dim=0
    )
    directions = (angle.cos()[:, None] * axis + angle.sin()[:, None] * across).float()
    across = across.float()
    x = directions[:, 0] * across[0] + directions[:, 1] * across[1] + directions[:, 2] * across[2]
    single = torch.exp(-torch.tensor(sharpness).float() * x * x).double()
    double = torch.exp(-sharpness * (directions.double() @ across.double()).square())
    apart = float((single - double).abs().max())
    bound = shader_bound(lobe(SUN, sharpness))
    assert apart < bound
    assert bound < 1e-3


def test_page_and_json_say_the_same_and_why_there_are_no_shaders() -> None:
    results = [
        run_case(CASE, tools()),
        run_case(replace(CASE, name="gone"), tools(error=RuntimeError("gone"))),
    ]
    document = json.loads(json.dumps(stress.as_document(results, tools(), "x"), allow_nan=False))
    assert document["verdicts"] == {"ok": 1, "stated": 0, "refused": 0, "FAIL": 1}
    assert document["opengl"] == {"name": None, "missing": NO_SHADER}
    assert [case["verdict"] for case in document["cases"]] == ["ok", "FAIL"]
    assert document["cases"][1]["message"] == "RuntimeError: gone"
    assert document["cases"][0]["checks"]["irr"]["passes"]
    page = stress_page.page(results, tools(), "asglight stress")
    assert "2 cases: 1 ok, 0 stated, 0 refused, 1 FAIL" in page
    assert f"GLSL and balls were not checked: {NO_SHADER}" in page
    assert "- gone: RuntimeError: gone" in page
    rows = [line for line in page.splitlines() if line.startswith(("| case", "| lamp", "| gone"))]
    assert len({row.count("|") for row in rows}) == 1


def test_an_error_that_is_no_number_is_null_in_json_and_fails() -> None:
    document = stress.as_document([result(math.inf, Bound(0.1))], tools(), "x")
    (case,) = json.loads(json.dumps(document, allow_nan=False))["cases"]
    assert case["checks"]["irr"] == {"error": None, "bound": 0.1, "passes": False, "note": None}
    assert case["verdict"] == "FAIL"


def test_lobes_beyond_what_shaders_take_go_in_parts() -> None:
    many = lobe(SUN, 1.0).select(torch.zeros(300, dtype=torch.long))
    assert [part.count for part in stress.parts(many, 128)] == [128, 128, 44]
