# SPDX-License-Identifier: Apache-2.0
"""Radiance files are read to what their bytes mean."""

from pathlib import Path

import image_files
import numpy as np
import pytest

from asglight.images import read_latlong


@pytest.mark.parametrize("run_length", [False, True])
def test_flat_and_run_length_coded_files_are_read(tmp_path: Path, run_length: bool) -> None:
    pixels, expected = image_files.rgbe(8, 16)
    path = tmp_path / "a.hdr"
    path.write_bytes(image_files.hdr_bytes(pixels, size="-Y 8 +X 16", run_length=run_length))
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), expected)


def test_zero_exponent_is_black(tmp_path: Path) -> None:
    pixels = np.full((1, 2, 4), 200, dtype=np.uint8)
    pixels[..., 3] = 0
    path = tmp_path / "black.hdr"
    path.write_bytes(image_files.hdr_bytes(pixels, size="-Y 1 +X 2"))
    assert not read_latlong(path).radiance.any()


@pytest.mark.parametrize("columns", ["+X", "-X"])
@pytest.mark.parametrize("rows", ["-Y", "+Y"])
@pytest.mark.parametrize("by_columns", [False, True])
def test_orientation_line_is_followed(
    tmp_path: Path, rows: str, columns: str, by_columns: bool
) -> None:
    """The Radiance manual: the sign says which way an axis runs, the first axis is the slow one."""
    pixels, upright = image_files.rgbe(4, 8)
    stored = pixels[:: 1 if rows == "-Y" else -1, :: 1 if columns == "+X" else -1]
    size = f"{rows} 4 {columns} 8"
    if by_columns:
        stored, size = stored.swapaxes(0, 1), f"{columns} 8 {rows} 4"
    path = tmp_path / "o.hdr"
    path.write_bytes(image_files.hdr_bytes(np.ascontiguousarray(stored), size=size))
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), upright)


def test_extension_does_not_matter(tmp_path: Path) -> None:
    pixels, expected = image_files.rgbe()
    path = tmp_path / "a.exr"
    path.write_bytes(image_files.hdr_bytes(pixels, size="-Y 4 +X 8"))
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), expected)
