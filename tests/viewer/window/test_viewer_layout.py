# SPDX-License-Identifier: Apache-2.0
"""The window at five sizes and in both themes: nothing outside, large balls, readable text."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import windows
from imgui_bundle import ImVec2, imgui
from windows import Drive, Driven, captured

from asglight.lobes import LobeTracks
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.panels.curves import _limits, track_curves
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.held import Held
from asglight.viewer.state.views import Outlines, Theme

SIZES = [
    (Theme.DARK, (1024, 640), 1.0),
    (Theme.DARK, (1366, 768), 1.0),
    (Theme.LIGHT, (1600, 1000), 1.0),
    (Theme.DARK, (1920, 1080), 1.0),
    (Theme.LIGHT, (1920, 1080), 2.0),
]
"""Theme, columns, rows, and how many texels a point has. A theme has the same sizes as another. 4k
at scale 2 is laid out as 1920 x 1080 at scale 1, and the screen of GLFW's null platform is no
larger."""

BALL_EM = 2.8
"""Heights of the font that a ball takes at least: its name fits below it."""


def box(test: Any, name: str) -> Any:
    return test.item_info(name).rect_full


def texts_beside_the_balls(picture: np.ndarray, place: Any, parts: int) -> float:
    """Return how far anything above the balls of each row is from the ground of the picture."""
    left, right = int(place.min.x), int(place.max.x)
    top, bottom = int(place.min.y), int(place.max.y)
    balls = picture[top:bottom, left:right]
    each = balls.shape[0] // 2
    ground = balls[1, 1]
    found = 0.0
    x, y, side = cells((balls.shape[1], each), 6)[0]
    for first in (0, each) if parts == 2 else (each // 2,):
        row = balls[first : first + each]
        # what lies beside the first ball and above its middle, where a title would begin
        above, beside = row[1 : y - 1], row[1 : y + side // 2, : max(x - 1, 0)]
        found = max(found, *(float(np.abs(one - ground).max(initial=0)) for one in (above, beside)))
    return found


def is_inside(test: Any) -> None:
    """Hold the ends of the timeline against the window, and the balls against their least size."""
    # the window itself: one whose system has less room is smaller than it was asked to be
    screen = imgui.get_main_viewport().size
    for name in ("in", "out", "all", "##bar", "###play"):
        found = box(test, f"Timeline/{name}")
        panel = test.window_info("Timeline").window
        assert found.max.x <= panel.pos.x + panel.size.x, name
        assert found.max.y <= screen.y, name
    balls = box(test, "Balls/##picture")
    columns, rows = balls.max.x - balls.min.x, (balls.max.y - balls.min.y) / 2
    assert cells((int(columns), int(rows)), 6)[0].size >= BALL_EM * imgui.get_font_size()


def has_colours_of(theme: Theme, picture: np.ndarray, scale: float) -> None:
    # the menu: its background and its letters are far apart in brightness
    menu = picture[2 : int(16 * scale), : int(160 * scale)].mean(-1)
    assert menu.max() - menu.min() > 0.5
    background = np.median(menu)
    assert background > 0.7 if theme is Theme.LIGHT else background < 0.3


def title(picture: np.ndarray, place: Any) -> np.ndarray:
    """Return where letters are in the row above the balls.  [H, W]."""
    em = imgui.get_font_size()
    top = int(place.min.y)
    row = picture[int(top - 1.2 * em) : top, int(place.min.x) : int(place.max.x)]
    ground = np.median(row.reshape(-1, 3), axis=0)
    written = np.abs(row - ground).max(-1) > 0.3
    assert written.any()
    columns = np.flatnonzero(written.any(0))
    assert columns[-1] < row.shape[1] - 1  # it ends inside of the panel
    return written


@pytest.mark.parametrize(("theme", "size", "scale"), SIZES)
def test_all_is_inside_of_the_window_with_large_balls_and_titles_above_them(
    drive: Drive,
    two_lamps: LobeTracks,
    tmp_path: Path,
    size: tuple[int, int],
    scale: float,
    theme: Theme,
) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.theme = theme
        test.yield_(5)
        is_inside(test)
        titles = []
        for shown, parts in ((Comparison.ROWS, 2), (Comparison.DIFFERENCE, 1)):
            driven.state.compared.comparison = shown
            test.mouse_move_to_pos(ImVec2(5, 5))
            test.yield_(5)
            picture = captured(test, driven, tmp_path / "window.png")
            has_colours_of(theme, picture, scale)
            place = box(test, "Balls/##picture")
            assert texts_beside_the_balls(picture, place, parts) < 0.02
            titles.append(title(picture, place))
        assert (titles[0] != titles[1]).any()  # it says which picture it is

    windows.drive(two_lamps, script, with_reference=True, size=size, scale=scale)


def test_play_and_pause_leave_the_row_where_it_is(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        before = box(test, "Timeline/loop").min.x
        test.item_click("Timeline/###play")
        test.yield_(2)
        assert driven.state.playback.is_playing
        assert box(test, "Timeline/loop").min.x == before

    drive(script)


def test_the_switches_of_a_lobe_are_on_the_line_of_its_name(drive: Drive) -> None:
    def middle(found: Any) -> float:
        return (found.min.y + found.max.y) / 2

    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        name = middle(box(test, "Lobes/**/lobe_00"))
        for switch in ("S", "M"):
            assert middle(box(test, f"Lobes/**/{switch}")) == pytest.approx(name, abs=1.5)

    drive(script)


TOOLTIP_S = 20.0
"""Seconds, at most, until a tooltip is there. It comes after a delay, however fast frames are."""


def tooltip_of(test: Any, item: str) -> Any:
    """Point at an item and return the window of its tooltip."""
    test.mouse_move(item)
    imgui.get_io().config_input_trickle_event_queue = False
    end = time.monotonic() + TOOLTIP_S
    while time.monotonic() < end:
        test.yield_()
        windows_shown = imgui.get_current_context().windows
        tips = [w for w in windows_shown if "Tooltip" in w.name and w.active]
        if tips:
            test.yield_(3)
            return tips[0]
    raise AssertionError(f"{item} has no tooltip")


def test_a_tooltip_leaves_the_next_control_in_view(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        here, following = box(test, "Look/view"), box(test, "Look/channel")
        tip = tooltip_of(test, "Look/view")
        assert tip.pos.y + tip.size.y <= here.min.y + 1
        assert tip.pos.y + tip.size.y < following.min.y

    drive(script)


def test_a_tooltip_stays_inside_of_the_window(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(0)
        test.yield_(3)
        tip = tooltip_of(test, "Lobes/intensity")
        assert tip.pos.x + tip.size.x <= windows.SIZE[0]
        assert tip.size.x > box(test, "Lobes/intensity").get_width()  # or there would be no need

    drive(script)


def test_outlines_can_be_hidden(drive: Drive, two_lamps: LobeTracks, tmp_path: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(None)
        seen = []
        for outlines in (Outlines.ALL, Outlines.SELECTED, Outlines.NONE):
            assert driven.state.outlines is outlines
            test.yield_(2)
            found = captured(test, driven, tmp_path / f"{outlines}.png")
            place = box(test, "Map/##map")
            rows = slice(int(place.min.y), int(place.max.y))
            seen.append(found[rows, int(place.min.x) : int(place.max.x)])
            test.mouse_move_to_pos(ImVec2(5, 5))
            test.key_press(int(imgui.Key.h))
        assert np.abs(seen[0] - seen[1]).max() > 0.1
        np.testing.assert_array_equal(seen[1], seen[2])

    drive(script)


def test_all_curves_are_inside_of_their_plot(two_lamps: LobeTracks) -> None:
    lobes = two_lamps.lobes.clone()
    lobes.amplitude[:, 1] *= 1e-4
    tracks = LobeTracks(two_lamps.frames, 24.0, lobes)
    amplitude, sharpness, turn = track_curves(Held(tracks))
    for values, is_logarithmic in ((amplitude, True), (sharpness, True), (turn, False)):
        low, high = _limits(values, is_logarithmic)
        assert low <= values.min()
        assert values.max() <= high
    # a lobe of a ten-thousandth of the other's light is in view
    low, high = _limits(amplitude, True)
    assert 1e4 < high / low < 1e6
    assert amplitude[1].min() == pytest.approx(0.9e-4 * 0.2126)
    lobes.amplitude[1:, 1] = 0  # it goes out: its curve falls to the floor, no further
    fading = track_curves(Held(LobeTracks(two_lamps.frames, 24.0, lobes)))[0]
    np.testing.assert_allclose(fading[1, 1:], 0.1 * fading[1, 0], rtol=1e-6)


def test_a_message_is_forgotten_when_it_has_been_read(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.message = "Nothing to undo."
        test.yield_(2)
        driven.seconds = 15.0
        test.yield_(2)
        assert driven.state.message == "Nothing to undo."
        driven.seconds = 21.0
        test.yield_(2)
        assert driven.state.message == ""

    drive(script)
