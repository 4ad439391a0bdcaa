# SPDX-License-Identifier: Apache-2.0
"""Time between frames: lobes by the rule of motion, the reference dissolved; the timeline."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
from imgui_bundle import imgui
from windows import Drive, Driven, bar_point

from asglight.errors import InputError
from asglight.lobes import LobeTracks, asg
from asglight.viewer.app import set_up
from asglight.viewer.io import screenshot
from asglight.viewer.pacing import wait_for_frame
from asglight.viewer.panels import widgets
from asglight.viewer.panels.curves import log_ticks, short, track_curves
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.held import Held
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource, SourceStatus
from asglight.viewer.state.time.playback import Playback
from asglight.viewer.state.time.time_span import TimeSpan, tick_step
from asglight.viewer.state.viewer_state import ViewerState


def ramp(tracks: LobeTracks) -> Reference:
    """Return a reference whose radiance is its frame number."""
    return Reference("ramp", tracks.frames, lambda f: np.full((4, 8, 3), f, np.float32))


class Running(FixedSource):
    """A fit that has come to some frames and goes on."""

    def status(self) -> SourceStatus:
        return SourceStatus(0, 0)


def accents(picture: np.ndarray, box: tuple[int, ...]) -> int:
    """Count the pixels of a part of a picture that are of the accent's hue, if not its strength."""
    left, top, right, bottom = box
    accent = np.array([widgets.ACCENT.x, widgets.ACCENT.y, widgets.ACCENT.z])
    return int((np.abs(picture[top:bottom, left:right] - accent).max(-1) < 0.2).sum())


def test_curves_end_where_a_fit_has_not_come_to_yet(tmp_path: Path, two_lamps: LobeTracks) -> None:
    frames = tuple(range(1001, 1009))
    lobes = two_lamps.lobes[torch.tensor([0, 1, 2, 2, 1, 0, 1, 2])]
    whole = LobeTracks(frames, 24.0, lobes)
    half = LobeTracks(frames[:4], 24.0, lobes[:4])
    counted: dict[str, tuple[int, int]] = {}

    def count(test: Any, picture: np.ndarray, first: float, last: float) -> list[int]:
        """Count what has the accent in a part of the width of each plot."""
        box = test.window_info("Curves").rect_full
        third, height = (box.max.x - box.min.x) / 3, box.max.y - box.min.y
        rows = box.min.y + 0.3 * height, box.min.y + 0.9 * height
        starts = [box.min.x + place * third for place in range(3)]
        boxes = [(x + first * third, rows[0], x + last * third, rows[1]) for x in starts]
        return [accents(picture, tuple(map(int, one))) for one in boxes]

    def script(test: Any, driven: Driven) -> None:
        driven.state.select(0)  # whose curves have the accent
        for name, source in (("half", Running(half)), ("whole", FixedSource(whole))):
            driven.window.session.source = source
            test.yield_(5)
            picture = windows.captured(test, driven, tmp_path / f"{name}.png")
            # the axis takes a fifth of a plot at most, four of eight frames half of the rest
            begun, not_yet = count(test, picture, 0.25, 0.4), count(test, picture, 0.75, 0.95)
            counted[name] = min(begun), max(not_yet)

    windows.drive(whole, script)
    assert counted["whole"][0] > 0
    assert counted["whole"][1] > 0
    assert counted["half"][0] > 0
    assert counted["half"][1] == 0


def test_curves_of_another_shot_are_in_view(tmp_path: Path, two_lamps: LobeTracks) -> None:
    other = LobeTracks((7, 8, 9), 24.0, two_lamps.lobes)

    def opener(path: str) -> Session:
        return Session(ViewerState(other), FixedSource(other), "other")

    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        driven.window.dropped(["other.usda"])
        windows.wait_for(test, driven, "Opened other.usda.")
        driven.state.select(0)
        test.yield_(5)
        picture = windows.captured(test, driven, tmp_path / "other.png")
        box = test.window_info("Curves").rect_full
        places = box.min.x + 30, box.min.y + 40, box.max.x, box.max.y - 30
        assert accents(picture, tuple(map(int, places))) > 100

    windows.drive(two_lamps, script, opener=opener)


