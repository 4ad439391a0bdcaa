# SPDX-License-Identifier: Apache-2.0
"""Keys in the real window: named, resized, muted, deleted, added, saved and opened again."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
from bench_scripts import module
from imgui_bundle import ImVec2, imgui
from key_cases import Rectangle, corner_error, with_lamps
from keyed_stages import FRAMES, write
from pxr import Usd
from windows import Driven, map_point, wait_for

from asglight.cli.main import main
from asglight.cli.sources.opening import opened_in_window
from asglight.images import read_latlong, write_exr
from asglight.lobes import LobeTracks, asg
from asglight.sphere import latlong
from asglight.usd import read_keys
from asglight.viewer.state.edits.absolute import lamp_of
from asglight.viewer.state.views import Request, Scene

judge = module("keyed.seen")

LAMPS = (Rectangle(20, 30, 15, 20, 9), Rectangle(200, 10, 0, 12, 12))
ROWS = 64


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """Write a stage of two keys and their rest, over two frames."""
    sky = torch.maximum(*(with_lamps(ROWS, lamp) for lamp in LAMPS))
    for frame in FRAMES[:2]:
        write_exr(tmp_path / f"sky.{frame}.exr", sky, half=False)
    write(tmp_path, frames=FRAMES[:2], count=2)
    return tmp_path / "shot.usda"


@pytest.fixture
def drive(two_lamps: LobeTracks, stage: Path) -> Callable[..., None]:
    """Open a window on the keyed stage, let a script drive it, close it."""

    def driven_on(script: Callable[[Any, Driven], None], **options: Any) -> None:
        def on_keys(test: Any, driven: Driven) -> None:
            opens(test, driven, stage)
            assert driven.state.keyed is not None
            script(test, driven)

        windows.drive(two_lamps, on_keys, opener=opened_in_window, **options)

    return driven_on


def opens(test: Any, driven: Driven, path: Path) -> None:
    driven.window.documents.open(str(path))
    wait_for(test, driven, f"Opened {path.name}.")
    driven.state.scene = Scene.GROUND  # which is drawn at once: balls are integrated
    wait_for(test, driven, "", lambda: driven.state.rest_image is not None)
    test.yield_(4)


def lamp(driven: Driven, key: int) -> Any:
    return lamp_of(driven.state.lobes[key], is_key=True)


def test_keys_are_named_resized_muted_deleted_added_saved_and_opened_again(
    drive: Callable[..., None], stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    layer = stage.parent / "edits.usda"
    cut = read_keys(stage)
    assert cut is not None
    assert cut.tracks is not None
    names = cut.tracks.names
    height = lamp_of(cut.tracks.lobes[0, 0], is_key=True).height
    wanted: dict[str, Any] = {}

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.item_click(f"Lobes/**/{names[0]}")
        test.key_press(int(imgui.Key.f2))
        test.yield_(3)
        test.key_chars_replace_enter("Window")
        test.yield_(2)
        assert state.lobe_names[0] == "Window"
        test.item_input_value("Lobes/width", 26.0)
        test.yield_(2)
        assert lamp(driven, 0).width == pytest.approx(26.0, rel=1e-3)
        assert lamp(driven, 0).height == pytest.approx(height, rel=1e-3)
        # a new one, where the pointer is, with a size and a colour
        test.mouse_move_to_pos(map_point(test, 0.7, 0.6))
        test.yield_(2)
        test.key_press(int(imgui.Key.n))
        test.yield_(2)
        assert state.selected == (2,)
        found = lamp(driven, 2)
        # (0.5 - 0.7) 360 and 90 - 0.6 180; a point of the map is a degree
        assert (found.azimuth, found.elevation) == pytest.approx((-72.0, -18.0), abs=1.5)
        assert (found.width, found.height, found.roll) == pytest.approx((20, 20, 0), abs=1e-3)
        test.item_input_value("Lobes/height", 8.0)
        test.item_input_value("Lobes/temperature", 3200.0)
        test.yield_(2)
        wanted["added"] = lamp(driven, 2)
        assert wanted["added"].kelvin == pytest.approx(3200, rel=1e-3)
        test.item_click(f"Lobes/**/{names[1]}")
        test.key_press(int(imgui.Key.delete))
        test.yield_(2)
        assert state.history.present == (0, 2)
        test.key_press(int(imgui.Key.mod_ctrl) | int(imgui.Key.z))
        assert state.history.present == (0, 1, 2)
        test.key_press(int(imgui.Key.mod_ctrl) | int(imgui.Key.mod_shift) | int(imgui.Key.z))
        assert state.history.present == (0, 2)
        assert len(state.history.steps) == 6
        state.select(0)
        test.key_press(int(imgui.Key.x))
        driven.window.save(Request.SAVE_EDITS, layer)
        wait_for(test, driven, "Saved edits.usda.")
        opens(test, driven, layer)
        state = driven.state
        assert state.lobe_names == ("Window", "key_03")
        assert state.history.muted == {0}
        assert lamp(driven, 0).width == pytest.approx(26.0, rel=1e-3)
        found = lamp(driven, 1)
        for name in ("azimuth", "elevation", "width", "height", "kelvin", "intensity"):
            assert getattr(found, name) == pytest.approx(getattr(wanted["added"], name), rel=1e-3)
        test.item_click("Lobes/**/Window###" + names[0])
        test.key_press(int(imgui.Key.x))
        assert state.lit == (0, 1)

    drive(script)
    assert main(["info", str(layer)]) == 0
    told = capsys.readouterr().out
    assert f"edited: /AsgRig/Keys/{names[0]}: invisible" in told
    assert f"edited: /AsgRig/Keys/{names[1]}: switched off" in told


def test_a_key_that_is_deleted_is_said_to_leave_the_sum(
    drive: Callable[..., None], stage: Path
) -> None:
    keys = read_keys(stage)
    assert keys is not None
    assert keys.tracks is not None
    image = read_latlong(stage.parent / f"sky.{FRAMES[0]}.exr").radiance.to(torch.float64)
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)
    whole = float((image.sum(-1) * weight).sum())
    share = float(asg.flux(keys.tracks.lobes[0, 1].to(torch.float64)[None])[0].sum()) / whole
    names = keys.tracks.names

    def script(test: Any, driven: Driven) -> None:
        test.item_click(f"Lobes/**/{names[1]}")
        test.key_press(int(imgui.Key.delete))
        test.yield_(2)
        assert driven.state.message == (
            f"Deleted {names[1]}: {100 * share:.1f} % of this frame's light is gone. "
            "The rest stays filled."
        )

    drive(script)


def test_without_a_pointer_a_key_is_added_where_the_camera_looks(
    drive: Callable[..., None],
) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.inspected = None
        state.camera.yaw_deg, state.camera.pitch_deg = 30.0, 0.0
        toward = state.camera.from_environment().T @ [0.0, 0.0, 1.0]
        test.item_click("Lobes/add")
        test.yield_(2)
        found = state.lobes.axis_z[2].numpy()
        assert found == pytest.approx(toward, abs=1e-6)
        assert lamp(driven, 2).radiance > 0

    drive(script)


SLANTED = Rectangle(150, 20, 15, 30, 22, slant=45, about=40)


def resized(light: Any, factor: float) -> np.ndarray:
    """Return the corners of a light of UsdLux with its width times a factor, as seen.  [4, 3]."""
    matrix = np.linalg.inv(light.to_local)
    half = np.array(light.half) * [factor, 1]
    points = [[x * half[0], y * half[1], 0, 1] for x, y in judge.ROUND] @ matrix
    return points[:, :3] / np.linalg.norm(points[:, :3], axis=-1, keepdims=True)


def test_a_slanted_key_that_is_resized_by_the_mouse_stays_slanted_and_is_saved_so(
    drive: Callable[..., None], stage: Path
) -> None:
    for frame in FRAMES[:2]:
        write_exr(stage.parent / f"sky.{frame}.exr", with_lamps(ROWS, SLANTED), half=False)
    write(stage.parent, frames=FRAMES[:2], count=1)
    layer = stage.parent / "edits.usda"
    [before] = judge.lights(Usd.Stage.Open(str(stage)), FRAMES[0])
    assert corner_error(resized(before, 1.0), SLANTED.corners()) < np.radians(1)
    shown: dict[str, Any] = {}

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(0)
        test.yield_(3)
        before_drag, first = state.lobes.slant, lamp(driven, 0)
        assert before_drag is not None
        slant = before_drag[0].clone()
        assert slant[2:4].norm() > np.radians(35)  # 45 degrees that the lamp is slanted by
        box = test.item_info("Lobes/width").rect_full
        middle = (box.min.y + box.max.y) / 2
        for step, share in enumerate((0.2, 0.3, 0.34)):
            test.mouse_move_to_pos(ImVec2(box.min.x + share * (box.max.x - box.min.x), middle))
            if step == 0:
                test.mouse_down(0)
            test.yield_(2)
        test.mouse_up(0)
        test.yield_(2)
        assert len(state.history.steps) == 1
        last = lamp(driven, 0)
        assert last.width > first.width + 5
        for name in ("height", "azimuth", "elevation", "roll", "radiance"):
            assert getattr(last, name) == pytest.approx(getattr(first, name), rel=1e-4)
        after_drag = state.lobes.slant
        assert after_drag is not None
        assert torch.equal(after_drag[0], slant)
        shown["factor"] = np.tan(np.radians(last.width) / 2) / np.tan(np.radians(first.width) / 2)
        driven.window.save(Request.SAVE_EDITS, layer)
        wait_for(test, driven, "Saved edits.usda.")

    drive(script)
    [after] = judge.lights(Usd.Stage.Open(str(layer)), FRAMES[0])
    wanted = resized(before, shown["factor"])
    assert corner_error(resized(after, 1.0), wanted) < 1e-4  # a stage holds float32
    # 5 degrees wider and more: far from what it was
    assert corner_error(wanted, resized(before, 1.0)) > np.radians(2)
