# SPDX-License-Identifier: Apache-2.0
"""The ball on the ground: where shadows fall, what casts them, and how the window shows it."""

import math
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import OpenImageIO
import pytest
import torch
from imgui_bundle import imgui
from windows import Drive, Driven, grey

from asglight.cli.main import main
from asglight.lobes import Form, Lobes, LobeTracks, asg, frames
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Scene
from asglight.viewer.uniforms import ground_blocks
from asglight.viewer.uniforms.ground_blocks import ground_view

SIZE = (320, 220)


def sun(azimuth_deg: float, elevation_deg: float, *, count: int = 1) -> LobeTracks:
    """Return a track of a lamp of half a degree; more of them a quarter turn apart each."""
    turns = torch.deg2rad(azimuth_deg + 90 * torch.arange(count, dtype=torch.float64))
    high = math.radians(elevation_deg)
    axis = torch.stack(
        [
            math.cos(high) * turns.sin(),
            torch.full_like(turns, math.sin(high)),
            math.cos(high) * turns.cos(),
        ],
        dim=-1,
    )
    lobes = Lobes(
        frames.axes_around(axis[None]).float(),
        torch.full((1, count, 2), 2e4),
        torch.full((1, count, 3), 1e4),
        Form.ASG,
    )
    return LobeTracks((1,), 24.0, lobes)


def on_ground(tracks: LobeTracks) -> ViewerState:
    state = ViewerState(tracks)
    state.scene = Scene.GROUND
    return state


def radiance(opengl: moderngl.Context, state: ViewerState) -> np.ndarray:
    """Return the scene.  [H, W]."""
    renderer = Renderer(opengl)
    renderer.balls(state, SIZE)
    return renderer.radiance(state)[..., 1]


def pixel(x: float, z: float, y: float = 0.0) -> tuple[int, int]:
    """Return column and row of a point, with the camera at rest."""
    view = ground_view(SIZE, 0.0, 0.0)
    right, up, back = (a - b for a, b in zip((x, y, z), ground_blocks.FOCUS, strict=True))
    rise = up * math.cos(view.pitch) - back * math.sin(view.pitch)
    return int(view.middle[0] + right * view.unit), int(view.middle[1] - rise * view.unit)


def test_a_sun_gives_the_ground_its_irradiance_and_the_shadow_none(
    opengl: moderngl.Context,
) -> None:
    tracks = sun(90.0, 45.0)  # from the right: shadows fall to the left
    found = radiance(opengl, on_ground(tracks))
    flux = float(asg.integral(tracks.lobes[0])[0]) * 1e4
    lit = ground_blocks.BASE[0] / math.pi * flux * math.sin(math.radians(45))
    column, row = pixel(2.9, 0.9)
    assert found[row, column] == pytest.approx(lit, rel=0.01)
    # the middle of an ellipse whose far end is where the highest tangent ray lands
    column, row = pixel(-1.9, 0.0)
    assert found[row, column] < 0.01 * lit
    # of the post, as far left of it as half of its height at 45 degrees
    foot = ground_view(SIZE, 0.0, 0.0).foot
    column, row = pixel(foot[0] - 0.5 * ground_blocks.POST[1], foot[2])
    assert found[row, column] < 0.15 * lit
    assert found[row + 12, column] > 0.9 * lit


def test_solo_leaves_one_shadow_of_two(opengl: moderngl.Context) -> None:
    state = on_ground(sun(90.0, 45.0, count=2))  # the other from behind: its shadow falls forward
    left, front = pixel(-1.9, 0.0), pixel(0.2, 1.6)
    both = radiance(opengl, state)
    state.selection.solo.add(0)
    first = radiance(opengl, state)
    lit = first[pixel(2.9, 0.9)[::-1]]
    # each shadow of two has the light of the other lamp
    assert both[left[::-1]] == pytest.approx(lit, rel=0.05)
    assert first[left[::-1]] < 0.05 * lit
    assert first[front[::-1]] == pytest.approx(lit, rel=0.05)


def test_a_wider_light_casts_a_softer_shadow(opengl: moderngl.Context) -> None:
    ramps = []
    for sharpness in (2e4, 20.0):
        tracks = sun(90.0, 45.0)
        tracks.lobes.sharpness[:] = sharpness
        found = radiance(opengl, on_ground(tracks))
        row = pixel(0.0, 0.0)[1]
        edge = found[row, pixel(-2.85, 0.0)[0] : pixel(-1.5, 0.0)[0]]
        share = (edge - edge.min()) / (edge.max() - edge.min())
        ramps.append(int(((share > 0.1) & (share < 0.9)).sum()))
    assert ramps[0] <= 3
    assert ramps[1] > 8


def test_the_ball_is_that_of_the_row(opengl: moderngl.Context, two_lamps: LobeTracks) -> None:
    """Seen level from the same side, a point of it shows what the row's ball shows there."""
    state = on_ground(two_lamps)
    state.camera.pitch_deg = 10.0
    x, y, size = ground_view(SIZE, 0.0, 10.0).ball_cell
    on_it = radiance(opengl, state)[y : y + size, x : x + size]
    state.scene = Scene.BALLS
    state.camera.pitch_deg += ground_blocks.PITCH_DEG
    renderer = Renderer(opengl)
    renderer.balls(state, (6 * 64, 64))
    row = renderer.radiance(state)[..., 1]
    # both have their brightest spot at the same place of the ball
    spots = []
    for image in (on_it, row[:, 3 * 64 : 4 * 64][6:-6, 6:-6]):
        place = np.argwhere(image > 0.9 * image.max()).mean(0)
        spots.append(place / image.shape)
    np.testing.assert_allclose(spots[0], spots[1], atol=0.05)


def test_the_ground_has_no_reference_and_no_probe(drive: Drive, two_lamps: LobeTracks) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.compare_with(grey(two_lamps))
        test.yield_(2)
        test.mouse_move("Balls/##picture")
        test.key_press(int(imgui.Key.g))
        test.yield_(2)
        assert state.scene is Scene.GROUND
        assert state.shown is Comparison.FIT
        assert state.inspected is None
        test.set_ref("Look")
        test.combo_click("ball/Lambert")
        assert state.ground_ball == 5
        test.set_ref("")
        test.key_press(int(imgui.Key.g))
        test.yield_(2)
        assert state.shown is Comparison.ROWS

    drive(script)


@pytest.mark.usefixtures("opengl")
def test_the_ground_can_be_asked_for_headless(stage_of_two_lamps: Path, tmp_path: Path) -> None:
    found = []
    for options in ([], ["--ground"]):
        path = tmp_path / f"{len(found)}.png"
        size = ["--bare", "--size", "320x220", "--screenshot", str(path)]
        assert main(["view", str(stage_of_two_lamps), *size, *options]) == 0
        pixels = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
        assert pixels is not None
        found.append(pixels)
    assert np.abs(found[0] - found[1]).mean() > 0.05