def test_curves_of_frames_that_are_there_are_the_same_while_others_are_not(
    two_lamps: LobeTracks,
) -> None:
    whole = track_curves(Held(two_lamps))
    for rows, every in zip(
        track_curves(Held(two_lamps), frozenset((1002, 1004))), whole, strict=True
    ):
        assert np.isnan(rows[:, 0]).all()
        assert np.isfinite(rows[:, 1:]).all()
        if every is not whole[2]:
            np.testing.assert_array_equal(rows[:, 1:], every[:, 1:])
    degrees = track_curves(Held(two_lamps), frozenset((1002, 1004)))[2]
    assert degrees[0, 1] == 0  # from the first that is there


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        (0.08, 1.2, [0.1, 1.0]),
        (130.0, 300.0, [150.0, 200.0]),
        (1.1, 1.9, [1.5]),
        (2e-9, 9e2, [1e-6, 1e-3, 1e0]),
    ],
)
def test_logarithmic_axes_have_numbers_also_within_a_decade(
    low: float, high: float, wanted: list[float]
) -> None:
    assert log_ticks(low, high) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.001, "0.001"), (1000, "1000"), (1e4, "10k"), (1.5e5, "150k"), (1e6, "1M"), (1e9, "1e+09")],
)
def test_numbers_of_axes_are_short(number: float, text: str) -> None:
    assert short(number) == text


