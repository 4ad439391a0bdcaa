# SPDX-License-Identifier: Apache-2.0
"""What the real window opens: by its browser, by what is dropped, and what cannot be read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
from imgui_bundle import imgui
from windows import Drive, Driven, wait_for

from asglight.images import write_exr
from asglight.images.frame_files import sequence_of
from asglight.viewer.io.browsing import Kind, listed
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.session import no_lobes

CTRL = int(imgui.Key.mod_ctrl)

pytestmark = pytest.mark.usefixtures("no_system_dialog")


def sequence(folder: Path, frames: tuple[int, ...] = (1001, 1002, 1004)) -> Path:
    folder.mkdir(exist_ok=True)
    for frame in frames:
        write_exr(folder / f"sky.{frame}.exr", torch.full((8, 16, 3), frame / 1000))
    return folder


def test_the_browser_lists_a_sequence_as_one_and_opens_it(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    sequence(stage.parent / "plates")

    def script(test: Any, driven: Driven) -> None:
        test.key_press(CTRL | int(imgui.Key.o))
        test.yield_(2)
        io = imgui.get_io()  # a slow machine is no slow hand
        io.mouse_double_click_time, io.mouse_single_click_delay = 60, 61
        test.item_double_click("**/##entry0")
        test.yield_(2)
        browser = driven.window.documents.browser
        assert browser is not None
        assert browser.folder.name == "plates"
        test.item_double_click("**/##entry0")
        wait_for(test, driven, "Opened sky.####.exr.")
        assert driven.state.references is not None
        assert driven.state.references.frames == (1001, 1002, 1004)

    drive_stage(script)


def test_escape_leaves_the_browser_and_opens_nothing(drive_stage: Callable[..., None]) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(1)
        test.key_press(CTRL | int(imgui.Key.o))
        test.yield_(2)
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        assert driven.window.documents.browser is None
        assert driven.state.selection.lobe == 1

    drive_stage(script)


def test_a_folder_that_cannot_be_listed_leaves_its_reason(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"gone: cannot be listed \(No such file.*Check the path"):
        listed(tmp_path / "gone")


def test_a_folder_lists_folders_stages_sequences_and_stills(stage: Path) -> None:
    folder = sequence(stage.parent)
    write_exr(folder / "still.exr", torch.zeros(4, 8, 3))
    (folder / ".hidden").mkdir()
    (folder / "plates").mkdir()
    (folder / "notes.txt").write_text("x")
    found = [(entry.title, entry.kind) for entry in listed(folder)]
    assert found == [
        ("plates/", Kind.FOLDER),
        ("shot.usda", Kind.STAGE),
        ("sky.####.exr 1001-1004", Kind.SEQUENCE),
        ("still.exr", Kind.IMAGE),
    ]
    assert sequence_of(folder / "sky.1002.exr") == str(folder / "sky.####.exr")
    assert sequence_of(folder / "still.exr") is None
    assert sequence_of(folder / "gone.exr") is None


def test_one_image_of_a_sequence_opens_the_shots_sequence(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    folder = sequence(stage.parent / "plates")

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped([str(folder / "sky.1001.exr")])
        wait_for(test, driven, "Opened sky.1001.exr.")
        references = driven.state.references
        assert references is not None
        for frame in (1001, 1004):  # frame 1004 is compared with its own image
            np.testing.assert_allclose(references.wait(frame, 10), frame / 1000, rtol=1e-3)

    drive_stage(script)


def test_a_still_that_is_held_says_which_image_it_is(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    folder = sequence(stage.parent / "plates", (1001,))

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped([str(folder / "sky.1001.exr")])
        wait_for(test, driven, "Opened sky.1001.exr.")
        held = "Its one image, sky 1001, is held for every frame."
        assert driven.state.message.endswith(held)
        references = driven.state.references
        assert references is not None
        assert references.label(1001) == ""
        assert references.label(1002) == "sky 1001 held"

    drive_stage(script)


def test_what_cannot_be_read_leaves_the_good_reference(
    drive_stage: Callable[..., None], tmp_path: Path
) -> None:
    names = ("README.md", "shot.png", "cut.exr")
    whole = tmp_path / "whole.exr"
    write_exr(whole, torch.rand(32, 64, 3))
    for name in names:
        data = whole.read_bytes()[:700] if name == "cut.exr" else b"no image at all"
        (tmp_path / name).write_bytes(data)

    def script(test: Any, driven: Driven) -> None:
        before = driven.state.references
        assert before is not None
        for name in names:
            driven.state.message = ""
            driven.window.dropped([str(tmp_path / name)])
            wait_for(test, driven, "", lambda: bool(driven.state.message))
            assert not driven.state.message.startswith("Opened")
            assert name in driven.state.message
            assert driven.state.references is before
        assert before.wait(1001, 10) is not None
        assert driven.window.documents.recent == []

    drive_stage(script, with_reference=True)


def test_images_without_lobes_are_shown_alone_and_without_an_error(drive: Drive) -> None:
    bare = no_lobes((1001, 1002), 24.0)

    def script(test: Any, driven: Driven) -> None:
        assert driven.state.shown is Comparison.REFERENCE
        # black balls have no errors, which are told when there are samples enough
        renderer = driven.window.renderer
        wait_for(test, driven, "", lambda: driven.state.reference_image is not None)
        test.yield_(3)
        wait_for(test, driven, "", lambda: renderer.reference_progress == 1)
        test.yield_(2)
        assert renderer.ball_errors(driven.state) is None

    windows.drive(bare, script, with_reference=True)
