# SPDX-License-Identifier: Apache-2.0
"""The beauty is found by what renderers call it; where that does not decide, the user is asked."""

from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import pytest

from asglight.errors import InputError
from asglight.images import open_sequence, read_latlong
from asglight.images.decoding.decode import read_header
from asglight.images.options import ReadOptions

BEAUTY, OTHER = image_files.ramp(), 100 + image_files.ramp()


def in_parts(path: Path, *names: str, **headers: dict[str, object]) -> Path:
    """Write a part of R, G, B for each name; those that are beauties hold BEAUTY."""
    parts = []
    for name in names:
        values = BEAUTY if name.lower().split(".")[0] in WANTED else OTHER
        header = {"type": OpenEXR.scanlineimage, **headers.get(name, {})}
        parts.append(OpenEXR.Part(header, {"RGB": values}, name))
    OpenEXR.File(parts).write(str(path))
    return path


WANTED = {"c", "ci", "beauty", "rgba", "rgb", "combined", "default", "main"}


def in_layers(path: Path, names: dict[str, np.ndarray], suffixes: str = "R G B") -> Path:
    """Write one part with layers of three channels."""
    channels = {
        f"{name}{suffix}": np.ascontiguousarray(values[..., index])
        for name, values in names.items()
        for index, suffix in enumerate(suffixes.split())
    }
    return image_files.write(path, channels)


@pytest.mark.parametrize("name", ["C", "Ci", "beauty", "Beauty", "rgba", "RGB", "Combined", "main"])
def test_a_part_is_the_beauty_by_its_name(tmp_path: Path, name: str) -> None:
    path = in_parts(tmp_path / "a.exr", "N", "albedo", name, "diffuse")
    image = read_latlong(path)
    np.testing.assert_array_equal(image.radiance, BEAUTY)
    assert image.header.layer.label == name
    assert image.header.layer.others == ("N", "albedo", "diffuse")


@pytest.mark.parametrize(
    ("name", "suffixes"),
    [
        ("C.", "R G B"),
        ("C.", "r g b"),
        ("beauty.", "red green blue"),
        ("rgba.", "red green blue"),
        ("ViewLayer.Combined.", "R G B"),
        ("", "red green blue"),
        ("", "r g b"),
    ],
)
def test_a_layer_is_the_beauty_by_its_name(tmp_path: Path, name: str, suffixes: str) -> None:
    layers = {"N.": OTHER, name: BEAUTY, "key.": OTHER}
    image = read_latlong(in_layers(tmp_path / "a.exr", layers, suffixes))
    np.testing.assert_array_equal(image.radiance, BEAUTY)


def test_a_part_whose_channels_repeat_its_name_is_the_beauty(tmp_path: Path) -> None:
    parts = []
    for name, values in (("ViewLayer.Normal", OTHER), ("ViewLayer.Combined", BEAUTY)):
        channels = {f"{name}.{c}": values[..., i].copy() for i, c in enumerate("RGB")}
        parts.append(OpenEXR.Part({"type": OpenEXR.scanlineimage}, channels, name))
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    image = read_latlong(tmp_path / "a.exr")
    np.testing.assert_array_equal(image.radiance, BEAUTY)
    assert image.header.layer.label == "ViewLayer.Combined"


ASKED = {
    "two beauties": (("beauty", "rgba"), r"has 2 layers and none is known .*\(beauty, rgba\)"),
    "no beauty": (("key", "fill", "N"), r"has 3 layers .*\(key, fill, N\).*--layer NAME"),
    "no light": (("N", "albedo"), r"its images hold no light .*\(N, albedo\).*--layer NAME"),
    "mattes": (("crypto00", "CryptoObject01"), r"its images hold no light"),
}


@pytest.mark.parametrize("name", ASKED)
def test_the_user_is_asked(tmp_path: Path, name: str) -> None:
    parts, message = ASKED[name]
    path = in_parts(tmp_path / "a.exr", *parts)
    with pytest.raises(InputError, match=message):
        read_latlong(path)
    read_latlong(path, reading=ReadOptions(layer=parts[0]))


def test_a_part_that_states_that_it_is_data_is_not_taken(tmp_path: Path) -> None:
    path = in_parts(tmp_path / "a.exr", "beauty", "rgba", beauty={"colorInteropID": "data"})
    assert read_header(path).layer.label == "rgba"


def test_a_name_in_another_case_selects_unless_two_do(tmp_path: Path) -> None:
    path = in_parts(tmp_path / "a.exr", "Key", "fill")
    assert read_header(path, ReadOptions(layer="KEY")).layer.label == "Key"
    path = in_parts(tmp_path / "b.exr", "Key", "key")
    assert read_header(path, ReadOptions(layer="key")).layer.label == "key"
    with pytest.raises(InputError, match=r"has 2 layers of that name in another case \(Key, key\)"):
        read_header(path, ReadOptions(layer="KEY"))


