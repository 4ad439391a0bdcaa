# SPDX-License-Identifier: Apache-2.0
"""Five minutes of an artist's work with mouse and keys, from opening a shot to a film of it.

Open a stage and its images, scrub and play, select, warm a light, move it by its highlight, edit
several in a range, add, name, mute and delete, hold the fit against another, save, reopen, go on
and render. Where ASGLIGHT_ARTIST_PICTURES names a folder, a picture of the window is kept in it
after each act.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
import torch
import windows
from imgui_bundle import ImVec2, imgui
from imgui_bundle.immapp import testing
from windows import Driven, wait_for

from asglight.cli.sources.opening import opened_in_window
from asglight.images import write_exr
from asglight.lobes import Form, Lobes, LobeTracks, frames
from asglight.lobes.texels import texel_means
from asglight.sphere import latlong
from asglight.usd import read_usd, write_usd
from asglight.usd.read.tracks import read_stage
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.io import native
from asglight.viewer.state.display import Comparison, ViewTransform
from asglight.viewer.state.edits.absolute import lamp_of

CTRL, SHIFT = int(imgui.Key.mod_ctrl), int(imgui.Key.mod_shift)
FRAMES = tuple(range(1001, 1009))
PICTURED, UNSEEN = (1600, 1000), (1100, 1000)
"""Columns and rows of the window, where pictures are kept and where nobody sees it."""
LAMPS = (
    # u, v, sharpness along x and y, radiance
    (0.30, 0.30, 900.0, 900.0, (60.0, 52.0, 40.0)),  # a low sun
    (0.50, 0.10, 1.2, 1.2, (0.5, 0.7, 1.0)),  # the sky
    (0.50, 0.95, 1.5, 1.5, (0.25, 0.2, 0.15)),  # the ground
    (0.75, 0.45, 30.0, 90.0, (6.0, 5.5, 5.0)),  # a window
    (0.10, 0.40, 60.0, 60.0, (3.0, 1.2, 0.8)),  # a tungsten lamp
    (0.60, 0.40, 200.0, 200.0, (2.0, 2.2, 2.6)),  # a screen
)


def shot() -> LobeTracks:
    """Return six lamps over eight frames, of which the sun moves."""
    u = torch.tensor([lamp[0] for lamp in LAMPS]).repeat(len(FRAMES), 1)
    u[:, 0] += torch.linspace(0, 0.05, len(FRAMES))
    v = torch.tensor([lamp[1] for lamp in LAMPS]).expand_as(u)
    sharpness = torch.tensor([lamp[2:4] for lamp in LAMPS]).expand(len(FRAMES), -1, -1)
    amplitude = torch.tensor([lamp[4] for lamp in LAMPS]).expand(len(FRAMES), -1, -1)
    axes = frames.axes_around(latlong.direction_from_uv(u, v))
    return LobeTracks(FRAMES, 24.0, Lobes(axes, sharpness.clone(), amplitude.clone(), Form.ASG))


class Artist:
    """A hand on mouse and keys, and a camera that looks at the window."""

    def __init__(self, test: Any, driven: Driven, pictures: Path | None) -> None:
        self.test, self.driven, self.pictures = test, driven, pictures
        self.count = 0

    @property
    def state(self) -> Any:
        return self.driven.state

    def looks(self, act: str) -> None:
        """Let the window take up what was done; settle and keep its picture where that is asked."""
        self.test.yield_(2)
        if self.pictures is None:
            return
        self.test.yield_(30)
        self.count += 1
        testing.capture(self.test, str(self.pictures / f"{self.count:02d}_{act}.png"))

    def presses(self, key: int, modifier: int = 0) -> None:
        self.test.key_press(modifier | int(key))
        self.test.yield_(2)

    def at_map(self, u: float, v: float) -> ImVec2:
        box = self.test.item_info("Map/##map").rect_full
        width, height = box.max.x - box.min.x, box.max.y - box.min.y
        return ImVec2(box.min.x + u * width, box.min.y + v * height)

    def at_ball(self, ball: int, right: float, up: float) -> ImVec2:
        """Return a point of a ball of the first row."""
        box = self.test.item_info("Balls/##picture").rect_full
        columns = round(box.max.x - box.min.x)
        rows = round(box.max.y - box.min.y) // self.state.parts
        cell = cells((columns, rows), 6)[ball]
        half = cell.size / 2
        return ImVec2(box.min.x + cell.x + half * (1 + right), box.min.y + cell.y + half * (1 - up))

    def drags(self, *points: ImVec2) -> None:
        self.test.mouse_move_to_pos(points[0])
        self.test.mouse_down(0)
        for point in points[1:]:
            self.test.mouse_move_to_pos(point)
            self.test.yield_(2)
        self.test.mouse_up(0)
        self.test.yield_(2)

    def names(self, name: str) -> None:
        """Type a file's name in the browser and accept it."""
        self.test.yield_(3)
        browser = self.driven.window.documents.browser
        assert browser is not None
        self.test.item_input_value("//$FOCUSED/##name", name)
        self.test.yield_(2)
        if self.driven.window.documents.browser is not None:
            self.test.item_click("//$FOCUSED/###accept")


