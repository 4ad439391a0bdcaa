# SPDX-License-Identifier: Apache-2.0
"""What is shown while something moves, and that balls stay where they are whatever is compared."""

import moderngl
import numpy as np
import pytest

from asglight.lobes import LobeTracks
from asglight.luminance import LUMINANCE
from asglight.viewer.gl.arrangement import cells, drawn_areas, strip
from asglight.viewer.gl.display_pass import DIVERGING_SCALE, scale_colours
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.uniforms.shader_defines import SURROUND

SIZE = (6 * 48, 2 * 48)


def with_lamps(tracks: LobeTracks) -> ViewerState:
    """Return a state whose reference is a sky with a sun and a lamp."""
    radiance = np.full((64, 128, 3), 0.2, np.float32)
    radiance[14:16, 40:42] = 900.0
    radiance[30:36, 90:100] = [20.0, 8.0, 2.0]
    state = ViewerState(tracks, Reference("lamps", tracks.frames, lambda frame: radiance))
    assert state.references is not None
    state.references.wait(tracks.frames[0], 10)
    state.compared.comparison = Comparison.REFERENCE
    return state


def reference_balls(renderer: Renderer, state: ViewerState) -> list[np.ndarray]:
    """Return each ball of the reference.  6 of [S, S, 3]."""
    renderer.balls(state, SIZE)
    radiance = renderer.radiance(state)
    top, rows = strip(SIZE[1], state.parts)
    return [
        radiance[top + y : top + y + size, x : x + size] for x, y, size in cells((SIZE[0], rows), 6)
    ]


def test_in_motion_all_but_the_sharpest_balls_are_those_at_rest_and_those_have_their_light(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_lamps(two_lamps)
    renderer = Renderer(opengl)
    renderer.balls(state, SIZE)
    while renderer.reference_progress < 1:
        rest = reference_balls(renderer, state)
    rest = reference_balls(renderer, state)
    state.is_dragging = True
    state.camera.orbit(1e-6, 0.0)
    moving = reference_balls(renderer, state)
    assert renderer.reference_progress == 1  # nothing is waited for
    assert renderer.ball_errors(state) is None
    for index, (before, now) in enumerate(zip(rest, moving, strict=True)):
        error = np.abs(before - now).sum() / before.sum()
        if index >= 2:  # roughness 0.25, 0.5, 1, Lambert: under lamps, where a preview is hardest
            assert error < (0.05 if index == 2 else 0.03)
        assert now.sum() == pytest.approx(before.sum(), rel=0.15)
    again = reference_balls(renderer, state)
    np.testing.assert_array_equal(np.stack(moving), np.stack(again))  # no noise
    state.compare_with(None)


def test_balls_stay_where_they_are_whatever_is_compared(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_lamps(two_lamps)
    renderer = Renderer(opengl)
    surround = np.round(255 * np.array(SURROUND))
    columns = []
    for comparison in Comparison:
        state.compared.comparison = comparison
        for _ in range(4):
            target = renderer.balls(state, SIZE)
        pixels = np.frombuffer(target.read(components=3, alignment=1), np.uint8)
        shown = np.abs(pixels.reshape(SIZE[1], SIZE[0], 3) - surround).max(-1) > 4
        # the widest row of balls: where each begins and ends
        row = shown[shown.sum(1).argmax()]
        columns.append(np.flatnonzero(np.diff(row.astype(int))))
    for found in columns:
        assert len(found) == 12
        np.testing.assert_allclose(found, columns[0], atol=1)
    state.compare_with(None)


def test_only_parts_with_balls_are_drawn_and_they_hold_them_whole() -> None:
    area = (10, 20, 600, 100)
    for size in ((600, 100), (300, 50), (151, 26)):
        parts = drawn_areas(size, 6, area)
        scale = area[2] / size[0], area[3] / size[1]
        for part, cell in zip(parts, cells(size, 6), strict=True):
            x, y, columns, rows = part
            assert x <= 10 + cell.x * scale[0]
            assert x + columns >= 10 + (cell.x + cell.size) * scale[0]
            assert y <= 20 + cell.y * scale[1]
            assert y + rows >= 20 + (cell.y + cell.size) * scale[1]
            assert x >= 10
            assert y >= 20
            assert x + columns <= 610
            assert y + rows <= 120


def test_where_nothing_differs_a_difference_is_darker_than_what_is_around_the_balls() -> None:
    colours = scale_colours(DIVERGING_SCALE) / 255
    middle = colours[127:129] @ LUMINANCE
    assert middle.max() < np.array(SURROUND) @ LUMINANCE
    # both ends are bright, and it grows brighter all the way
    brightness = colours @ LUMINANCE
    assert min(brightness[0], brightness[-1]) > 0.6
    assert (np.diff(brightness[130:]) > -0.01).all()
    assert (np.diff(brightness[:125]) < 0.01).all()
