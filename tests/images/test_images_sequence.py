# SPDX-License-Identifier: Apache-2.0
"""A sequence is found however it is written down, and its gaps are never silent."""

import gc
import re
import weakref
from collections.abc import Iterable
from pathlib import Path

import fileseq
import image_files
import numpy as np
import pytest
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from places import SHARED

from asglight.errors import InputError
from asglight.images import open_sequence
from asglight.images.frame_files import frame_set, ranges
from asglight.images.options import ReadOptions


def frames_on_disk(
    folder: Path, frames: Iterable[int], *, name: str = "sky.{:04d}.exr", height: int = 2
) -> Path:
    """Write constant images whose value is their frame number plus 100."""
    for frame in frames:
        image_files.constant(folder / name.format(frame), frame + 100, height)
    return folder


def value(image: object) -> float:
    radiance = image.radiance  # pyright: ignore[reportAttributeAccessIssue]
    assert bool((radiance == radiance[0, 0, 0]).all())
    return radiance[0, 0, 0].item()


@pytest.mark.parametrize(
    "pattern",
    [
        "sky.####.exr",
        "sky.#.exr",
        "sky.%04d.exr",
        "sky.%d.exr",
        "sky.@@@@.exr",
        "sky.$F4.exr",
        "sky.1001-1004#.exr",
        "sky.1001-1004####.exr",
        "sky.1001-1004@@@@.exr",
        "sky.1001,1002,1003-1004#.exr",
        "",
    ],
)
def test_every_way_of_writing_a_sequence_finds_its_frames(tmp_path: Path, pattern: str) -> None:
    frames_on_disk(tmp_path, range(1001, 1005))
    sequence = open_sequence(tmp_path / pattern)
    assert sequence.frames == (1001, 1002, 1003, 1004)
    assert sequence.missing_frames == ()
    assert len(sequence) == 4
    assert sequence.name == "sky"
    assert sequence.pattern == str(tmp_path / "sky.####.exr")
    assert sequence.path(1003) == tmp_path / "sky.1003.exr"
    assert [value(image) for image in sequence] == [1101, 1102, 1103, 1104]


def test_pattern_may_be_relative_and_a_string(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames_on_disk(tmp_path, (1, 2))
    monkeypatch.chdir(tmp_path)
    assert open_sequence("sky.####.exr").frames == (1, 2)


def test_range_with_a_step_has_no_missing_frames(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, range(1001, 1010))
    assert open_sequence(tmp_path / "sky.1001-1009x2#.exr").frames == (1001, 1003, 1005, 1007, 1009)


def test_sequence_on_twos_has_no_missing_frames(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1001, 1003, 1005, 1007))
    assert open_sequence(tmp_path).missing_frames == ()


def test_gap_in_a_sequence_on_twos_is_missing(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1001, 1003, 1007))
    with pytest.raises(InputError, match=r"sky: 1 frame missing \(1005\); .* of 1001-1007\."):
        open_sequence(tmp_path)


@pytest.mark.parametrize("pattern", ["neg.-2-1#.exr", "neg.#.exr", "neg.%04d.exr", ""])
def test_negative_frames_are_found(tmp_path: Path, pattern: str) -> None:
    frames_on_disk(tmp_path, range(-2, 2), name="neg.{:04d}.exr")
    sequence = open_sequence(tmp_path / pattern)
    assert sequence.frames == (-2, -1, 0, 1)
    assert sequence.pattern == str(tmp_path / "neg.###.exr")
    assert value(sequence.read(-2)) == 98


def test_hyphen_before_the_number_is_no_minus(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1, 2), name="sky-{:04d}.exr")
    for source in (tmp_path, tmp_path / "sky-####.exr"):
        sequence = open_sequence(source)
        assert (sequence.frames, sequence.name) == ((1, 2), "sky")


def test_frames_without_padding_are_in_order_of_their_numbers(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, range(8, 12), name="sky.{}.exr")
    assert open_sequence(tmp_path).frames == (8, 9, 10, 11)


def test_names_of_digits_only_are_a_sequence_named_after_the_folder(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1, 2), name="{:04d}.exr")
    sequence = open_sequence(tmp_path)
    assert (sequence.frames, sequence.name) == ((1, 2), tmp_path.name)