def open_images(artist: Artist) -> None:
    test, driven, state = artist.test, artist.driven, artist.state
    artist.presses(imgui.Key.o, CTRL)
    artist.names("sky.####.exr")
    wait_for(test, driven, "Opened sky.####.exr.")
    artist.presses(imgui.Key.a)
    artist.looks("images")
    assert state.references.frames == FRAMES
    assert state.shown is Comparison.ROWS


def scrub_and_play(artist: Artist) -> None:
    test, driven, state = artist.test, artist.driven, artist.state
    box = test.item_info("Timeline/##bar").rect_full
    middle = (box.min.y + box.max.y) / 2
    width = box.max.x - box.min.x
    artist.drags(*(ImVec2(box.min.x + s * width, middle) for s in (0.05, 0.4, 0.9, 0.45)))
    assert state.playback.frame == 1004
    test.item_click("Timeline/###play")
    for picture in range(12):
        driven.seconds += 1 / 24
        test.yield_()
        if picture == 6:
            artist.looks("playing")
    artist.presses(imgui.Key.space)
    state.playback.go_to(1004)


def warm_a_light(artist: Artist) -> None:
    test, state = artist.test, artist.state
    test.mouse_move_to_pos(artist.at_map(0.75, 0.45))
    test.mouse_click(0)
    test.yield_(3)
    assert state.selected == (3,)
    lamp = lamp_of(state.lobes[3])
    test.item_input_value("Lobes/temperature", 3200.0)
    test.item_input_value("Lobes/intensity", lamp.intensity + 0.5)
    artist.looks("warmed")
    warm = lamp_of(state.lobes[3])
    assert warm.kelvin == pytest.approx(3200, rel=1e-3)
    assert warm.intensity == pytest.approx(lamp.intensity + 0.5, abs=1e-4)


def move_a_highlight(artist: Artist) -> None:
    test, state = artist.test, artist.state
    test.key_down(CTRL)
    artist.drags(*(artist.at_ball(0, *point) for point in ((0.4, 0.3), (0.2, 0.4), (0, 0.5))))
    artist.looks("highlight")
    test.key_up(CTRL)
    test.yield_(2)
    moved = lamp_of(state.lobes[3])
    assert abs(moved.azimuth) < 5  # straight ahead of the camera, above the horizon
    assert moved.elevation == pytest.approx(60, abs=6)


def edit_a_range(artist: Artist) -> None:
    test, state = artist.test, artist.state
    artist.presses(imgui.Key.i)
    state.playback.go_to(1006)
    artist.presses(imgui.Key.o)
    test.item_click("**/lobe_04")
    test.key_down(CTRL)
    test.item_click("**/lobe_05")
    test.key_up(CTRL)
    test.yield_(2)
    test.set_ref("Lobes")
    test.combo_click("frames/in to out")
    test.set_ref("")
    test.item_input_value("Lobes/soft ends", 2)
    test.item_input_value("Lobes/intensity", lamp_of(state.lobes[5]).intensity + 2)
    artist.looks("range")
    gain = state.tracks.lobes.amplitude[:, 4:, 0] / shot().lobes.amplitude[:, 4:, 0]
    np.testing.assert_allclose(gain[3:6], 4, rtol=1e-4)
    assert float(gain[0, 0]) == 1
    assert 1 < float(gain[1, 0]) < float(gain[2, 0]) < 4
    artist.presses(imgui.Key.i, SHIFT)


