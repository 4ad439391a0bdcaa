# SPDX-License-Identifier: Apache-2.0
"""The renderer draws what has changed and nothing else, whatever the context looked like before."""

import threading
import weakref
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import pytest
import torch
from windows import grey

from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.display_pass import DisplayPass
from asglight.viewer.gl.draft import DIVISOR_MAX, FAST_S, SLOW_S, Draft, Stopwatch
from asglight.viewer.gl.passes import (
    LobesPass,
    Picture,
    display_target,
    radiance_target,
    target_texture,
)
from asglight.viewer.gl.renderer import Counts, Renderer
from asglight.viewer.state.balls import Material
from asglight.viewer.state.compared.against import Against
from asglight.viewer.state.display import Comparison, Display, Subject
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Scene
from asglight.viewer.uniforms.map_lobes import widened

SIZE = (96, 16)


def pixels(target: moderngl.Framebuffer) -> np.ndarray:
    width, height = target.size
    data = target.read(components=3, alignment=1)
    return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def with_grey(tracks: LobeTracks) -> ViewerState:
    """Return a state with a reference whose first image is there."""
    state = ViewerState(tracks, grey(tracks))
    assert state.references is not None
    state.references.wait(tracks.frames[0], 10)
    return state


def test_a_ratio_read_back_is_the_same_at_every_intensity(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_grey(two_lamps)
    state.compared.comparison = Comparison.RATIO
    renderer = Renderer(opengl)

    def read() -> np.ndarray:
        renderer.balls(state, SIZE)
        return renderer.radiance(state)

    state.is_dragging = True  # without noise
    read()  # the first has no reference yet
    first = read()
    assert 0.01 < first.max() < 1000
    state.environment.intensity_ev = 3.0
    np.testing.assert_array_equal(read(), first)
    state.compare_with(None)


def draw_of_everything(opengl: moderngl.Context, state: ViewerState) -> None:
    """Let a renderer make all that it has, and drop it."""
    renderer = Renderer(opengl)
    state.environment.is_shown = True
    for is_dragging in (False, False, True):
        state.is_dragging = is_dragging
        for subject in (Subject.TOTAL, Subject.SHADING):
            state.compared.subject = subject
            renderer.balls(state, SIZE)
    state.compare_against(Against("b", state.tracks))
    renderer.balls(state, SIZE)
    renderer.map(state, (32, 16))
    state.is_dragging = False
    renderer.scoped(state)
    state.scene = Scene.GROUND
    renderer.balls(state, SIZE)
    state.scene = Scene.BALLS


def test_renderers_that_are_dropped_leave_nothing_on_the_gpu(
    opengl: moderngl.Context, two_lamps: LobeTracks, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[weakref.ref[Any]] = []

    def recorded(make: Callable[..., Any]) -> Callable[..., Any]:
        def _recorded(*given: Any, **named: Any) -> Any:
            one = make(*given, **named)
            made.append(weakref.ref(one))
            return one

        return _recorded

    for name in ("buffer", "framebuffer", "program", "texture", "vertex_array"):
        monkeypatch.setattr(opengl, name, recorded(getattr(opengl, name)))
    state = with_grey(two_lamps)
    for _ in range(3):
        draw_of_everything(opengl, state)
        opengl.detect_framebuffer(0).use()  # what is bound stays
        waiting = len(opengl.objects)
        assert waiting > 50
        assert opengl.gc() == waiting
        assert not [one for one in made if one() is not None]
    Renderer(opengl).balls(state, SIZE)
    state.compare_with(None)


def test_a_renderer_that_is_dropped_in_another_thread_is_freed_in_that_of_its_context(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    held = [Renderer(opengl)]
    held[0].balls(ViewerState(two_lamps), SIZE)
    opengl.detect_framebuffer(0).use()
    opengl.gc()
    dropping = threading.Thread(target=held.clear)
    dropping.start()
    dropping.join()
    assert len(opengl.objects) > 20
    another = Renderer(opengl)
    another.balls(ViewerState(two_lamps), SIZE)  # which frees them
    assert len(opengl.objects) < 10  # of its own targets of one pixel


def test_only_what_changes_the_light_shades_anew(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)
    renderer = Renderer(opengl)

    def drawn() -> tuple[int, int]:
        before = renderer.counts
        renderer.balls(state, SIZE)
        after = renderer.counts
        return after.shaded - before.shaded, after.displayed - before.displayed

    assert renderer.counts == Counts(0, 0)
    assert drawn() == (1, 1)
    assert drawn() == (0, 0)
    state.display.expose(1.0)
    assert drawn() == (0, 1)
    state.environment.intensity_ev = 1.0
    assert drawn() == (0, 1)
    state.environment.is_shown = True
    assert drawn() == (0, 1)
    state.playback.step(1)
    assert drawn() == (1, 1)
    state.toggle_mute(0)
    assert drawn() == (1, 1)
    state.camera.orbit(5, 0)
    assert drawn() == (1, 1)
    state.material = Material.DIELECTRIC
    assert drawn() == (1, 1)


def test_every_size_of_a_dragged_window_is_drawn(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    renderer, state = Renderer(opengl), with_grey(two_lamps)
    for size in ((30, 20), (31, 20), (500, 300), (1, 1)):
        assert renderer.balls(state, size).size == size
        assert renderer.map(state, size).size == size
    state.compare_with(None)


def test_passes_draw_right_after_another_user_of_the_context_left_its_state(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)
    assert state.meter()
    clean = Renderer(opengl).balls(state, SIZE).read()
    assert max(clean) > 100
    opengl.enable(moderngl.BLEND | moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    opengl.blend_func = moderngl.ZERO, moderngl.ONE
    opengl.viewport = (0, 0, 1, 1)
    assert Renderer(opengl).balls(state, SIZE).read() == clean


def test_the_lit_side_of_the_balls_faces_the_lamp(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)  # green at u = 1/4, v = 1/4: from the right, above
    state.meter()
    picture = pixels(Renderer(opengl).balls(state, (6 * 64, 64))).astype(int)
    cell = cells((6 * 64, 64), 6)[-1]
    ball = picture[cell.y : cell.y + cell.size, cell.x : cell.x + cell.size]
    rows, columns = np.nonzero(ball[..., 1] > 100)
    assert rows.mean() < 0.45 * cell.size
    assert columns.mean() > 0.55 * cell.size


def test_muted_and_solo_lobes_light_accordingly(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)
    renderer = Renderer(opengl)
    state.selection.solo.add(1)  # the red one
    lit = pixels(renderer.map(state, (512, 256))).reshape(-1, 3).max(0)
    assert lit.tolist()[0] > 200
    assert lit.tolist()[1:] == [0, 0]
    state.toggle_mute(1)
    assert pixels(renderer.map(state, (512, 256))).max() == 0


def test_rows_show_the_fit_above_the_reference(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_grey(two_lamps)
    state.selection.solo.add(1)  # red light only: the reference alone has green
    renderer = Renderer(opengl)
    for _ in range(4):
        picture = pixels(renderer.balls(state, (96, 32))).astype(int)
    surround = picture[0, 0]
    above, below = picture[:16] - surround, picture[16:] - surround
    assert above[..., 1].max() <= 0
    assert below[..., 1].max() > 100
    state.compare_with(None)


def test_reference_is_grey_under_a_grey_map_and_its_errors_are_told(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_grey(two_lamps)
    state.compared.comparison = Comparison.WIPE
    renderer = Renderer(opengl)
    while renderer.reference_progress < 1 or renderer.ball_errors(state) is None:
        renderer.balls(state, SIZE)
    columns, rows = SIZE[0], SIZE[1] // 2  # of the strip
    lambert = cells((columns, rows), 6)[-1]
    x, y = lambert.x + lambert.size / 2, lambert.y + lambert.size / 2
    _, found = renderer.pixel(x / columns, y / rows)
    assert found is not None
    # the shader's moments of a constant map are those of 16 x 32 texels
    np.testing.assert_allclose(found, 0.5, rtol=5e-3)
    errors = renderer.ball_errors(state)
    assert errors is not None
    assert all(error is not None and error > 0.5 for error in errors)  # lamps are not a grey map
    state.compare_with(None)


def test_shading_error_of_the_lobes_is_small(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_grey(two_lamps)
    state.compared.comparison, state.compared.subject = Comparison.WIPE, Subject.SHADING
    renderer = Renderer(opengl)
    size = (6 * 32, 32)
    while renderer.reference_progress < 1 or renderer.ball_errors(state) is None:
        renderer.balls(state, size)
    errors = renderer.ball_errors(state)
    assert errors is not None
    assert errors[3] is not None
    assert errors[3] < 0.1
    assert errors[5] is not None
    assert errors[5] < 0.02
    state.compare_with(None)


def test_a_picture_that_is_not_shown_is_not_waited_for(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = with_grey(two_lamps)
    renderer = Renderer(opengl)
    for subject in Subject:
        state.compared.subject = subject
        renderer.balls(state, SIZE)
        renderer.balls(state, SIZE)
        assert 0 < renderer.reference_progress < 1
    state.compared.subject, state.compared.comparison = Subject.TOTAL, Comparison.FIT
    renderer.balls(state, SIZE)
    assert renderer.reference_progress == 1
    state.compare_with(None)


def test_nothing_to_compare_with_has_no_errors(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    renderer, state = Renderer(opengl), ViewerState(two_lamps)
    assert renderer.ball_errors(state) is None
    assert renderer.pixel(0.5, 0.5) == (None, None)
    renderer.balls(state, SIZE)
    assert renderer.ball_errors(state) is None


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("sharpness", [3.0, 1e3, 1e6])
def test_lobes_of_any_width_keep_their_flux_on_the_map(
    opengl: moderngl.Context, form: Form, sharpness: float
) -> None:
    axis_z = torch.tensor([0.3, 0.2, 0.9])
    axes = torch.linalg.qr(torch.stack([axis_z, torch.eye(3)[0], torch.eye(3)[1]], dim=1)).Q.T
    axes = torch.stack([axes[1], torch.linalg.cross(axes[0], axes[1]), axes[0]])
    lobes = Lobes(axes[None], torch.full((1, 2), sharpness), torch.ones(1, 3), form)
    rows = 64
    target = radiance_target(opengl, (2 * rows, rows))
    LobesPass(opengl).draw(widened(lobes, rows), target)
    shape = rows, 2 * rows, 4
    image = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(shape)
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    solid_angle = (edges[:-1] - edges[1:]) * np.pi / rows
    flux = (image[..., 0].sum(1) * solid_angle).sum()
    expected = float(asg.integral(lobes)[0])
    assert flux == pytest.approx(expected, rel=0.03)  # as widened() promises, and both axes


def test_a_coarse_picture_does_not_show_one_edge_at_the_other(opengl: moderngl.Context) -> None:
    coarse = radiance_target(opengl, (4, 2))
    values = np.zeros((2, 4, 4), np.float32)
    values[..., 3] = values[:, 3, :3] = 1.0  # white on the right
    target_texture(coarse).write(values.tobytes())
    shown = display_target(opengl, (16, 8))
    DisplayPass(opengl).draw(
        Picture(target_texture(coarse)), None, Display(), Comparison.FIT, shown
    )
    assert (pixels(shown)[:, :8] == 0).all()
    assert (pixels(shown)[:, 14:] == 255).all()


def test_draft_becomes_coarse_when_slow_and_fine_when_fast() -> None:
    draft = Draft()
    for expected in (2, 3, 4, DIVISOR_MAX):
        draft.took(1.1 * SLOW_S)
        assert draft.divisor == expected
    draft.took((SLOW_S + FAST_S) / 2)
    assert draft.divisor == DIVISOR_MAX
    for expected in (3, 2, 1, 1):
        draft.took(0.9 * FAST_S)
        assert draft.divisor == expected
    draft.took(None)
    assert draft.divisor == 1


def test_draft_is_drawn_while_something_moves_and_the_picture_is_fine_again_after(
    opengl: moderngl.Context, two_lamps: LobeTracks, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = ViewerState(two_lamps)
    state.meter()
    renderer = Renderer(opengl)
    fine = pixels(renderer.balls(state, (384, 64)))
    monkeypatch.setattr(Stopwatch, "seconds", lambda self: 2 * SLOW_S)
    renderer.learn()
    state.is_dragging = True
    np.testing.assert_array_equal(pixels(renderer.balls(state, (384, 64))), fine)  # all at rest
    state.camera.orbit(1e-9, 0)
    coarse = pixels(renderer.balls(state, (384, 64)))
    difference = np.abs(coarse.astype(int) - fine).mean()
    assert 0.1 < difference < 10  # another picture, of the same balls
    state.is_dragging = False
    np.testing.assert_array_equal(pixels(renderer.balls(state, (384, 64))), fine)


def test_stopwatch_measures_once(opengl: moderngl.Context, two_lamps: LobeTracks) -> None:
    state, renderer, stopwatch = ViewerState(two_lamps), Renderer(opengl), Stopwatch(opengl)
    assert stopwatch.seconds() is None
    times = []
    for frame in (1001, 1002, 1004):
        state.playback.go_to(frame)
        with stopwatch:
            renderer.balls(state, (384, 64))
        opengl.finish()
        times.append(stopwatch.seconds())
    assert stopwatch.seconds() is None
    assert any(seconds is not None and 0 < seconds < 4 for seconds in times[1:])


def test_screens_that_wait_show_what_was_wanted_when_it_was_wanted(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)
    at_once = Renderer(opengl)
    expected = [pixels(show(state, SIZE)) for show in (at_once.balls, at_once.map)]
    waiting = Renderer(opengl, screens_wait=True)
    targets = waiting.balls(state, SIZE), waiting.map(state, SIZE)
    assert waiting.counts.displayed == 0
    state.display.expose(3.0)  # a panel that comes later changes the next picture, not this one
    waiting.draw_screens()
    assert waiting.counts.displayed == 2
    for target, picture in zip(targets, expected, strict=True):
        assert len(np.unique(picture)) > 5  # shades of a light, not one colour
        np.testing.assert_array_equal(pixels(target), picture)
    waiting.draw_screens()
    assert waiting.counts.displayed == 2
