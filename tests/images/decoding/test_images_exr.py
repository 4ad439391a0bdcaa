# SPDX-License-Identifier: Apache-2.0
"""Every kind of OpenEXR file is read to the values that were put in."""

from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import OpenImageIO
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from places import SHARED

from asglight.errors import InputError
from asglight.images import read_latlong
from asglight.images.options import ReadOptions

LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "HTJ2K256", "HTJ2K32", "ZSTD")
# The loss each format allows itself on smooth values, measured on the ramp and doubled: B44 keeps
# 6 bits of a half's difference, DWA 45 steps of visual error, PXR24 the upper 24 bits of a float.
LOSSY = {"PXR24": 2**-15, "B44": 0.02, "B44A": 0.02, "DWAA": 0.05, "DWAB": 0.05}


def compression(name: str) -> object:
    code = getattr(OpenEXR, f"{name}_COMPRESSION", None)
    if code is None:
        pytest.skip(f"this OpenEXR has no {name} compression")
    return code


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("name", LOSSLESS)
def test_lossless_compressions_are_read_exactly(tmp_path: Path, name: str, dtype: type) -> None:
    values = image_files.ramp(32, 64, dtype) if dtype != np.float16 else image_files.ramp(8, 16)
    stored = values.astype(dtype)
    path = image_files.write_rgb(tmp_path / "a.exr", stored, compression=compression(name))
    radiance = read_latlong(path).radiance
    assert radiance.dtype == torch.float32
    np.testing.assert_array_equal(radiance.numpy(), stored.astype(np.float32))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("name", LOSSY)
def test_lossy_compressions_are_read_within_their_loss(
    tmp_path: Path, name: str, dtype: type
) -> None:
    values = 1 + image_files.ramp(32, 64).astype(dtype) / 1024
    path = image_files.write_rgb(tmp_path / "a.exr", values, compression=compression(name))
    np.testing.assert_allclose(read_latlong(path).radiance.numpy(), values, rtol=LOSSY[name])


def test_tiled_file_is_read(tmp_path: Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 3
    values = image_files.ramp()
    path = image_files.write_rgb(tmp_path / "t.exr", values, type=OpenEXR.tiledimage, tiles=tiles)
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_finest_level_of_a_mipmap_is_read(tmp_path: Path) -> None:
    values = image_files.ramp(8, 16)
    buffer = OpenImageIO.ImageBuf(values)
    path = tmp_path / "mip.exr"
    made = OpenImageIO.ImageBufAlgo.make_texture(OpenImageIO.MakeTxTexture, buffer, str(path))
    assert made, OpenImageIO.geterror()
    reader = OpenImageIO.ImageInput.open(str(path))
    assert reader is not None
    assert reader.seek_subimage(0, 1), "the file has one level only"
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_rows_stored_from_the_bottom_are_read_upright(tmp_path: Path) -> None:
    values = image_files.ramp()
    path = image_files.write_rgb(tmp_path / "d.exr", values, lineOrder=OpenEXR.DECREASING_Y)
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_channels_of_different_types_are_read_by_value(tmp_path: Path) -> None:
    values = image_files.ramp(dtype=np.uint32)
    path = image_files.write(
        tmp_path / "m.exr",
        {
            "R": values[..., 0].astype(np.float32),
            "G": values[..., 1].astype(np.float16),
            "B": values[..., 2].copy(),
            "A": np.ones(values.shape[:2], dtype=np.float16),
        },
    )
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values.astype(np.float32))


def test_extension_does_not_matter(tmp_path: Path) -> None:
    values = image_files.ramp()
    path = image_files.write_rgb(tmp_path / "a.exr", values).rename(tmp_path / "a.hdr")
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_name_outside_ascii_is_read(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "plain.exr", image_files.ramp())
    path = path.rename(tmp_path / "Märchen 空.exr")
    assert read_latlong(path).radiance.shape == (4, 8, 3)


def layered(path: Path) -> tuple[Path, dict[str, np.ndarray]]:
    images = {"fill": image_files.ramp(), "sun.key": image_files.ramp()[::-1].copy()}
    channels = {
        f"{layer}.{channel}": np.ascontiguousarray(values[..., index])
        for layer, values in images.items()
        for index, channel in enumerate("RGB")
    }
    channels["Z"] = np.ones((4, 8), dtype=np.float32)
    return image_files.write(path, channels), images


@pytest.mark.parametrize("layer", ["fill", "sun.key", "FILL"])
def test_layer_is_read_by_name(tmp_path: Path, layer: str) -> None:
    path, images = layered(tmp_path / "l.exr")
    np.testing.assert_array_equal(
        read_latlong(path, reading=ReadOptions(layer)).radiance.numpy(), images[layer.lower()]
    )


def test_several_layers_without_a_choice_are_listed(tmp_path: Path) -> None:
    path, _ = layered(tmp_path / "l.exr")
    with pytest.raises(InputError, match=r"l\.exr: has 2 layers .*\(fill, sun\.key\).*--layer"):
        read_latlong(path)


def test_unknown_layer_lists_the_layers(tmp_path: Path) -> None:
    path, _ = layered(tmp_path / "l.exr")
    with pytest.raises(InputError, match=r"no layer beuty; expected .*\(fill, sun\.key\)"):
        read_latlong(path, reading=ReadOptions("beuty"))


def test_unknown_layer_of_a_plain_file_says_so(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "p.exr", image_files.ramp())
    with pytest.raises(InputError, match=r"no layer beauty; .*\(none, only plain R, G, B\)"):
        read_latlong(path, reading=ReadOptions("beauty"))