def test_hidden_and_other_files_in_a_folder_are_passed_over(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1, 2))
    for name in ("._sky.0001.exr", "README.md", "sky.0003.exr.tmp"):
        (tmp_path / name).write_text("x")
    assert open_sequence(tmp_path).frames == (1, 2)


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("sky.1007.exr", 1007),
        ("sky.-005.exr", -5),
        ("0042.exr", 42),
        ("day_v003.1001.exr", 1001),
        ("sky.exr", 1),
        ("v02.exr", 1),
        ("hdri_4k.exr", 1),
        ("venice_2048.exr", 1),
        ("sky.####.exr", 1),
    ],
)
def test_still_has_the_frame_in_its_name_or_one(tmp_path: Path, name: str, frame: int) -> None:
    path = image_files.constant(tmp_path / name, 3, 2)
    for source in (path, tmp_path):
        sequence = open_sequence(source)
        assert sequence.frames == (frame,)
        assert sequence.pattern == str(path)
        assert value(sequence.read(frame)) == 3


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ("1001-1004", (1001, 1002, 1003, 1004)),
        ("1001-1004x2", (1001, 1003)),
        ("1004,1001", (1001, 1004)),
        ("1003-1001", (1001, 1002, 1003)),
        ("1002", (1002,)),
    ],
)
def test_frames_are_chosen(tmp_path: Path, frames: str, expected: tuple[int, ...]) -> None:
    frames_on_disk(tmp_path, range(1001, 1006))
    assert open_sequence(tmp_path, frames=frames).frames == expected


@pytest.mark.thorough
@given(st.sets(st.integers(-50, 2000), min_size=1, max_size=30))
@settings(max_examples=tries(50), deadline=None)
def test_frame_sets_agree_with_fileseq(frames: set[int]) -> None:
    text = fileseq.framesToFrameRange(sorted(frames))  # pyright: ignore[reportPrivateImportUsage]
    assert frame_set(text, "frames") == tuple(sorted(frames))


def test_long_lists_of_frames_are_shortened() -> None:
    assert ranges((1017, 1018, 1040)) == "1017, 1018, 1040"
    assert ranges(tuple(range(1, 21))) == "1-20"
    assert ranges([n * n for n in range(20)]).endswith(" more")


def gappy(folder: Path) -> Path:
    return frames_on_disk(folder, (1001, 1002, 1003, 1007, 1008))


def test_missing_frames_are_named_and_counted(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        open_sequence(gappy(tmp_path))
    assert str(caught.value) == (
        "sky: 3 frames missing (1004, 1005, 1006); expected every frame of 1001-1008. "
        "Use --missing hold or --missing interpolate, or choose --frames."
    )


def test_missing_frame_holds_the_one_before(tmp_path: Path) -> None:
    sequence = open_sequence(gappy(tmp_path), missing="hold")
    assert sequence.missing_frames == (1004, 1005, 1006)
    assert [value(image) for image in sequence] == [
        *(1101, 1102, 1103),
        *(1103, 1103, 1103),
        *(1107, 1108),
    ]
    image = sequence.read(1005)
    assert image.path == sequence.path(1005) == tmp_path / "sky.1003.exr"
    assert image.repair.sentence() == "frame missing, held from 1003"
    assert not image.repair.is_clean
    assert sequence.read(1003).repair.is_clean


def test_missing_frame_is_interpolated_linearly(tmp_path: Path) -> None:
    sequence = open_sequence(gappy(tmp_path), missing="interpolate")
    values = [value(image) for image in sequence]
    # 1103 to 1107 in quarters: exact in float32
    assert values == [1101, 1102, 1103, 1104, 1105, 1106, 1107, 1108]
    image = sequence.read(1004)
    assert image.repair.sentence() == "frame missing, interpolated between 1003 and 1007"


@pytest.mark.parametrize("missing", ["hold", "interpolate"])
def test_frames_beyond_the_ends_hold_the_end(tmp_path: Path, missing: str) -> None:
    frames_on_disk(tmp_path, (5, 6))
    sequence = open_sequence(tmp_path, frames="3-8", missing=missing)  # pyright: ignore[reportArgumentType]
    assert [value(image) for image in sequence] == [105, 105, 105, 106, 106, 106]
    assert sequence.read(3).repair.filled_from == (5,)
    assert sequence.read(8).repair.filled_from == (6,)


def test_frame_between_the_chosen_ones_still_stands_in(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (5, 6, 9))
    assert value(open_sequence(tmp_path, frames="5,7,9", missing="hold").read(7)) == 106


def test_interpolated_frame_reports_the_repairs_of_both_neighbours(tmp_path: Path) -> None:
    for frame in (1, 3):
        values = np.ones((4, 8, 3), dtype=np.float32)
        values[0, :frame] = np.nan
        image_files.write_rgb(tmp_path / f"sky.{frame:04d}.exr", values)
    sequence = open_sequence(tmp_path, frames="1-3", missing="interpolate")
    repair = sequence.read(2).repair
    assert (repair.nonfinite, repair.first, repair.filled_from) == (4, (0, 0), (1, 3))


def test_frames_of_another_size_are_named(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1, 2))
    image_files.constant(tmp_path / "sky.0003.exr", 1, 4)
    sequence = open_sequence(tmp_path)
    assert value(sequence.read(2)) == 102
    with pytest.raises(
        InputError, match=r"sky\.0003\.exr: frame 3 is 8 x 4; expected 4 x 2 as frame 1 is"
    ):
        sequence.read(3)


