# SPDX-License-Identifier: Apache-2.0
"""Verdicts, tables and what a user is told."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asglight.errors import InputError
from dcc import in_blender, measure, renderers, rows, scene, shots, tables
from dcc.rows import FacingRow, Row

GOOD = Row("Blender", "day", 1001, "Y", "dome", "matte", 0.002, 0.005, 0.004, 0.004, 0.006, 0.002)
FACING = FacingRow("Blender", "day", 1001, "Y", 3, 12, 0.001, 0.004, 0.01)


def failures(**changes: object) -> list[str]:
    return rows.failures([dataclasses.replace(GOOD, **changes)], [])


def test_errors_by_hand() -> None:
    found, expected = np.array([1.0, 3.0]), np.array([1.0, 2.0])
    assert rows.relative_rms(found, expected) == pytest.approx((1 / 5) ** 0.5)
    assert rows.relative_mean(found, expected) == pytest.approx(1 / 3)


@pytest.mark.parametrize("count", [2, 4])
def test_noise_is_that_of_the_mean_of_all_renders(count: int) -> None:
    draws = np.random.default_rng(0).normal(1.0, 0.1, (count, 100_000))
    # a deviation of 0.1 of each, over sqrt(count); 100,000 draws know it to 0.3 %
    assert rows.noise(draws) == pytest.approx(0.1 / count**0.5, rel=0.01)


def test_a_row_within_its_limit_is_no_failure() -> None:
    assert failures() == []


@pytest.mark.parametrize(
    ("program", "representation", "most"),
    [("Blender", "dome", 0.01), ("Blender", "cards", 0.03)],
)
@pytest.mark.parametrize("material", scene.MATERIALS)
def test_an_export_above_its_limit_fails(
    program: str, representation: str, most: float, material: str
) -> None:
    row = {"program": program, "representation": representation, "material": material}
    assert failures(export=0.99 * most, **row) == []
    assert failures(export=1.1 * most, **row) == [
        f"{program} day 1001 Y-up {representation} {material}: export {1.1 * most:.2%}, "
        f"above {most:.1%}",
    ]


@pytest.mark.parametrize(
    ("program", "representation", "most"),
    [("Blender", "original", 0.01), ("Mitsuba", "original", 0.02), ("Mitsuba", "dome", 0.02)],
)
def test_what_is_judged_as_the_program_reads_it_says_why(
    program: str, representation: str, most: float
) -> None:
    row = {"program": program, "representation": representation}
    assert failures(export=0.1, reading=0.99 * most, **row) == []
    (line,) = failures(export=0.1, reading=1.1 * most, **row)
    assert f"reading {1.1 * most:.2%}, above {most:.1%}" in line
    assert rows.LIMITS[program, representation].why


def test_balls_under_distant_lights_have_no_limit() -> None:
    assert failures(representation="distant", export=0.7, noise=0.02) == []


def test_a_noisy_render_proves_nothing() -> None:
    (line,) = failures(noise=0.004)
    assert line.endswith("noise 0.40%, above a third of 1.0%; expected more --samples")


def test_distant_lights_are_judged_by_irradiance_and_direction() -> None:
    assert rows.failures([], [FACING]) == []
    worse = dataclasses.replace(FACING, narrow_error=0.03, wide_error=0.05, direction_deg=0.2)
    narrow, wide, turned = rows.failures([], [worse])
    assert "narrow: facing irradiance 3.00% off" in narrow
    assert "wide: facing irradiance 5.00% off" in wide
    assert turned.endswith("a light 0.200 degrees off its lobe")


def test_the_table_says_what_is_missed() -> None:
    sharp = dataclasses.replace(GOOD, material="r0.5", export=0.02)
    original = dataclasses.replace(GOOD, representation="original", fit=None, total=None)
    head, _, first, second = tables.ball_table([GOOD, sharp, original]).splitlines()
    assert head.count("|") == first.count("|") == second.count("|")
    assert first.startswith("| Blender | day | 1001 | Y | dome | 0.20 / 0.20 | 0.50 / 2.00 | ")
    assert first.endswith("| 0.60 / 0.60 | 0.20 / 0.20 | export 1%, missed |")
    assert second.endswith("| original |  | 0.50 | 0.40 | 0.40 |  | 0.20 | reading 1% |")
    assert (
        tables.facing_table([FACING]).splitlines()[-1].endswith("| 3 | 0.10 | 12 | 0.40 | 0.010° |")
    )


def test_a_missing_renderer_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such interpreter; expected one with bpy and mitsuba"):
        renderers.run("dcc.blender_render", [], tmp_path, tmp_path / "python")


def test_a_renderer_that_fails_is_no_success(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nexit 3\n")
    python.chmod(0o755)
    with pytest.raises(RuntimeError, match=r"status 3; see .*blender_render\.log"):
        renderers.run("dcc.blender_render", [], tmp_path, python)


def test_missing_sequences_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="no folder day; expected the sequences day, tunnel"):
        shots.from_sequences(tmp_path, 3, tmp_path)
    command = ["--sequences", str(tmp_path), "-o", str(tmp_path / "out")]
    assert measure.main(command) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_render_is_noisy_if_one_ball_is(tmp_path: Path) -> None:
    balls = np.ones((4, 2, 3, 8, 8, 3))
    job = {"out": str(tmp_path / "render.npz"), "size": 8, "noise": 0.003}
    np.savez(job["out"], balls=balls)
    assert not in_blender.is_noisy(job)
    balls[0, :, 2] = 1.02  # the mean of four is known to 0.005
    np.savez(job["out"], balls=balls)
    assert in_blender.is_noisy(job)
    assert not in_blender.is_noisy(job | {"noise": 0.006})
    assert not in_blender.is_noisy({"out": job["out"], "size": 8})  # such as those without a limit
