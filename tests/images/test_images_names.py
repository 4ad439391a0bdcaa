# SPDX-License-Identifier: Apache-2.0
"""Names of frames as they come: patterns, cases, fractions, folders in the place of files."""

import os
import unicodedata
from pathlib import Path

import pytest

from asglight.errors import InputError
from asglight.images import open_sequence
from asglight.shots.settings import check_output
from asglight.usd.options import check_stage_name


def files(folder: Path, *names: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def refused(source: Path) -> str:
    with pytest.raises(InputError) as caught:
        open_sequence(source)
    assert "\n" not in str(caught.value)
    return str(caught.value)


PATTERNS = {
    "sky@2x.####.exr": "sky@2x.{:04d}.exr",
    "shot#3.####.exr": "shot#3.{:04d}.exr",
    "shot#3.@@@@.exr": "shot#3.{:04d}.exr",
    "shot#3.1-2#.exr": "shot#3.{:04d}.exr",
    "a#b@c%d.%04d.exr": "a#b@c%d.{:04d}.exr",
    "100%.####.exr": "100%.{:04d}.exr",
    "100%d.####.exr": "100%d.{:04d}.exr",
    "sky$F.$F4.exr": "sky$F.{:04d}.exr",
    "sky[1].####.exr": "sky[1].{:04d}.exr",
    "sky{a,b}.####.exr": "sky{{a,b}}.{:04d}.exr",
    "sky (1).####.exr": "sky (1).{:04d}.exr",
    "größe 日本.####.exr": "größe 日本.{:04d}.exr",
    "a\nb.####.exr": "a\nb.{:04d}.exr",
    "-sky.####.exr": "-sky.{:04d}.exr",
    "sky*?.####.exr": "sky*?.{:04d}.exr",
    "back\\slash.####.exr": "back\\slash.{:04d}.exr",
    "####.exr": "{:04d}.exr",
    "sky.####.left#.exr": "sky.{:04d}.left#.exr",
    "v2_1-2#.exr": "v2_{:04d}.exr",
    "take10-#.exr": "take10-{:04d}.exr",
    "####": "{:04d}",
}


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_pattern_is_read_where_files_agree_with_it(pattern, tmp_path):
    folder = files(tmp_path / "in", *(PATTERNS[pattern].format(frame) for frame in (1, 2)))
    found = open_sequence(folder / pattern)
    assert found.frames == (1, 2)
    assert [found.path(frame).name for frame in (1, 2)] == [
        PATTERNS[pattern].format(frame) for frame in (1, 2)
    ]


def test_the_last_place_that_files_agree_with_is_the_frames(tmp_path):
    folder = files(tmp_path / "in", "a1.b1.exr", "a1.b2.exr", "a#.b7.exr")
    assert open_sequence(folder / "a#.b#.exr").frames == (7,)


@pytest.mark.parametrize("source", ["", "sky.####.exr", "sky.####.EXR", "sky.1001-1003#.exr"])
def test_case_of_extensions_makes_no_difference(source, tmp_path):
    folder = files(tmp_path / "in", "sky.1001.exr", "sky.1002.EXR", "sky.1003.Exr")
    found = open_sequence(folder / source)
    assert found.frames == (1001, 1002, 1003)
    assert found.path(1002).name == "sky.1002.EXR"


def test_a_frame_in_both_cases_is_there_twice(tmp_path):
    folder = files(tmp_path / "in", "sky.1001.exr", "sky.1001.EXR", "sky.1002.exr")
    assert "frame 1001 is there twice (sky.1001.EXR, sky.1001.exr)" in refused(folder)


def test_accents_are_the_same_composed_and_apart(tmp_path):
    composed, apart = (unicodedata.normalize(form, "größe") for form in ("NFC", "NFD"))
    folder = files(tmp_path / "in", f"{apart}.1001.exr", f"{composed}.1002.exr")
    for source in ("", f"{apart}.####.exr", f"{composed}.####.exr"):
        assert open_sequence(folder / source).frames == (1001, 1002)


def test_numbers_of_any_width_and_sign_are_frames(tmp_path):
    folder = files(tmp_path / "in", *(f"sky.{n}.exr" for n in ("-0002", "-1", "0", "1", "0002")))
    for source in ("", "sky.#.exr", "sky.-2-2#.exr"):
        assert open_sequence(folder / source).frames == (-2, -1, 0, 1, 2)


ARABIC = "\u0661", "\u0662", "\u0663"


def test_digits_of_other_scripts_are_letters(tmp_path):
    one, two, three = ARABIC
    folder = files(tmp_path / "in", f"sky.{one}.exr", f"sky.{two}.exr")
    assert f"holds 2 images or sequences (sky.{one}.exr, sky.{two}.exr)" in refused(folder)
    files(folder, f"shot{one}.1001.exr", f"shot{one}.1002.exr", f"shot{one}.{three}.exr")
    for source in (f"shot{one}.####.exr", f"shot{one}.1001-1002#.exr"):
        assert open_sequence(folder / source).frames == (1001, 1002)
    for source in (f"shot{one}.{one}-{two}#.exr", f"sky.{one}-{two}#.exr"):
        assert "no file is named" in refused(folder / source)


def test_digits_of_other_scripts_are_no_frame_beside_others(tmp_path):
    folder = files(tmp_path / "in", "sky.1.exr", "sky.2.exr", f"sky.{ARABIC[2]}.exr")
    assert f"holds 2 images or sequences (sky.####.exr 1-2, sky.{ARABIC[2]}.exr)" in refused(folder)
    still = files(tmp_path / "still", f"sky.{ARABIC[1]}.exr") / f"sky.{ARABIC[1]}.exr"
    assert open_sequence(still).frames == (1,)


def test_several_sequences_are_named_with_the_way_to_choose(tmp_path):
    folder = files(tmp_path / "in", "a b.1.exr", "a b.2.exr", "c.1.exr", "still.hdr")
    message = refused(folder)
    assert "holds 3 images or sequences (a b.####.exr 1-2, c.1.exr, still.hdr)" in message
    assert message.endswith(f"Name the one to use, such as {folder}/a b.####.exr.")
    assert open_sequence(folder / "a b.####.exr").frames == (1, 2)


@pytest.mark.parametrize(
    "names",
    [
        ("sky.1001.exr", "sky.1001.5.exr", "sky.1002.exr"),
        ("sky.1001.0.exr", "sky.1001.5.exr", "sky.1002.0.exr", "sky.1002.5.exr"),
        ("sky.1001.25.exr", "sky.1002.25.EXR"),
    ],
)
def test_subframes_are_refused(names, tmp_path):
    folder = files(tmp_path / "in", *names)
    message = refused(folder)
    assert "is between two frames; expected whole frames. Keep subframes in a folder" in message
    if "sky.1001.exr" in names:
        assert refused(folder / "sky.####.exr").startswith(f"{folder}: sky.1001.5.exr is between")


def test_a_number_before_the_frame_is_no_fraction(tmp_path):
    folder = files(tmp_path / "in", "shot.2024.1001.exr", "shot.2024.1002.exr")
    assert open_sequence(folder).frames == (1001, 1002)
    files(folder, "shot.1.exr", "shot.2.exr")
    assert open_sequence(folder / "shot.####.exr").frames == (1, 2)


def test_a_folder_named_as_a_frame_is_none(tmp_path):
    folder = files(tmp_path / "in", "sky.1001.exr", "sky.1003.exr")
    (folder / "sky.1002.exr").mkdir()
    assert open_sequence(folder / "sky.####.exr", missing="hold").frames == (1001, 1003)
    assert "1 frame missing (1002)" in refused(folder / "sky.1001-1003#.exr")
    assert "holds no image (nothing)" in refused(folder / "sky.1002.exr")


def test_loops_of_links_and_closed_folders_are_one_line(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert "is not there" in refused(tmp_path / "loop")
    assert "there is no folder" in refused(tmp_path / "loop" / "sky.####.exr")
    assert "File name too long" in refused(tmp_path / ("x" * 300 + ".exr"))


@pytest.mark.skipif(os.sep != "/", reason="a backslash separates folders here")
def test_backslashes_are_told_of_before_anything_is_fitted(tmp_path):
    message = refused(tmp_path / "renders\\sky.####.exr")
    assert message.endswith(f"separates no folders here: write {tmp_path}/renders/sky.####.exr.")
    for check in (check_output, check_stage_name):
        with pytest.raises(InputError, match=r"has a backslash, .* Write .*renders/shot\.usda\.$"):
            check(tmp_path / "renders\\shot.usda")


def test_a_name_that_usd_takes_for_arguments_is_refused(tmp_path):
    with pytest.raises(InputError, match="has :SDF_FORMAT_ARGS: in its name"):
        check_output(tmp_path / "a:SDF_FORMAT_ARGS:b=c.usda")