def test_frames_of_several_sizes_are_reduced_to_one(tmp_path: Path) -> None:
    for frame, height in ((1, 8), (2, 4), (3, 16)):
        image_files.constant(tmp_path / f"sky.{frame:04d}.exr", frame, height)
    sequence = open_sequence(tmp_path, height=4)
    assert [image.radiance.shape for image in sequence] == [(4, 8, 3)] * 3
    # the weights of the average sum to 1 in float32
    assert [image.radiance.mean().item() for image in sequence] == pytest.approx([1, 2, 3])


def test_frame_smaller_than_the_height_is_not_enlarged_in_silence(tmp_path: Path) -> None:
    for frame, height in ((1, 8), (2, 2)):
        image_files.constant(tmp_path / f"sky.{frame:04d}.exr", frame, height)
    with pytest.raises(InputError, match=r"frame 2 is 4 x 2; expected 8 x 4 .*resize it to match"):
        list(open_sequence(tmp_path, height=4))


def test_opening_reads_no_pixels_and_iteration_keeps_none(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, range(1, 6))
    (tmp_path / "sky.0005.exr").write_text("not an image, and not read before its turn")
    seen = []
    gc.freeze()  # what was there before is not looked through
    try:
        for _, image in zip(range(4), open_sequence(tmp_path), strict=False):
            gc.collect()
            assert all(reference() is None for reference in seen)
            seen.append(weakref.ref(image.radiance))
            del image
    finally:
        gc.unfreeze()
    assert len(seen) == 4


def test_layer_is_handed_on(tmp_path: Path) -> None:
    values = image_files.ramp(2, 4)
    channels = {f"{p}.{c}": values[..., i].copy() for i, c in enumerate("RGB") for p in "ab"}
    image_files.write(tmp_path / "sky.0001.exr", channels)
    image = open_sequence(tmp_path, reading=ReadOptions("b")).read(1)
    np.testing.assert_array_equal(image.radiance.numpy(), values)


def test_real_sequence_is_found() -> None:
    folder = SHARED / "sequences" / "day"
    if not folder.is_dir():
        pytest.skip(f"test data is not here: {folder}")
    sequence = open_sequence(folder / "day.%04d.exr", height=16)
    assert sequence.frames == tuple(range(1001, 1049))
    assert sequence.read(1024).radiance.shape == (16, 32, 3)


