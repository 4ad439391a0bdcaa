# SPDX-License-Identifier: Apache-2.0
"""What a layer of edits refuses, in one line, and leaves as it was."""

import os
import sys
from dataclasses import replace

import pytest
from edited_stages import FRAMES, changed, fit
from full_disk import full_beyond
from usd_tracks import contents, moving, still

from asglight.errors import InputError
from asglight.lobes import Form
from asglight.usd import read_usd, write_edit_layer, write_usd


def refused(*arguments) -> str:
    with pytest.raises(InputError) as caught:
        write_edit_layer(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_files_of_the_stage_are_never_replaced(tmp_path):
    path, tracks = fit(tmp_path)
    after = changed(tracks, 0, slice(None), "turn")
    write_edit_layer(tmp_path / "edit.usda", path, after, [0])
    write_edit_layer(tmp_path / "edit.usda", path, after, [0])  # a layer may be written again
    path.rename(tmp_path / "shot.usda")  # whose images still lie in fit_dome
    (tmp_path / "edit.usda").unlink()
    write_edit_layer(tmp_path / "edit.usda", tmp_path / "shot.usda", after, [0])
    (tmp_path / "link.usda").symlink_to(tmp_path / "shot.usda")
    before = contents(tmp_path)
    for source, target in [
        ("shot.usda", "shot.usda"),
        ("shot.usda", "shot.usdc"),
        ("shot.usda", "fit.usda"),
        ("shot.usda", "link.usda"),
        ("edit.usda", "shot.usda"),
        ("edit.usda", "edit.usd"),
    ]:
        tracks = read_usd(tmp_path / source)
        message = refused(tmp_path / target, tmp_path / source, tracks, [0])
        assert message.startswith(f"{tmp_path / target}: would replace files of {tmp_path}/")
        assert message.endswith(", which is edited; expected another name or folder.")
    assert contents(tmp_path) == before


def test_tracks_of_another_stage_are_refused(tmp_path):
    path, tracks = fit(tmp_path)
    expected = "does not hold the lobes that were edited; expected the stage as it was read"
    for other in (
        replace(tracks, fps=25.0),
        moving(FRAMES, form=Form.SG),
        moving(FRAMES, lobes=4),
        still(),
        changed(tracks, 1, slice(None), "turn"),
    ):
        assert expected in refused(tmp_path / "edit.usda", path, other, [0])
    with pytest.raises(ValueError, match=r"edited: \[3\] of 3 lobes"):
        write_edit_layer(tmp_path / "edit.usda", path, tracks, [3])
    assert not (tmp_path / "edit.usda").exists()


def test_what_cannot_be_written_is_named(tmp_path):
    path, tracks = fit(tmp_path)
    assert "no such file" in refused(tmp_path / "edit.usda", tmp_path / "no.usda", tracks, [])
    assert "extension '.txt'" in refused(tmp_path / "edit.txt", path, tracks, [])
    message = refused(tmp_path / "edit.usdz", path, tracks, [])
    assert "extension '.usdz'; expected .usda, .usdc or .usd." in message
    tracks.lobes.sharpness[0, 0, 0] = -1
    assert "sharpness of lobe 0" in refused(tmp_path / "edit.usda", path, tracks, [0])


@pytest.mark.skipif(not os.path.isdir("/sys"), reason="needs a folder that even root cannot write")
def test_a_folder_without_permission_is_named(tmp_path):
    path, tracks = fit(tmp_path)
    message = refused("/sys/edit.usda", path, changed(tracks, 0, slice(1), "turn"), [0])
    assert message.startswith("/sys/edit.usda: cannot be written (")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_leaves_everything_as_it_was(tmp_path):
    """The disk is full at the layer in one folder, at an image of the dome in the other."""
    folders = [tmp_path / "layer", tmp_path / "image"]
    for folder, height in zip(folders, (2, 64), strict=True):
        folder.mkdir()
        write_usd(
            moving(range(10)), folder / "fit.usda", representations=("dome",), dome_height=height
        )
        after = changed(read_usd(folder / "fit.usda"), 0, slice(None), "turn")
        write_edit_layer(folder / "edit.usda", folder / "fit.usda", after, [0])
    before = contents(tmp_path)
    for folder, named in zip(folders, ("edit.usda", "edit_dome/edit.0000.exr"), strict=True):
        after = changed(read_usd(folder / "fit.usda"), 0, slice(None), "brighten")
        with full_beyond(1200):
            message = refused(folder / "edit.usda", folder / "fit.usda", after, [0])
        assert message.startswith(f"{folder}/{named}: cannot be written")
    assert contents(tmp_path) == before
