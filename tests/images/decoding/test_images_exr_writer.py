# SPDX-License-Identifier: Apache-2.0
"""What is written is what OpenEXR and OpenImageIO read, and a failed write harms nothing."""

import os
import re
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest
import torch
from effort import tries
from full_disk import full_beyond
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from asglight.errors import InputError
from asglight.images import read_latlong, write_exr
from asglight.images.exr_writer import COMPRESSIONS

LOSSY = {"b44", "b44a", "dwaa", "dwab"}


def stored(path: Path) -> np.ndarray:
    return OpenEXR.File(str(path)).channels()["RGB"].pixels


def test_half_file_holds_the_values_rounded_to_half(tmp_path: Path) -> None:
    radiance = torch.rand(4, 8, 3) * 1000
    write_exr(tmp_path / "a.exr", radiance)
    np.testing.assert_array_equal(stored(tmp_path / "a.exr"), radiance.numpy().astype(np.float16))


def test_float_file_holds_the_values(tmp_path: Path) -> None:
    radiance = torch.rand(4, 8, 3) * 1000
    write_exr(tmp_path / "a.exr", radiance, half=False)
    np.testing.assert_array_equal(stored(tmp_path / "a.exr"), radiance.numpy())


@pytest.mark.parametrize(
    ("peak", "dtype"),
    [(65504.0, np.float16), (65504.01, np.float32), (1e6, np.float32), (np.nan, np.float32)],
)
def test_float_is_used_where_half_would_clip(tmp_path: Path, peak: float, dtype: type) -> None:
    radiance = torch.ones(2, 4, 3)
    radiance[1, 2, 0] = peak
    write_exr(tmp_path / "a.exr", radiance)
    pixels = stored(tmp_path / "a.exr")
    assert pixels.dtype == dtype
    np.testing.assert_array_equal(pixels[1, 2, 0], np.float32(peak))


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_compression_is_the_one_asked_for(tmp_path: Path, compression: str) -> None:
    radiance = 1 + torch.rand(32, 64, 3)
    write_exr(tmp_path / "a.exr", radiance, compression=compression)
    reader = OpenImageIO.ImageInput.open(str(tmp_path / "a.exr"))
    assert reader is not None
    assert reader.spec().get_string_attribute("compression").split(":")[0] == compression
    pixels = reader.read_image("float")
    assert pixels is not None
    # 45 is DWA's default level; 2 % covers it and B44's 6-bit differences on values of 1 to 2.
    tolerance = 0.05 if compression in LOSSY else 2**-11
    np.testing.assert_allclose(pixels, radiance.numpy(), rtol=tolerance)


def test_file_is_marked_as_latlong_in_the_default_primaries(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", torch.ones(2, 4, 3))
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert header["envmap"] == OpenEXR.ENVMAP_LATLONG
    assert "chromaticities" not in header


def test_transposed_tensor_is_written_as_it_looks(tmp_path: Path) -> None:
    radiance = torch.rand(3, 8, 4).permute(2, 1, 0)
    write_exr(tmp_path / "a.exr", radiance, half=False)
    np.testing.assert_array_equal(stored(tmp_path / "a.exr"), radiance.numpy())


@pytest.mark.thorough
@given(hnp.arrays(np.float32, (2, 4, 3), elements=st.floats(0, 2.0**127, width=32)))
@settings(max_examples=tries(30), deadline=None)
def test_float_file_survives_a_round_trip(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray
) -> None:
    path = tmp_path_factory.mktemp("trip") / "a.exr"
    write_exr(path, torch.from_numpy(values.copy()), half=False)
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_existing_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    for value in (1, 2):
        write_exr(tmp_path / "a.exr", torch.full((2, 4, 3), value))
    assert os.listdir(tmp_path) == ["a.exr"]
    assert (stored(tmp_path / "a.exr") == 2).all()


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("none/a.exr", r"none/a\.exr: cannot be written \(no folder .*none\); expected"),
        ("file.txt/a.exr", r"a\.exr: cannot be written \(no folder .*file\.txt\)"),
        ("folder.exr", r"folder\.exr: cannot be written \(Is a directory\)"),
        ("a\nb/c.exr", r"a\?b/c\.exr: cannot be written"),
    ],
)
def test_impossible_target_is_refused_in_one_line(
    tmp_path: Path, target: str, message: str
) -> None:
    (tmp_path / "file.txt").touch()
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(InputError, match=message) as caught:
        write_exr(tmp_path / target, torch.ones(2, 4, 3))
    assert str(caught.value).isprintable()
    assert sorted(os.listdir(tmp_path)) == ["file.txt", "folder.exr"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match=r"a\.exr: cannot be written \(Permission denied\)"):
        write_exr(tmp_path / "a.exr", torch.ones(2, 4, 3))


def test_unknown_compression_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="compression: zip9; expected one of none, rle, zips, zip"):
        write_exr(tmp_path / "a.exr", torch.ones(2, 4, 3), compression="zip9")


# A process of its own, because the limit on the size of files cannot be raised again. Python
# ignores the signal, so the writer meets a failing write as on a full disk.
def test_disk_that_runs_full_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, torch.ones(2, 4, 3))
    message = (
        f"{path}: cannot be written (File too large); expected a folder with room and the "
        "permission to write. Check the output path."
    )
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"), full_beyond(20_000):
        write_exr(path, torch.rand(128, 256, 3), compression="none")
    assert os.listdir(tmp_path) == ["a.exr"]
    assert (stored(path) == 1).all()
