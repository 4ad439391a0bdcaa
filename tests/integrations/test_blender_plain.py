# SPDX-License-Identifier: Apache-2.0
"""The parts of the Blender extension that need no Blender, against scipy, OpenColorIO and files."""

import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from asglight.images import ocio
from integrations.blender.plain import colours, command, image_files, tracks
from integrations.blender.plain.command import Images, Run
from integrations.blender.plain.tracks import TURN_MAX, Track


def test_a_track_is_linear_or_held_between_its_times() -> None:
    given = Track(np.array([1.0, 3.0]), np.array([[2.0, 0.0], [6.0, 1.0]]))
    when = np.array([0.0, 2.0, 9.0])
    assert given.at(when).tolist() == [[2, 0], [4, 0.5], [6, 1]]
    assert given.held_at(when).tolist() == [[2, 0], [2, 0], [6, 1]]


def test_what_never_changes_has_one_sample() -> None:
    assert tracks.track([1, 2, 3], lambda _: [0.1, 0.0]).is_constant
    assert not tracks.track([1, 2, 3], lambda t: [0.1, 1e-6 * t]).is_constant
    assert tracks.track([], lambda _: [5.0]).values.tolist() == [[5.0]]


def test_components_between_the_keys_are_the_even_turn() -> None:
    ends = Rotation.from_rotvec([[0, 0, 0], [0.4, 2.0, -1.0]])
    slerp = Slerp([0.0, 1.0], ends)
    between = tracks.times_between(np.array([0.0, 1.0]), ends.as_quat(scalar_first=True))
    times = np.array([0.0, *between, 1.0])
    keys = tracks.in_one_hemisphere(slerp(times).as_quat(scalar_first=True))
    dense = np.linspace(0, 1, 777)
    linear = Track(times, keys).at(dense)
    found = Rotation.from_quat(linear, scalar_first=True)
    off = np.degrees((found.inv() * slerp(dense)).magnitude())
    assert np.diff(times).max() * ends[1].magnitude() <= TURN_MAX * 1.001
    assert off.max() < 1.5e-5  # as TURN_MAX says
    assert tracks.times_between(np.array([0.0, 1.0]), np.array([[1.0, 0, 0, 0]] * 2)) == []


def test_quaternions_of_one_turn_keep_their_hemisphere() -> None:
    given = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0], [-0.8, 0.6, 0, 0], [0.8, -0.6, 0, 0]])
    found = tracks.in_one_hemisphere(given)
    assert found.tolist() == [[1, 0, 0, 0], [1, 0, 0, 0], [0.8, -0.6, 0, 0], [0.8, -0.6, 0, 0]]


@pytest.mark.parametrize("space", sorted(colours.CHROMATICITIES))
def test_colours_are_turned_as_opencolorio_turns_them(space: str) -> None:
    expected = ocio.converted(np.eye(3, dtype=np.float32)[None], space)[0]
    found = colours.between(space, colours.REC709)
    np.testing.assert_allclose(found.T, expected, atol=2e-5)  # its matrices have seven digits
    np.testing.assert_allclose(
        colours.between(colours.REC709, space) @ found, np.eye(3), atol=1e-12
    )


def test_numbered_images_are_played_where_they_lie(tmp_path: Path) -> None:
    paths = [f"{tmp_path}/sky.fill.{number}.exr" for number in (1001, 1004, 1005)]
    found = image_files.image_sequence(paths, tmp_path / "copies")
    assert found == image_files.ImageSequence(Path(paths[0]), (1001, 1004, 1005))
    assert not (tmp_path / "copies").exists()
    again = image_files.image_sequence([paths[1], paths[0], paths[1]], tmp_path / "copies")
    assert again.numbers == (1004, 1001, 1004)


def test_one_image_is_no_sequence(tmp_path: Path) -> None:
    path = f"{tmp_path}/sky.1001.exr"
    assert image_files.image_sequence([path, path], tmp_path) == image_files.ImageSequence(
        Path(path), ()
    )