def test_only_layer_is_read_without_being_named(tmp_path: Path) -> None:
    values = image_files.ramp()
    channels = {f"env.{name}": values[..., i].copy() for i, name in enumerate("RGB")}
    path = image_files.write(tmp_path / "o.exr", {**channels, "Z": values[..., 0].copy()})
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_plain_image_is_preferred_to_layers(tmp_path: Path) -> None:
    values = image_files.ramp()
    channels = {f"env.{name}": values[..., i].copy() for i, name in enumerate("RGB")}
    path = image_files.write(tmp_path / "o.exr", {"RGB": values * 2, **channels})
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values * 2)


def multipart(path: Path) -> tuple[Path, np.ndarray]:
    values = image_files.ramp()
    images = {"depth": {"Z": values[..., 0].copy()}, "beauty": {"RGB": values}}
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, channels, name)
        for name, channels in {**images, "sun": {"RGB": values * 2}}.items()
    ]
    OpenEXR.File(parts).write(str(path))
    return path, values


def test_first_part_with_colour_is_read(tmp_path: Path) -> None:
    path, values = multipart(tmp_path / "p.exr")
    np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), values)


def test_part_is_read_by_name(tmp_path: Path) -> None:
    path, values = multipart(tmp_path / "p.exr")
    np.testing.assert_array_equal(
        read_latlong(path, reading=ReadOptions("sun")).radiance.numpy(), values * 2
    )


def test_luminance_is_read_as_grey(tmp_path: Path) -> None:
    values = image_files.ramp()[..., 0].copy()
    path = image_files.write(tmp_path / "y.exr", {"Y": values})
    np.testing.assert_array_equal(
        read_latlong(path).radiance.numpy(), values[..., None].repeat(3, 2)
    )


def window(left: int, top: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([left, top], dtype=np.int32)
    return low, low + np.array([width - 1, height - 1], dtype=np.int32)


@pytest.mark.thorough
@given(
    left=st.integers(-6, 12),
    top=st.integers(-4, 10),
    width=st.integers(1, 12),
    height=st.integers(1, 8),
    origin=st.integers(-3, 3),
)
@settings(max_examples=tries(60), deadline=None)
def test_data_window_lands_where_the_display_window_says(
    tmp_path_factory: pytest.TempPathFactory,
    left: int,
    top: int,
    width: int,
    height: int,
    origin: int,
) -> None:
    values = image_files.ramp(height, width)
    path = image_files.write_rgb(
        tmp_path_factory.mktemp("window") / "w.exr",
        values,
        dataWindow=window(left + origin, top + origin, width, height),
        displayWindow=window(origin, origin, 8, 4),
    )
    expected = np.zeros((4, 8, 3), dtype=np.float32)
    touched = False
    for row in range(height):
        for column in range(width):
            if 0 <= top + row < 4 and 0 <= left + column < 8:
                expected[top + row, left + column] = values[row, column]
                touched = True
    if touched:
        np.testing.assert_array_equal(read_latlong(path).radiance.numpy(), expected)
    else:
        with pytest.raises(InputError, match=r"w\.exr: its data window lies outside"):
            read_latlong(path)


def test_smallest_latlong_is_one_row_of_two(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "s.exr", image_files.ramp(1, 2))
    assert read_latlong(path, height=64).radiance.shape == (1, 2, 3)


def test_image_is_reduced_by_solid_angle(tmp_path: Path) -> None:
    values = image_files.ramp(8, 16)
    path = image_files.write_rgb(tmp_path / "r.exr", values)
    image = read_latlong(path, height=4)
    edges = np.sin(np.pi / 2 - np.pi * np.arange(9) / 8)
    band = (edges[:-1] - edges[1:])[:, None, None]
    blocks = (values * band).reshape(4, 2, 8, 2, 3).sum(axis=(1, 3))
    expected = blocks / (2 * band.reshape(4, 2, 1, 1).sum(axis=1))
    # float32 sums of four terms
    np.testing.assert_allclose(image.radiance.numpy(), expected, rtol=1e-6)
    assert image.source_shape == (8, 16)


def test_image_is_never_enlarged(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "r.exr", image_files.ramp())
    assert read_latlong(path, height=256).radiance.shape == (4, 8, 3)


def test_height_below_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="height: 0 rows; expected 1 or more"):
        read_latlong(tmp_path / "any.exr", height=0)


def test_texels_are_repaired_before_the_reduction(tmp_path: Path) -> None:
    values = np.ones((4, 8, 3), dtype=np.float32)
    values[1, 3] = np.nan
    values[2, 5, 0] = -2
    image = read_latlong(image_files.write_rgb(tmp_path / "n.exr", values), height=2)
    assert bool((image.radiance >= 0).all())
    assert (image.repair.nonfinite, image.repair.negative, image.repair.first) == (1, 1, (1, 3))
    # The NaN texel is one of the four under its new one, in the row nearer the equator.
    inner, outer = np.sin(np.pi / 4), 1 - np.sin(np.pi / 4)
    expected = 1 - inner / (2 * (inner + outer))
    assert image.radiance[0, 1, 1].item() == pytest.approx(expected, rel=1e-6)


def test_real_maps_report_their_negative_texels() -> None:
    path = SHARED / "hdri" / "esplanade.exr"
    if not path.exists():
        pytest.skip(f"test data is not here: {path}")
    image = read_latlong(path)
    reference = OpenEXR.File(str(path)).channels()["RGB"].pixels.astype(np.float32)
    assert image.repair.negative == int((reference < 0).any(axis=-1).sum())
    np.testing.assert_array_equal(image.radiance.numpy(), reference.clip(min=0))