def add_name_and_mute(artist: Artist) -> None:
    test, state = artist.test, artist.state
    test.mouse_move_to_pos(artist.at_map(0.4, 0.6))
    test.yield_(2)
    artist.presses(imgui.Key.n)
    artist.presses(imgui.Key.f2)
    test.yield_(2)
    test.key_chars_replace_enter("practical, desk")
    test.yield_(2)
    state.select(5)
    artist.presses(imgui.Key.delete)
    state.select(4)
    artist.presses(imgui.Key.x)
    artist.looks("added")
    assert state.lobe_names[6] == "practical, desk"
    assert state.lit == (0, 1, 2, 3, 6)


def compare_with_another(artist: Artist) -> None:
    test, driven, state = artist.test, artist.driven, artist.state
    artist.presses(imgui.Key.b, CTRL)
    artist.names("other.usda")
    wait_for(test, driven, "B is other.usda.")
    artist.looks("a_and_b")
    assert state.parts == 3
    state.compared.comparison = Comparison.WIPE
    artist.looks("wipe")
    state.compared.comparison = Comparison.DIFFERENCE
    artist.looks("difference")
    artist.presses(imgui.Key.b, SHIFT)
    state.display.transform = ViewTransform.FILMIC
    state.compared.comparison = Comparison.FIT


def save(artist: Artist) -> None:
    test, driven, state = artist.test, artist.driven, artist.state
    artist.presses(imgui.Key.s, CTRL)
    artist.looks("saving")
    artist.names("graded.usda")
    wait_for(test, driven, "Saved graded.usda.")
    assert not state.history.is_unsaved


def reopen(artist: Artist) -> None:
    test, driven = artist.test, artist.driven
    artist.presses(imgui.Key.o, CTRL)
    artist.names("graded.usda")
    wait_for(test, driven, "Opened graded.usda.")
    state = artist.state
    artist.looks("reopened")
    assert state.lobe_names == (*shot().names[:5], "practical, desk")
    assert state.history.muted == {4}
    state.select(4)
    artist.presses(imgui.Key.x)
    assert 4 in state.lit


def render(artist: Artist) -> None:
    test, driven = artist.test, artist.driven
    artist.presses(imgui.Key.l, CTRL)
    artist.names("film.mp4")
    wait_for(test, driven, f"Rendered {len(FRAMES)} pictures.")
    artist.looks("rendered")


ACTS = (
    open_images,
    scrub_and_play,
    warm_a_light,
    move_a_highlight,
    edit_a_range,
    add_name_and_mute,
    compare_with_another,
    save,
    reopen,
    render,
)


@pytest.mark.slow
def test_an_artists_five_minutes(
    opengl: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(native, "has_dialog", lambda: False)
    kept = os.environ.get("ASGLIGHT_ARTIST_PICTURES")
    pictures = None if kept is None else Path(kept)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    tracks = shot()
    stage, other, layer = (tmp_path / f"{name}.usda" for name in ("shot", "other", "graded"))
    write_usd(tracks, stage, dome_height=16)
    fewer = tracks.lobes.select(torch.tensor([0, 1, 2]))
    write_usd(replace(tracks, lobes=fewer, names=tracks.names[:3]), other, dome_height=16)
    for place, frame in enumerate(FRAMES):
        write_exr(tmp_path / f"sky.{frame}.exr", texel_means(tracks.lobes[place], 32, 64))

    def script(test: Any, driven: Driven) -> None:
        driven.paints = pictures is not None
        artist = Artist(test, driven, pictures)
        artist.looks("stage")
        for act in ACTS:
            act(artist)

    size = UNSEEN if pictures is None else PICTURED
    windows.drive(read_usd(stage), script, stage=stage, opener=opened_in_window, size=size)
    opengl.__enter__()
    reading = read_stage(layer)
    assert reading.tracks.names == (*tracks.names[:5], "lobe_06")
    assert reading.tracks.display_names == {"lobe_06": "practical, desk"}
    warm = lamp_of(reading.tracks.lobes[3, 3])
    assert warm.kelvin == pytest.approx(3200, rel=1e-3)
    assert reading.muted == {4}
    count, _ = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))
    assert count == len(FRAMES)