@pytest.mark.parametrize("names", [("a.1.exr", "b.2.exr"), ("a.9.exr", "a.10.exr"), ("a", "b")])
def test_images_without_a_common_name_are_copied(tmp_path: Path, names: tuple[str, ...]) -> None:
    for name in names:
        (tmp_path / name).write_text(name)
    copies = tmp_path / "copies"
    found = image_files.image_sequence([str(tmp_path / name) for name in names], copies)
    assert found.numbers == (1, 2)
    assert [path.read_text() for path in sorted(copies.iterdir())] == list(names)


def test_images_of_a_package_are_unpacked(tmp_path: Path) -> None:
    package = tmp_path / "shot.usdz"
    with zipfile.ZipFile(package, "w") as written:
        for number in (1001, 1002):
            written.writestr(f"dome/sky.{number}.exr", str(number))
    images = [f"{package}[dome/sky.{number}.exr]" for number in (1001, 1002)]
    found = image_files.image_sequence(images, tmp_path / "copies")
    assert found == image_files.ImageSequence(tmp_path / "copies/sky.1001.exr", (1001, 1002))
    assert sorted(p.name for p in (tmp_path / "copies").iterdir()) == [
        "sky.1001.exr",
        "sky.1002.exr",
    ]
    assert (tmp_path / "copies/sky.1002.exr").read_text() == "1002"


def test_a_fit_is_asked_for_as_the_command_takes_it() -> None:
    images = Images(command.pattern_of("/set/sky.1001.exr"), 1001, 1048)
    line = command.fit_line("asglight", images, "/out/a.usdc", 24.0, "auto")
    asked = "asglight fit /set/sky.####.exr -o /out/a.usdc --fps 24 --frames 1001-1048 --keys auto"
    assert line == asked.split()
    assert command.fit_line("asglight", Images("a.exr"), "b", 24000 / 1001, "")[-1].startswith(
        "23.97"
    )
    with pytest.raises(ValueError, match=r"sky.exr: has no number; expected an image of a seq"):
        command.pattern_of("/set/sky.exr")


def test_a_sequence_shows_the_files_that_blender_counts() -> None:
    # Blender's manual: file = frame - start + 1 + offset, held before the first and after the last
    assert command.shown_files((1, 48), (1, 48, 1000)) == (1001, 1048)
    assert command.shown_files((1001, 1048), (1001, 48, 1000)) == (1001, 1048)
    assert command.shown_files((1, 100), (11, 20, 0)) == (1, 20)


def test_progress_never_falls() -> None:
    share = command.share_of("frame 1012 (12/48)  loss 0.02", 0.0)
    assert share == 0.25
    assert command.share_of("refined 1/48", share) == share
    assert command.share_of("asglight: a notice", share) == share


def test_a_command_is_followed_to_its_end() -> None:
    said = "import sys; print('frame 1 (1/2)', file=sys.stderr); sys.exit('sky.exr: no such file')"
    run = Run([sys.executable, "-c", said])
    assert run.wait() == 1
    assert (run.share, run.line) == (0.5, "sky.exr: no such file")


def test_a_command_ends_when_it_is_cancelled() -> None:
    started = time.monotonic()
    run = Run([sys.executable, "-c", "import time; time.sleep(60)"])
    assert run.poll() is None
    run.cancel()
    assert run.poll() not in (None, 0)
    assert time.monotonic() - started < 30


def test_blender_s_python_is_not_led_into_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONHOME", "/blender")
    assert "PYTHONHOME" not in command.environment()


def test_keys_are_asked_for_where_the_command_knows_them(tmp_path: Path) -> None:
    for name, said in (("old", "--lobes N"), ("new", "--lobes N --keys auto")):
        script = tmp_path / name
        script.write_text(f"#!/bin/sh\necho '{said}'\n")
        script.chmod(0o755)
    assert command.has_keys(str(tmp_path / "new"))
    assert not command.has_keys(str(tmp_path / "old"))
