# SPDX-License-Identifier: Apache-2.0
"""`asglight keys` with images that are not those of the stage."""

import shutil
from pathlib import Path

import pytest
import torch
from key_cases import Rectangle, with_lamps
from pxr import Usd
from usd_tracks import contents

from asglight.cli.main import main
from asglight.cli.sources.same_light import light_off
from asglight.images import write_exr
from asglight.usd.read.keys import read_keys

ROWS = 32


def shot(folder: Path, name: str, gain: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Path:
    """Write two frames with a lamp, of which the second has NaN texels; return their pattern."""
    for frame in (1, 2):
        lamp = Rectangle(30 * frame, 20, 10, 24, 18)
        radiance = with_lamps(ROWS, lamp, rays=2) * torch.tensor(gain)
        if frame == 2:
            radiance[20, 3:6, 1] = torch.nan
        write_exr(folder / f"{name}.{frame}.exr", radiance)
    return folder / f"{name}.#.exr"


def run(*words: str | Path) -> int:
    return main([*map(str, words)])


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stage of that shot: to be copied."""
    folder = tmp_path_factory.mktemp("same_light")
    words = ["--preset", "live", "--lobes", "2"]
    assert run("fit", shot(folder, "sky"), "-o", folder / "sky.usda", *words) == 0
    return folder / "sky.usda"


def test_images_of_another_shot_are_refused_and_the_stage_stays(fitted, tmp_path, capsys) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    other = shot(tmp_path, "other", (1.5, 1.5, 1.5))
    before = contents(tmp_path)
    assert run("keys", stage, "--reference", other) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "other.#.exr: its light at frame 1 is " in error
    assert "sky.usda; expected the images that these were fitted to, 1 % off at most." in error
    assert contents(tmp_path) == before


def test_other_colours_of_as_much_light_are_refused_too(fitted, tmp_path, capsys) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    flux = (with_lamps(ROWS, Rectangle(30, 20, 10, 24, 18), rays=2)).sum((0, 1))
    tinted = shot(tmp_path, "tinted", (1.1, 1.0, 1 - 0.1 * float(flux[0] / flux[2])))
    assert run("keys", stage, "--reference", tinted) == 2
    assert "its light at frame 1 is " in capsys.readouterr().err


def test_lobes_that_were_edited_may_have_another_light_and_it_is_told(
    fitted, tmp_path, capsys
) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    opened = Usd.Stage.Open(str(stage))
    lights = [one for one in opened.Traverse() if one.HasAttribute("inputs:exposure")]
    for light in lights:
        light.GetAttribute("inputs:exposure").Set(1.0)
    opened.Save()
    target = tmp_path / "keyed.usda"
    assert run("keys", stage, "--reference", fitted.with_name("sky.#.exr"), "-o", target) == 0
    [told] = [line for line in capsys.readouterr().err.splitlines() if "its light at" in line]
    assert told.endswith(
        "of the lobes of " + str(stage) + ", which were edited; are these its images?"
    )
    assert read_keys(target) is not None


@pytest.mark.parametrize(
    "words",
    [
        ("--preset", "live", "--lobes", "3"),
        ("--preset", "live", "--tolerance", "0.3"),
        ("--preset", "live", "--form", "sg", "--lobes", "1"),
        ("--preset", "paper", "--lobes", "2", "--paper-steps", "30,5"),  # far off, and says so
    ],
)
def test_nothing_is_said_of_the_images_that_were_fitted(fitted, tmp_path, capsys, words) -> None:
    images = fitted.with_name("sky.#.exr")
    assert run("fit", images, "-o", tmp_path / "a.usda", *words) == 0
    assert run("keys", tmp_path / "a.usda", "--reference", images) == 0
    assert "its light at" not in capsys.readouterr().err


def test_a_frame_that_others_stood_in_for_is_told_where_its_image_is_there(
    fitted, tmp_path, capsys
) -> None:
    shot(tmp_path, "sky")
    whole = (tmp_path / "sky.2.exr").read_bytes()
    (tmp_path / "sky.2.exr").write_bytes(whole[:200])
    words = ["--preset", "live", "--lobes", "2", "--missing", "hold"]
    images, stage = tmp_path / "sky.#.exr", tmp_path / "sky.usda"
    assert run("fit", images, "-o", stage, *words) == 0
    assert run("keys", stage, "--reference", images, "-o", tmp_path / "held.usda") == 0
    assert "its light at" not in capsys.readouterr().err
    shot(tmp_path, "sky", (2.0, 2.0, 2.0))
    shutil.copy(fitted.with_name("sky.1.exr"), tmp_path)
    assert run("keys", stage, "--reference", images, "-o", tmp_path / "there.usda") == 0
    assert "sky.usda, which were filled in there; are these" in capsys.readouterr().err


def test_light_is_compared_channel_by_channel_or_with_what_the_fit_states() -> None:
    image = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    assert light_off(image, image, 0.0) == 0
    assert light_off(image * torch.tensor([1, 1, 1.1]), image, 0.0) == pytest.approx(0.15)
    half = torch.tensor([0.0, 1.0, 2.0], dtype=torch.float64)
    assert light_off(half, image, -0.5) == 0
    assert light_off(half, 2 * image, -0.5) == pytest.approx(0.5)
    assert light_off(image, 0 * image, 0.0) == float("inf")
    assert light_off(0 * image, 0 * image, 0.0) == 0
