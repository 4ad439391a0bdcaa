# SPDX-License-Identifier: Apache-2.0
"""`asglight keys` with images that are not those of the stage."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from key_cases import Rectangle, with_lamps

from asglight.cli.main import main
from asglight.cli.sources.same_light import SameLight, light_off
from asglight.images import open_sequence, write_exr
from asglight.usd import read_usd

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


def told(capsys) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if "its light at" in line]


def test_images_of_another_shot_are_told_of_once(fitted, tmp_path, capsys) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    other = shot(tmp_path, "other", (1.5, 1.5, 1.5))
    assert run("keys", stage, "--reference", other) == 0
    (line,) = told(capsys)
    # a third of the channel that has most, over the mean of all
    assert "other.#.exr: its light at frame 1 is 34.5 % off that of the lobes of" in line
    assert line.endswith("sky.usda; are these the images that it was fitted to?")


def test_a_black_map_has_no_light_and_no_share_of_it(fitted, tmp_path, capsys) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    assert run("keys", stage, "--reference", shot(tmp_path, "black", (0.0, 0.0, 0.0))) == 0
    (line,) = told(capsys)
    assert "black.#.exr: its light at frame 1 is none, unlike that of the lobes of" in line


def test_other_colours_of_as_much_light_are_told_of_too(fitted, tmp_path, capsys) -> None:
    stage = Path(shutil.copy(fitted, tmp_path))
    flux = (with_lamps(ROWS, Rectangle(30, 20, 10, 24, 18), rays=2)).sum((0, 1))
    tinted = shot(tmp_path, "tinted", (1.1, 1.0, 1 - 0.1 * float(flux[0] / flux[2])))
    assert run("keys", stage, "--reference", tinted) == 0
    assert len(told(capsys)) == 1


@pytest.mark.parametrize(
    "words",
    [
        ("--preset", "live", "--lobes", "3"),
        ("--preset", "live", "--tolerance", "0.3"),
        ("--preset", "live", "--form", "sg", "--lobes", "1"),
    ],
)
def test_nothing_is_said_of_the_images_that_were_fitted(fitted, tmp_path, capsys, words) -> None:
    images = fitted.with_name("sky.#.exr")
    assert run("fit", images, "-o", tmp_path / "a.usda", *words) == 0
    assert run("keys", tmp_path / "a.usda", "--reference", images) == 0
    assert "its light at" not in capsys.readouterr().err


def test_a_frame_that_others_stand_in_for_is_not_compared(fitted) -> None:
    found: list[object] = []
    images = str(fitted.with_name("sky.#.exr"))
    compare = SameLight(read_usd(fitted), str(fitted), images, found.append)
    image = open_sequence(images, height=ROWS).read(1)
    brighter = replace(image, radiance=2 * image.radiance)
    compare(1, replace(brighter, repair=replace(image.repair, filled_from=(2,))))
    assert found == []
    compare(1, brighter)
    assert len(found) == 1


def test_light_is_compared_channel_by_channel() -> None:
    image = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    assert light_off(image, image) == 0
    assert light_off(image * torch.tensor([1, 1, 1.1]), image) == pytest.approx(0.15)
    assert light_off(image, 0 * image) == float("inf")
    assert light_off(0 * image, 0 * image) == 0