def test_half_a_frame_has_half_of_both_fluxes_the_mean_log_sharpness_and_half_the_turn(
    two_lamps: LobeTracks,
) -> None:
    lobes = two_lamps.lobes.clone()
    lobes.sharpness[1, 0] = torch.tensor([800.0, 800.0])
    lobes.amplitude[1, 0] *= 2
    state = ViewerState(LobeTracks(two_lamps.frames, 24.0, lobes))
    state.playback.go_to_time(1001.5)
    half = state.lobes
    assert half.axes.dtype == torch.float32
    flux = asg.flux(lobes[0].to(torch.float64)) / 2 + asg.flux(lobes[1].to(torch.float64)) / 2
    torch.testing.assert_close(asg.flux(half.to(torch.float64)), flux, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(half.sharpness[0], [400.0, 400.0], rtol=1e-6)  # sqrt(200 800)
    # it turns evenly: as far from the one direction as from the other
    first, last = lobes.axis_z[0, 0] @ half.axis_z[0], lobes.axis_z[1, 0] @ half.axis_z[0]
    assert float(first) == pytest.approx(float(last), abs=1e-6)
    assert torch.equal(state.lobes.axes, half.axes)


def test_between_frames_the_reference_is_dissolved_and_said_to_be(two_lamps: LobeTracks) -> None:
    references = ramp(two_lamps)
    state = ViewerState(two_lamps, references)
    for frame in two_lamps.frames:
        references.wait(frame, 10)
    state.playback.go_to_time(1001.25)
    np.testing.assert_allclose(state.reference_image, 1001.25)
    assert state.reference_image is state.reference_image
    assert state.reference_label == "1001 dissolved into 1002"
    state.playback.go_to(1002)
    assert state.reference_label == ""
    np.testing.assert_allclose(state.reference_image, 1002)
    state.compare_with(None)


def test_the_playhead_between_frames() -> None:
    playback = Playback([1001, 1002, 1004], 24.0)
    playback.go_to_time(1001.5)
    assert (playback.frame, playback.next_frame, playback.time) == (1001, 1002, 1001.5)
    playback.step(1)
    assert playback.time == 1002
    playback.go_to_time(1003.0)  # a gap: half-way between the frames around it
    assert (playback.frame, playback.part) == (1002, 0.5)
    playback.step(-1)
    assert playback.time == 1002
    playback.step_half(1)
    assert playback.time == 1002.5
    playback.step_half(-1)
    playback.step_half(-1)
    assert playback.time == 1001.5
    playback.go_to_time(9999.0)
    assert (playback.time, playback.is_between) == (1004, False)
    playback.go_to_time(1001.5)
    playback.play(0.0)
    assert not playback.is_between


def test_a_window_that_plays_waits_until_the_next_frame_is_due(two_lamps: LobeTracks) -> None:
    screenshot.use_no_display()
    state = ViewerState(two_lamps)  # on the clock of the system
    start = time.monotonic()
    wait_for_frame(state)
    assert (
        time.monotonic() - start < 0.5 / state.playback.fps
    )  # at rest there is nothing to wait for
    state.playback.play(start := time.monotonic())
    wait_for_frame(state)
    state.playback.tick(time.monotonic())
    assert time.monotonic() - start >= 1 / state.playback.fps
    assert state.playback.frame != 1001


def test_frames_a_second_and_dropped_frames_are_counted() -> None:
    playback = Playback(range(1, 101), 24.0)
    playback.loops = False
    playback.play(0.0)
    assert playback.achieved_fps is None
    for picture in range(1, 11):  # twelve pictures a second: each second frame is left out
        playback.tick(picture / 12 + 1e-4)
    assert playback.achieved_fps == pytest.approx(12, rel=1e-2)
    assert playback.dropped == 10
    playback.pause()
    assert playback.achieved_fps is None


def test_frames_dropped_around_the_end_are_counted() -> None:
    playback = Playback(range(1, 11), 10.0)
    playback.go_to(9)
    playback.play(0.0)
    playback.tick(0.41)  # 9, then 10, 1, 2, and 3 is shown
    assert playback.frame == 3
    assert playback.dropped == 3


@pytest.mark.parametrize(
    ("room", "step"), [(0.5, 1), (1.5, 2), (4, 5), (6, 10), (30, 50), (99, 100)]
)
def test_numbers_on_the_timeline_are_round(room: float, step: int) -> None:
    assert tick_step(room) == step


def test_the_timeline_zooms_about_the_pointer_and_stays_in_the_shot() -> None:
    span = TimeSpan(1001, 2001)
    assert span.ticks(45) == list(range(1050, 2001, 50))
    span.zoom(10, 1501)
    assert (span.begin, span.end) == (1451, 1551)
    span.pan(-9999)
    assert (span.begin, span.end) == (1001, 1101)
    span.follow(1200.0)
    assert span.begin < 1200 < span.end
    span.zoom(1e9, 1200.0)
    assert span.length == 4
    span.zoom(1e-9, 1200.0)
    assert (span.begin, span.end) == (1001, 2001)
    span.zoom(2, 1500.0)
    span.show_all()
    assert (span.begin, span.end) == (1001, 2001)


def test_shift_scrubs_between_frames_and_the_wheel_zooms(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        playback = driven.state.playback
        test.key_down(int(imgui.Key.mod_shift))
        test.mouse_move_to_pos(bar_point(test, 0.05))
        test.mouse_down(0)
        test.mouse_move_to_pos(bar_point(test, 0.25))  # four frames' room: the middle of 1001 + 1/2
        test.yield_(2)
        test.mouse_up(0)
        test.key_up(int(imgui.Key.mod_shift))
        assert playback.time == pytest.approx(1001.5, abs=0.01)  # a point is 0.004 frames
        playback.go_to_time(1001.5)
        test.key_press(int(imgui.Key.mod_shift) | int(imgui.Key.right_arrow))
        assert playback.time == 1002
        test.key_press(int(imgui.Key.mod_shift) | int(imgui.Key.left_arrow))
        assert playback.time == 1001.5

    drive(script)


def test_the_wheel_zooms_the_timeline_of_a_long_shot(drive: Drive, two_lamps: LobeTracks) -> None:
    lobes = two_lamps.lobes[:1].select(torch.tensor([0]))
    many = LobeTracks(
        tuple(range(1001, 2001)),
        24.0,
        type(lobes)(
            lobes.axes.repeat(1000, 1, 1, 1),
            lobes.sharpness.repeat(1000, 1, 1),
            lobes.amplitude.repeat(1000, 1, 1),
        ),
    )

    def script(test: Any, driven: Driven) -> None:
        test.mouse_move_to_pos(bar_point(test, 0.5))
        test.yield_(2)
        test.mouse_wheel_y(8)
        test.yield_(2)
        span = driven.state.span
        assert span.length == pytest.approx(1000 / 1.25**8)
        assert span.begin < 1501 < span.end
        test.key_press(int(imgui.Key.mod_shift) | int(imgui.Key.f))
        assert span.length == 1000

    windows.drive(many, script)


def test_a_time_can_be_typed(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.item_input_value("Timeline/##frame", 1001.5)
        assert driven.state.playback.time == 1001.5
        test.item_input_value("Timeline/##frame", 1004.0)
        assert driven.state.playback.time == 1004

    drive(script)


@pytest.mark.parametrize(("frame", "time"), [(1002, 1002), (1001.5, 1001.5), (None, 1001)])
def test_a_screenshot_can_be_of_a_time_between_frames(
    two_lamps: LobeTracks, frame: float | None, time: float
) -> None:
    session = Session(ViewerState(two_lamps), FixedSource(two_lamps), "shot.usda")
    set_up(session, frame, None)
    assert session.state.playback.time == time


@pytest.mark.parametrize("frame", [1003, 1000.5, 1004.5])
def test_a_time_outside_of_the_shot_is_refused(two_lamps: LobeTracks, frame: float) -> None:
    session = Session(ViewerState(two_lamps), FixedSource(two_lamps), "shot.usda")
    with pytest.raises(InputError, match=rf"--frame {frame:g}: not in shot.usda; expected"):
        set_up(session, frame, None)