REFUSED: dict[str, tuple[str, str, dict[str, object]]] = {
    "no path": ("", "input: is no path", {}),
    "null byte": ("a\0.exr", "input: is no path", {}),
    "no folder": ("none/sky.####.exr", r"sky\.####\.exr: there is no folder .*none; expected", {}),
    "wrong base": (
        "sea.####.exr",
        r"sea\.####\.exr: no file is named sea\.<frame>\.exr; .* Nearest in that folder: "
        r"sky\.####\.exr 1001-1003\.$",
        {},
    ),
    "wrong extension": ("sky.####.hdr", r"no file is named sky\.<frame>\.hdr; .*sky\.####", {}),
    "absent frame": ("sky.1009.exr", r"sky\.1009\.exr: is not there; .*sky\.####\.exr 1001", {}),
    "no pattern": ("sky.*.exr", r"sky\.\*\.exr: is not there; expected a file, a folder or", {}),
    "step of zero": ("sky.1-5x0#.exr", r"sky\.1-5x0#\.exr: is no pattern", {}),
    "open range": ("sky.1-#.exr", r"sky\.1-#\.exr: is no pattern", {}),
    "none of the range": (
        "sky.1-5#.exr",
        r"sky: has none of the frames 1, 2, 3, 4, 5; .* 1001",
        {},
    ),
    "past the end": ("sky.1001-1005#.exr", r"sky: 2 frames missing \(1004, 1005\)", {}),
    "no frames": ("sky.####.exr", "frames: nothing; expected whole frames", {"frames": ""}),
    "words": ("sky.####.exr", "frames: all; expected whole frames", {"frames": "all"}),
    "half frames": ("sky.####.exr", "frames: 1.5-3; expected whole", {"frames": "1.5-3"}),
    "too many": ("sky.####.exr", "too many", {"frames": "1-99999999999"}),
    "outside the pattern": (
        "sky.1001-1002#.exr",
        "frames: 1003; expected only frames of the pattern, 1001, 1002",
        {"frames": "1002-1003"},
    ),
    "still": ("lone/lone.exr", "lone: has none of the frames 5, 6; .* 1,", {"frames": "5-6"}),
    "choice": ("sky.####.exr", "missing: skip; expected one of error, hold", {"missing": "skip"}),
    "height": ("sky.####.exr", "height: -1 rows; expected 1 or more", {"height": -1}),
    "several": ("several", r"several: holds 3 .*\(a\.exr, b\.exr, c\.####\.exr 1-2\); .*one\.", {}),
    "nothing": ("bare", r"bare: holds no image \(nothing\); expected", {}),
    "no image": ("other", r"other: holds no image \(notes\.txt\); expected", {}),
    "nothing there": ("bare/sky.####.exr", r"\. That folder holds no image\.$", {}),
    "nothing near": ("lone/x.hdr", r"\. That folder holds lone\.exr\.$", {}),
    "twice": ("twice", r"twice: frame 1 is there twice \(s\.0001\.exr, s\.1\.exr\)", {}),
    "date": ("date", "frames: run from 1 to 20260101; expected fewer than 100000", {}),
}


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of sources that cannot be opened; most of its files stay empty."""
    folder = frames_on_disk(tmp_path_factory.mktemp("shelf"), (1001, 1002, 1003))
    names = {
        "lone": ["lone.exr"],
        "several": ["a.exr", "b.exr", "c.0001.exr", "c.0002.exr"],
        "bare": [],
        "other": ["notes.txt"],
        "twice": ["s.1.exr", "s.0001.exr", "s.2.exr"],
        "date": ["s.1.exr", "s.2.exr", "s.20260101.exr"],
    }
    for inside, files in names.items():
        (folder / inside).mkdir()
        for name in files:
            (folder / inside / name).touch()
    return folder


@pytest.mark.parametrize("case", REFUSED)
def test_source_is_refused_in_one_line(shelf: Path, case: str) -> None:
    source, message, options = REFUSED[case]
    path = f"{shelf}/{source}" if source else ""
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(path, **options)  # pyright: ignore[reportArgumentType]
    assert str(caught.value).isprintable()
    assert re.search("; expected ", str(caught.value))


def test_frame_that_is_not_of_the_sequence_is_refused(tmp_path: Path) -> None:
    sequence = open_sequence(frames_on_disk(tmp_path, (1, 2)))
    with pytest.raises(InputError, match="sky: has no frame 7; expected one of 1, 2"):
        sequence.read(7)


def test_damaged_frame_is_named_when_it_is_read(tmp_path: Path) -> None:
    frames_on_disk(tmp_path, (1, 2))
    (tmp_path / "sky.0002.exr").write_bytes(b"")
    with pytest.raises(InputError, match=r"sky\.0002\.exr: is empty"):
        list(open_sequence(tmp_path))


def test_frame_that_vanishes_is_named_when_it_is_read(tmp_path: Path) -> None:
    sequence = open_sequence(frames_on_disk(tmp_path, (1, 2)))
    (tmp_path / "sky.0002.exr").unlink()
    with pytest.raises(InputError, match=r"sky\.0002\.exr: cannot be opened"):
        sequence.read(2)