def test_a_sequence_keeps_its_layer_by_name(tmp_path: Path) -> None:
    for frame, order in ((1, ("C", "albedo")), (2, ("albedo", "C")), (3, ("albedo", "beauty"))):
        in_parts(tmp_path / f"a.{frame:04d}.exr", *order)
    sequence = open_sequence(tmp_path)
    for frame in (1, 2):
        np.testing.assert_array_equal(sequence.read(frame).radiance, BEAUTY)
    with pytest.raises(InputError, match=r"a\.0003\.exr: has no layer C; expected one of its"):
        sequence.read(3)


def test_a_plain_sequence_with_a_frame_of_layers_names_it(tmp_path: Path) -> None:
    image_files.write_rgb(tmp_path / "a.0001.exr", BEAUTY)
    in_layers(tmp_path / "a.0002.exr", {"beauty.": BEAUTY})
    message = r"frame 2 has layer beauty; expected layer R, G, B as frame 1 has\..*--layer"
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path).read(2)


LEFT, RIGHT = BEAUTY, OTHER


def stereo(path: Path, kind: str) -> Path:
    """Write an image for each eye, as views or as halves."""
    if kind == "parts":
        parts = [
            OpenEXR.Part(
                {"type": OpenEXR.scanlineimage, "view": view}, {"RGB": values}, f"rgba.{view}"
            )
            for view, values in (("left", LEFT), ("right", RIGHT))
        ]
        OpenEXR.File(parts).write(str(path))
    elif kind == "multiView":
        channels = {"RGB": LEFT, **{f"right.{c}": RIGHT[..., i] for i, c in enumerate("RGB")}}
        channels = {name: np.ascontiguousarray(values) for name, values in channels.items()}
        image_files.write(path, channels, multiView=["left", "right"])
    else:
        halves = np.concatenate([LEFT, RIGHT], axis=0 if kind == "over under" else 1)
        image_files.write_rgb(path, halves)
    return path


@pytest.mark.parametrize("kind", ["parts", "multiView", "over under", "side by side"])
def test_an_eye_is_read(tmp_path: Path, kind: str) -> None:
    path = stereo(tmp_path / "s.exr", kind)
    for eye, values in (("left", LEFT), ("right", RIGHT)):
        image = read_latlong(path, reading=ReadOptions(eye=eye))
        np.testing.assert_array_equal(image.radiance, values)
        assert image.header.eye == eye


@pytest.mark.parametrize("kind", ["parts", "multiView"])
def test_the_default_view_is_read_and_told(tmp_path: Path, kind: str) -> None:
    image = read_latlong(stereo(tmp_path / "s.exr", kind))
    np.testing.assert_array_equal(image.radiance, LEFT)
    assert image.header.eye == "left"


@pytest.mark.parametrize("kind", ["over under", "side by side"])
def test_halves_of_eyes_are_asked_for(tmp_path: Path, kind: str) -> None:
    with pytest.raises(InputError, match=r"stereo, one eye .*--eye left or --eye right"):
        read_latlong(stereo(tmp_path / "s.exr", kind))


def test_an_eye_of_a_mono_image_is_refused(tmp_path: Path) -> None:
    path = image_files.write_rgb(tmp_path / "m.exr", BEAUTY)
    with pytest.raises(InputError, match=r"m\.exr: has no left eye: it is 8 x 4 and has no views"):
        read_latlong(path, reading=ReadOptions(eye="left"))


def test_an_eye_that_is_not_there_is_refused(tmp_path: Path) -> None:
    parts = {"rgba.left": {"view": "left"}, "rgba.middle": {"view": "middle"}}
    path = in_parts(tmp_path / "a.exr", *parts, **parts)
    with pytest.raises(InputError, match=r"has no right eye; .* \(left, middle\)\. Check --eye"):
        read_latlong(path, reading=ReadOptions(eye="right"))


def test_half_of_a_radiance_file_is_cropped_upright(tmp_path: Path) -> None:
    pixels, upright = image_files.rgbe(8, 8)
    stored = np.ascontiguousarray(pixels[::-1])
    path = tmp_path / "s.hdr"
    path.write_bytes(image_files.hdr_bytes(stored, size="+Y 8 +X 8"))
    image = read_latlong(path, reading=ReadOptions(eye="right"))
    np.testing.assert_array_equal(image.radiance, upright[4:])
