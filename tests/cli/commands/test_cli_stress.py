# SPDX-License-Identifier: Apache-2.0
"""`asglight stress`: what it prints and writes, its exit status, and what it refuses."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.judging.stress import run as stress
from asglight.judging.stress.case import Case, Group
from asglight.judging.stress.cases import CASES
from asglight.judging.stress.run import Measured, Result, Tools

SOME = ("stiff/sharpness-100", "broken/square")


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> list[Tools]:
    """Let every case fail in no time; return the tools that were handed in."""
    handed: list[Tools] = []

    def run_case(case: Case, tools: Tools) -> Result:
        handed.append(tools)
        names = ["finite", "flux", "irr", "gradient", "shader", "balls", "stage"]
        if case.group is Group.RECOVERY:
            names += ["direction", "sharpness", "amplitude"]
        return Result(case, {name: Measured(0.5, 0.1, 0.1) for name in names}, 3, 1)

    monkeypatch.setattr(stress, "run_case", run_case)
    return handed


def test_some_cases_are_run_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["stress", "--only", *SOME, "-o", str(folder)]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0] == "Stiff lobes"
    assert lines[1].split()[:2] == ["case", "lobes"]
    assert lines[2].startswith("sharpness-100 ")
    assert lines[2].endswith(" ok")
    assert "  square: " in out
    assert lines[-1] == "2 cases: 1 ok, 0 stated, 1 refused, 0 FAIL"
    assert err.startswith("stress (2)")
    assert {path.name for path in folder.iterdir()} == {"stress.md", "stress.json"}
    page = (folder / "stress.md").read_text()
    assert page.startswith(f"# Stress\n\n`asglight stress --only {' '.join(SOME)}` ")
    assert "/tmp" not in page


def test_a_sample_has_all_of_time_and_some_of_the_others_which_the_page_names(
    failing: list[Tools], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stress", "--sample", "0.1", "-o", str(tmp_path)]) == 3
    document = json.loads((tmp_path / "stress.json").read_text())
    groups = [case["group"] for case in document["cases"]]
    of_time = sum(case.group == "time" for case in CASES)
    assert groups.count("time") == of_time
    assert len(groups) - of_time == round(0.1 * (len(CASES) - of_time))
    again = (tmp_path / "stress.md").read_text().split("`asglight stress --only ")[1].split("`")[0]
    capsys.readouterr()
    assert main(["stress", "--json", "--only", *again.split()]) == 3
    repeated = json.loads(capsys.readouterr().out)["cases"]
    assert [case["name"] for case in repeated] == [case["name"] for case in document["cases"]]


@pytest.mark.parametrize("share", ["0", "1.5"])
def test_a_share_beyond_its_range_is_refused(
    share: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stress", "--sample", share]) == 2
    assert f"sample: {share}; expected a share above 0, at most 1." in capsys.readouterr().err


def test_json_is_one_document_with_every_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stress", "--only", *SOME, "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert document["asglight_stress"] == 1
    assert document["verdicts"] == {"ok": 1, "stated": 0, "refused": 1, "FAIL": 0}
    assert document["wall_seconds"] > 0
    fitted, refused = document["cases"]
    assert (fitted["name"], fitted["group"], fitted["frames"]) == ("sharpness-100", "stiff", 1)
    assert 0 < fitted["checks"]["irr"]["error"] < fitted["checks"]["irr"]["bound"] == 0.005
    assert (refused["verdict"], refused["checks"]) == ("refused", {})
    assert "expected a 2:1 latlong" in refused["message"]


def test_a_case_that_fails_ends_in_3_and_says_by_what(
    failing: list[Tools], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stress", "--only", "time/cut"]) == 3
    out = capsys.readouterr().out
    assert "  cut: flux 0.5, at most 0.1 expected" in out
    assert out.endswith("1 case: 0 ok, 0 stated, 0 refused, 1 FAIL\n")
    assert main(["stress", "--only", "time/cut", "--json"]) == 3


def test_without_opengl_the_table_says_why(
    failing: list[Tools], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from asglight.viewer.gl import context

    def none_there() -> None:
        raise InputError("OpenGL: found none; expected OpenGL 4.1 or later.")

    monkeypatch.setattr(context, "standalone_context", none_there)
    main(["stress", "--only", "time/cut"])
    assert "GLSL and balls were not checked: OpenGL: found none;" in capsys.readouterr().out
    monkeypatch.setitem(sys.modules, "asglight.viewer.gl.context", None)
    monkeypatch.setitem(sys.modules, "moderngl", None)
    main(["stress", "--only", "time/cut"])
    assert "is not installed. pip install asglight[view]" in capsys.readouterr().out
    assert [tools.shader for tools in failing] == [None, None]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "speed"], "asglight: only: 'speed'; expected a group: stiff, radiance,"),
        (["--only", "time/cat"], "asglight: only: no case 'time/cat'; expected time/ and one of"),
        (["--only", "time", "-o", "/dev/null/x"], "asglight: /dev/null/x: cannot be made"),
    ],
)
def test_faults_of_the_user_are_one_line_before_any_work(
    words: list[str], message: str, failing: list[Tools], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["stress", *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert failing == []
