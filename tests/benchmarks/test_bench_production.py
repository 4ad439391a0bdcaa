# SPDX-License-Identifier: Apache-2.0
"""What large images cost: `benchmarks/inputs/production.py`, on small ones."""

from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest
import torch
from bench_scripts import module

from asglight.images import read_latlong, write_exr

production = module("inputs.production")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    values = np.random.default_rng(1).random((16, 32, 3), np.float32)
    write_exr(tmp_path / "map.exr", torch.from_numpy(values))
    return tmp_path / "map.exr"


def test_an_enlarged_map_has_the_light_of_the_map_and_grain(place: Path) -> None:
    values = production.enlarged(place, 64).astype(np.float64)
    assert values.shape == (64, 128, 3)
    assert values.mean() == pytest.approx(float(read_latlong(place).radiance.mean()), rel=0.02)
    assert production.enlarged(place, 512).shape == (512, 1024, 3)


@pytest.mark.parametrize("layout", ["lines", "tiles", "parts"])
def test_the_file_that_openexr_decodes_has_the_same_pixels_in_one_part(
    tmp_path: Path, place: Path, layout: str
) -> None:
    values = production.enlarged(place, 32)
    path = tmp_path / "image.exr"
    alone = production.write(path, values, production.Kind(32, "ZIP", layout))
    np.testing.assert_array_equal(OpenEXR.File(str(alone)).channels()["RGB"].pixels, values)
    assert len(OpenEXR.File(str(alone)).parts) == 1
    found = OpenImageIO.ImageBuf(str(path))
    assert found.nsubimages == (4 if layout == "parts" else 1)
    assert (found.spec().tile_width > 0) == (layout == "tiles")
    np.testing.assert_array_equal(found.get_pixels(OpenImageIO.HALF), values)


def test_rows_of_the_tables(tmp_path: Path, place: Path) -> None:
    (tmp_path / "in").mkdir()
    rows = list(production.images(tmp_path / "in", place, [production.Kind(512, "PIZ")], 1))
    assert len(rows) == 3
    _, name, openexr, own, ratio, *megabytes, _ = map(str.strip, rows[2].split("|"))
    assert name == "1k PIZ lines"
    assert float(own) > 0
    assert float(openexr) > 0
    assert float(ratio) > 0
    assert all(10 < int(one) < 2000 for one in megabytes)


def test_seconds_of_a_fit_and_frames_a_second(tmp_path: Path) -> None:
    for frame in (1, 2, 3):
        values = np.full((16, 32, 3), 0.1 * frame, np.float32)
        values[3, 4 + frame] = 5
        write_exr(tmp_path / f"a.{frame}.exr", torch.from_numpy(values))
    output = tmp_path / "out"
    output.mkdir()
    wall, spent, rate = production.fit(tmp_path / "a.#.exr", output / "shot.usda", "live")
    assert spent > 0
    assert 2 / rate < wall
