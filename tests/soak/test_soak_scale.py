# SPDX-License-Identifier: Apache-2.0
"""The measurements of scale: their input, what becomes of one that fails, their table."""

from pathlib import Path

import pytest

from asglight.images import read_latlong
from soak import scale


def test_the_large_image_has_its_mean_and_its_size(tmp_path: Path) -> None:
    scale._write_large(tmp_path / "large.exr", 256, 512)
    image = read_latlong(tmp_path / "large.exr")
    assert image.source_shape == (256, 512)
    # a ramp from 0 to twice the mean, in half floats of three digits
    assert float(image.radiance.mean()) == pytest.approx(scale.MEAN, rel=1e-3)
    assert float(image.radiance.min()) == 0
    assert float(image.radiance.max()) == 2 * scale.MEAN


def test_an_image_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"large\.exr: cannot be opened for writing"):
        scale._write_large(tmp_path / "none" / "large.exr", 256, 512)


def test_a_measurement_is_made_apart_and_its_failure_is_told(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    seen: list[Path] = []

    def measure(folder: Path) -> dict[str, object]:
        seen.append(folder)
        return {"files": len(list(folder.iterdir()))}

    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "left.txt").touch()
    found = scale.measured("a folder", tmp_path / "work", measure)
    assert (found.what, found.figures, seen) == ("a folder", {"files": 0}, [])
    assert not (tmp_path / "work").exists()
    assert scale.as_table([found]).splitlines()[-1] == "| a folder | files 0 | 0 |"

    def fail(folder: Path) -> dict[str, object]:
        raise MemoryError("too many lobes")

    with pytest.raises(RuntimeError, match=r"a fault: ended with 1$"):
        scale.measured("a fault", tmp_path / "work", fail)
    assert "MemoryError: too many lobes" in capfd.readouterr().err
