# SPDX-License-Identifier: Apache-2.0
"""The map's zoom and the pinned probe, driven by wheel, mouse and keys."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imgui_bundle import ImVec2, imgui
from windows import Drive, Driven, captured, map_point

from asglight.viewer.state.map_frame import ZOOM_MAX, MapFrame


def test_what_is_under_the_pointer_stays_there_while_zooming() -> None:
    frame = MapFrame()
    for factor in (2.0, 1.5, 0.7, 4.0):
        x, y = 0.7, 0.4
        before = frame.left + x / frame.zoom, frame.top + y / frame.zoom
        frame.zoom_at(x, y, factor)
        after = frame.left + x / frame.zoom, frame.top + y / frame.zoom
        assert after == pytest.approx(before)


def test_the_map_stays_inside_of_its_panel_and_ends_at_its_zoom() -> None:
    frame = MapFrame()
    frame.zoom_at(0.1, 0.9, 1e9)
    assert frame.zoom == ZOOM_MAX
    frame.pan(5.0, -5.0)
    assert (frame.left, frame.top) == (0.0, pytest.approx(1 - 1 / ZOOM_MAX))
    frame.zoom_at(0.5, 0.5, 1e-9)
    assert (frame.zoom, frame.left, frame.top) == (1.0, 0.0, 0.0)


def test_the_wheel_zooms_and_a_click_still_selects_what_is_under_it(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(None)
        test.mouse_move_to_pos(map_point(test, 0.25, 0.25))  # the green lamp
        test.mouse_wheel_y(6)
        test.yield_(2)
        assert state.map_frame.zoom == pytest.approx(1.25**6)
        assert state.probe is not None
        # points are whole ones
        assert (state.probe.x, state.probe.y) == pytest.approx((0.25, 0.25), abs=0.01)
        test.mouse_click(0)
        test.yield_(2)
        assert state.selection.lobe == 0
        # a drag by the middle button takes the map along
        test.mouse_down(2)
        test.mouse_move_to_pos(map_point(test, 0.5, 0.5))
        test.mouse_up(2)
        test.yield_(2)
        assert state.probe is not None
        assert (state.probe.x, state.probe.y) == pytest.approx((0.25, 0.25), abs=0.02)
        assert not state.history.is_changed
        test.key_press(int(imgui.Key.w))
        assert state.map_frame == MapFrame()

    drive(script)


def test_a_zoomed_map_shows_its_part_larger(drive: Drive, tmp_path: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.outlines = list(type(state.outlines))[-1]
        shown = []
        for factor in (1.0, 4.0):
            state.map_frame.zoom_at(0.25, 0.25, factor)
            test.mouse_move_to_pos(ImVec2(5, 5))
            test.yield_(3)
            pixels = captured(test, driven, tmp_path / "map.png")
            low, high = map_point(test, 0, 0), map_point(test, 1, 1)
            part = pixels[int(low.y) : int(high.y), int(low.x) : int(high.x)]
            shown.append((part[..., 1] > 0.4).sum())  # texels of the green lamp
        assert shown[1] / shown[0] == pytest.approx(16, rel=0.15)

    drive(script)


def test_a_pinned_probe_stays_and_its_numbers_can_be_copied(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.key_press(int(imgui.Key.y))
        assert state.message.startswith("Nothing is probed yet.")
        test.mouse_move_to_pos(map_point(test, 0.25, 0.25))
        test.yield_(2)
        test.key_press(int(imgui.Key.y))
        pinned = state.probe
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.yield_(2)
        assert state.probe == pinned
        assert state.inspected is not None
        green = state.inspected.fit
        assert green is not None
        assert green[1] > 0.5
        test.item_click("Inspector/copy")
        test.yield_(2)
        lines = dict(line.split("\t", 1) for line in imgui.get_clipboard_text().splitlines())
        values = np.array([float(value) for value in lines["fit (RGB)"].split("\t")])
        np.testing.assert_allclose(values, green, rtol=1e-5)
        assert float(lines["lobe_00"]) == pytest.approx(1.0, abs=1e-3)
        assert "clipboard" in state.message
        # it follows the frame: the green lamp has moved on
        test.key_press(int(imgui.Key.end))
        test.yield_(2)
        assert state.inspected.fit is not None
        assert state.inspected.fit[1] < 0.1
        test.item_click("Inspector/###pin")
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.yield_(2)
        assert state.probe != pinned

    drive(script)
