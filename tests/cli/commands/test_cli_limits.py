# SPDX-License-Identifier: Apache-2.0
"""`asglight eval --limit`: a stage whose errors are known is above or below its limits."""

import json

import pytest
import torch

from asglight.cli import limits
from asglight.cli.main import main
from asglight.images import write_exr
from asglight.lobes import Lobes, LobeTracks, frames, texels
from asglight.usd import write_usd

HEIGHT = 32
DIM = 0.9
"""The stage has this share of the light of the images, so every error but flicker is 0.1."""


@pytest.fixture(scope="module")
def dimmed(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the arguments that judge three frames of a lamp against a stage that is too dark."""
    folder = tmp_path_factory.mktemp("dimmed")
    axes = frames.axes_around(torch.tensor([[0.0, 0.6, 0.8]]))
    lamp = Lobes(axes, torch.full((1, 2), 60.0), torch.ones(1, 3))
    images = folder / "lamp"
    images.mkdir()
    for number in (1, 2, 3):
        write_exr(images / f"lamp.{number:04d}.exr", texels.texel_means(lamp, HEIGHT, 2 * HEIGHT))
    parts = lamp.axes, lamp.sharpness, DIM * lamp.amplitude
    dark = Lobes(*(torch.stack([part, part]) for part in parts))
    write_usd(LobeTracks((1, 3), 24.0, dark), folder / "dim.usda")
    return ["eval", str(folder / "dim.usda"), "--reference", str(images)]


def test_below_its_limits_a_stage_passes(dimmed, capsys) -> None:
    asked = ["--limit", "irr=0.11", "--limit", "r0.25=0.11", "--limit", "flicker=0.001"]
    assert main([*dimmed, "--frames", "1,3", *asked]) == 0
    assert "above" not in capsys.readouterr().err


def test_above_a_limit_the_exit_status_is_3_and_a_line_says_why(dimmed, capsys) -> None:
    asked = ["--limit", "irr=0.05", "--limit", "r0.5=0.5", "--limit", "flux=0.09", "--json"]
    assert main([*dimmed, "--frames", "1,3", *asked]) == 3
    out, err = capsys.readouterr()
    assert json.loads(out)["mean"]["irr"] == pytest.approx(0.1, abs=2e-3)
    stage = dimmed[1]
    said = [line for line in err.splitlines() if "above" in line]
    assert [line.partition(" 0.")[0] for line in said] == [f"{stage}: irr", f"{stage}: flux"]
    assert said[0].endswith(": above the limit of 0.05")


def test_between_frames_what_a_program_interpolates_is_held_to_the_limit(dimmed, capsys) -> None:
    assert main([*dimmed, "--between", "--limit", "irr=0.11"]) == 0
    assert main([*dimmed, "--between", "--limit", "irr=0.09"]) == 3
    assert ": above the limit of 0.09" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--limit", "mirror=0.1"], "--limit mirror: expected one of env, flux, irr, irrMax, "),
        (["--between", "--limit", "flicker=1"], "--limit flicker: expected one of flux, irr, "),
    ],
)
def test_an_error_that_is_not_measured_is_refused(dimmed, capsys, asked, said) -> None:
    assert main([*dimmed, *asked]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", ["irr", "irr=", "irr=low", "=0.1", "irr=-1", "irr=nan"])
def test_a_limit_that_is_none_is_refused(dimmed, capsys, text: str) -> None:
    assert main([*dimmed, "--limit", text]) == 2
    assert "expected an error and a number: irr=0.01" in capsys.readouterr().err


def test_what_is_no_number_is_above_any_limit() -> None:
    assert limits.above({"irr": float("nan")}, [("irr", 1e9)]) == [
        "irr nan: above the limit of 1e+09"
    ]
