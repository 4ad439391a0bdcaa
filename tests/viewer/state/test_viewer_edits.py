# SPDX-License-Identifier: Apache-2.0
"""Edits do what they say to one lobe and to nothing else; undo and redo give the same bits."""

import math
import statistics
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from light_edits import scale_amplitude, scale_sharpness
from scipy.spatial.transform import Rotation
from usd_tracks import moving

from asglight.lobes import Form, LobeTracks, asg
from asglight.usd import read_usd, write_edit_layer, write_usd
from asglight.viewer.state.edits.applying import apply
from asglight.viewer.state.edits.edit import (
    LOG2_MAX,
    Edit,
    Span,
    shortest_rotation,
    turn,
)
from asglight.viewer.state.edits.history import EditHistory

FLOAT32 = 2e-7
"""Relative: the result is rounded to float32 once."""

FRAME_ROUNDING = 5e-7
"""Of a component: the axes that come in are a float32 rounding off a frame, and so is the result;
making them orthonormal spreads the one over the other axes."""

NAMES = ("axes", "sharpness", "amplitude")


def same_bits(one: LobeTracks, other: LobeTracks) -> bool:
    return one.frames == other.frames and all(
        torch.equal(getattr(one.lobes, name), getattr(other.lobes, name)) for name in NAMES
    )


def assert_only_changes(
    before: LobeTracks, after: LobeTracks, lobe: int, frame: int | None
) -> None:
    """Check that all but one lobe, in one frame or in all, keeps its bits."""
    kept = torch.ones(len(before.frames), before.lobes.count, dtype=torch.bool)
    kept[slice(None) if frame is None else frame, lobe] = False
    for name in NAMES:
        assert torch.equal(getattr(before.lobes, name)[kept], getattr(after.lobes, name)[kept])
    assert (after.frames, after.fps, after.metadata) == (
        before.frames,
        before.fps,
        before.metadata,
    )
    assert after.lobes.form is before.lobes.form


def touched(tracks: LobeTracks, lobe: int, frame: int | None, name: str) -> np.ndarray:
    rows = getattr(tracks.lobes, name)[slice(None) if frame is None else [frame], lobe]
    return rows.double().numpy()


@pytest.mark.parametrize("frame", [None, 2])
@pytest.mark.parametrize("form", Form)
def test_each_edit_changes_its_lobe_as_it_says(form, frame):
    span = None if frame is None else Span.at(frame)
    before = moving(range(5), form=form)
    copy = replace(before, lobes=before.lobes.clone())
    start, end = [0.1, 0.9, -0.3], [-0.5, 0.2, 0.8]

    brighter = apply(before, scale_amplitude(1, span, 1.5, (1.0, 0.5, 2.0)))
    assert_only_changes(before, brighter, 1, frame)
    factors = 2**1.5 * np.array([1.0, 0.5, 2.0])
    np.testing.assert_allclose(
        touched(brighter, 1, frame, "amplitude"),
        touched(before, 1, frame, "amplitude") * factors,
        rtol=FLOAT32,
    )
    assert torch.equal(brighter.lobes.axes, before.lobes.axes)
    assert torch.equal(brighter.lobes.sharpness, before.lobes.sharpness)

    sharper = apply(before, scale_sharpness(1, span, 2.0, 2.0 if form is Form.SG else -1.0))
    assert_only_changes(before, sharper, 1, frame)
    np.testing.assert_allclose(
        touched(sharper, 1, frame, "sharpness"),
        touched(before, 1, frame, "sharpness") * [4.0, 4.0 if form is Form.SG else 0.5],
        rtol=FLOAT32,
    )
    assert torch.equal(sharper.lobes.amplitude, before.lobes.amplitude)

    turned = apply(before, turn(1, span, start, end))
    assert_only_changes(before, turned, 1, frame)
    axis = np.cross(start, end)
    cosine = np.dot(start, end) / np.linalg.norm(start) / np.linalg.norm(end)
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arccos(cosine))
    wanted = touched(before, 1, frame, "axes") @ rotation.as_matrix().T
    np.testing.assert_allclose(touched(turned, 1, frame, "axes"), wanted, atol=FRAME_ROUNDING)
    assert torch.equal(turned.lobes.sharpness, before.lobes.sharpness)

    assert same_bits(before, copy)


def test_a_turn_takes_the_lobe_to_where_it_is_dragged():
    before = moving(range(3))
    target = torch.tensor([0.6, 0.0, -0.8])
    after = apply(before, turn(2, Span.at(1), before.lobes.axis_z[1, 2].tolist(), target.tolist()))
    np.testing.assert_allclose(after.lobes.axis_z[1, 2], target, atol=FRAME_ROUNDING)


@pytest.mark.thorough
@settings(max_examples=tries(60), deadline=None)
@given(
    start=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1),
    axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1),
    angle=st.one_of(st.floats(0, math.pi), st.sampled_from([0.0, 1e-9, math.pi - 1e-9, math.pi])),
)
def test_the_shortest_rotation_arrives_and_is_shortest(start, axis, angle):
    unit = np.array(start) / np.linalg.norm(start)
    across = np.cross(unit, axis)
    if np.linalg.norm(across) < 1e-3:
        return
    rotation = Rotation.from_rotvec(angle * across / np.linalg.norm(across))
    end = rotation.apply(unit)
    w, x, y, z = shortest_rotation(start, (3 * end).tolist())
    found = Rotation.from_quat([x, y, z, w])
    # within 1e-7 of a half turn the mean direction is lost and any half turn is taken
    np.testing.assert_allclose(found.apply(unit), end, atol=2e-7)
    assert found.magnitude() == pytest.approx(angle, abs=2e-7)


def test_scaled_sharpness_stays_within_the_limits_and_what_is_not_scaled_is_left():
    before = moving(range(3))
    before.lobes.sharpness[1, 0] = torch.tensor([2e7, 5.0])  # above the limit, as some file has it
    wide = apply(before, scale_sharpness(0, None, 0.0, -LOG2_MAX))
    assert torch.equal(wide.lobes.sharpness[:, 0, 0], before.lobes.sharpness[:, 0, 0])
    least = torch.full((3,), asg.SHARPNESS_MIN)
    torch.testing.assert_close(wide.lobes.sharpness[:, 0, 1], least, rtol=FLOAT32, atol=0)
    narrow = apply(before, scale_sharpness(0, None, LOG2_MAX, LOG2_MAX))
    assert (narrow.lobes.sharpness[:, 0] == asg.SHARPNESS_MAX).all()


def test_amplitude_stays_what_a_stage_can_hold(tmp_path):
    history = EditHistory(moving(range(2)))
    for _ in range(4):
        history.add(scale_amplitude(0, None, LOG2_MAX))
    write_usd(history.tracks, tmp_path / "bright.usda", dome_height=2)
    back = read_usd(tmp_path / "bright.usda")
    assert back.lobes.amplitude[:, 0].min() == torch.tensor(1e37)


def test_frames_stay_orthonormal_after_many_turns():
    history = EditHistory(moving(range(2)))
    for step in range(300):
        history.add(turn(0, None, [1.0, 0.1 * step, 0.0], [0.3, -0.5, step - 150.0]))
    axes = history.tracks.lobes.axes[:, 0].double()
    # one float32 rounding of each component, however many turns there were
    np.testing.assert_allclose(axes @ axes.mT, np.broadcast_to(np.eye(3), (2, 3, 3)), atol=3e-7)


LOBES, FRAMES = 3, 4

powers = st.floats(-5, 5, allow_nan=False)
one_edit = st.builds(
    Edit,
    lobe=st.integers(0, LOBES - 1),
    span=st.one_of(st.none(), st.builds(Span.at, st.integers(0, FRAMES - 1))),
    gain_log2=st.tuples(powers, powers, powers),
    sharpness_log2=st.tuples(powers, powers),
    rotation=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1),
)
operations = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(["add", "drag"]), one_edit),
        st.tuples(st.sampled_from(["undo", "redo", "commit", "cancel"]), st.none()),
    ),
    max_size=25,
)


@pytest.mark.thorough
@settings(max_examples=tries(60), deadline=None)
@given(operations)
def test_any_history_is_that_of_a_stack_of_whole_tracks(wanted):
    """The model keeps every state whole; the history must show the same bits at each step."""
    states, position, live = [moving(range(FRAMES), LOBES)], 0, None
    history = EditHistory(states[0])
    for operation, edit in wanted:
        (getattr(history, operation)(edit) if edit else getattr(history, operation)())
        if operation in ("add", "drag"):
            live = None if edit.is_identity else apply(states[position], edit)
        if operation in ("add", "commit") and live is not None:
            states = [*states[: position + 1], live]
            position, live = position + 1, None
        if operation == "undo" and live is None:
            position = max(0, position - 1)
        if operation == "redo" and live is None:
            position = min(len(states) - 1, position + 1)
        if operation in ("cancel", "undo"):
            live = None
        assert same_bits(history.tracks, states[position] if live is None else live)
        assert history.can_redo == (live is None and position < len(states) - 1)
        assert history.can_undo == history.is_changed == (position > 0 or live is not None)
        assert len(history.edits) == position + (live is not None)
    assert same_bits(history.original, moving(range(FRAMES), LOBES))


def test_a_hundred_edits_undone_and_redone_give_every_state_again():
    random = np.random.default_rng(3)
    history = EditHistory(moving(range(6)))
    states = [history.tracks]
    for step in range(100):
        start, end = random.normal(size=(2, 3))
        kinds = [
            scale_amplitude(step % 3, None, random.normal(), tuple(random.uniform(0, 2, 3))),
            scale_sharpness(step % 3, Span.at(int(random.integers(6))), *random.normal(size=2)),
            turn(int(random.integers(3)), None, start, end),
        ]
        history.add(kinds[int(random.integers(3))])
        states.append(history.tracks)
    for state in reversed(states[:-1]):
        history.undo()
        assert same_bits(history.tracks, state)
    assert not history.is_changed
    for state in states[1:]:
        history.redo()
        assert same_bits(history.tracks, state)


def test_a_drag_is_one_step():
    history = EditHistory(moving(range(3)))
    for stops in (0.1, 0.5, 1.0):
        history.drag(scale_amplitude(1, None, stops))
    assert history.edited_lobes == (1,)
    history.commit()
    history.commit()  # nothing is live any more
    np.testing.assert_allclose(
        history.tracks.lobes.amplitude[:, 1], 2 * history.original.lobes.amplitude[:, 1]
    )
    history.add(scale_amplitude(0, Span.at(2), 1.0))
    assert history.edited_lobes == (0, 1)
    history.undo()
    history.undo()
    assert history.edited_lobes == ()
    assert same_bits(history.tracks, history.original)


def test_a_drag_that_comes_back_to_where_it_began_is_no_step():
    history = EditHistory(moving(range(3)))
    history.drag(scale_amplitude(1, None, 0.5))
    history.drag(scale_amplitude(1, None, 0.0))
    history.commit()
    assert not history.can_undo
    history.add(turn(0, None, [0.0, 0.0, 2.0], [0.0, 0.0, 1.0]))
    assert not history.can_undo


@pytest.mark.parametrize(
    "values",
    [
        {"gain_log2": (math.nan, 0.0, 0.0)},
        {"gain_log2": (0.0, LOG2_MAX + 1, 0.0)},
        {"sharpness_log2": (0.0, -math.inf)},
        {"rotation": (0.0, 0.0, 0.0, 0.0)},
        {"rotation": (math.nan, 0.0, 0.0, 1.0)},
    ],
)
def test_an_edit_of_no_meaning_cannot_be_made(values):
    with pytest.raises(ValueError, match=r"powers of 2|quaternion"):
        Edit(0, **values)


def test_what_is_not_there_cannot_be_edited():
    history = EditHistory(moving(range(3), form=Form.SG))
    for edit, message in [
        (scale_amplitude(3, None, 1.0), "lobe: 3 of 3"),
        (scale_amplitude(-1, None, 1.0), "lobe: -1 of 3"),
        (scale_amplitude(0, Span.at(3), 1.0), "span: 3 to 3 of 3 frames"),
        (scale_sharpness(0, None, 1.0, 0.5), "expected equal ones for sg"),
    ]:
        with pytest.raises(ValueError, match=message):
            history.drag(edit)
    assert not history.is_changed


def test_edits_of_the_viewer_are_what_the_layer_gives_back(tmp_path):
    write_usd(moving(range(1001, 1006)), tmp_path / "fit.usda", dome_height=2)
    history = EditHistory(read_usd(tmp_path / "fit.usda"))
    history.add(turn(1, None, [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]))
    history.add(scale_amplitude(2, Span.at(3), -1.0, (1.0, 0.5, 0.25)))
    write_edit_layer(
        tmp_path / "edit.usda", tmp_path / "fit.usda", history.tracks, history.edited_lobes
    )
    back = read_usd(tmp_path / "edit.usda")
    # 1e-6 of samples left out, and rounding
    np.testing.assert_allclose(back.lobes.amplitude, history.tracks.lobes.amplitude, rtol=1.5e-6)
    np.testing.assert_allclose(back.lobes.axis_z, history.tracks.lobes.axis_z, atol=1.5e-6)


def test_a_drag_is_fast_enough_to_follow_the_mouse():
    """Fifteen lobes over ten seconds: under 2 ms, an eighth of a frame at 60 a second."""
    history = EditHistory(moving(range(240), lobes=15))
    seconds = []
    for step in range(30):
        start = time.process_time()
        history.drag(turn(step % 15, None, [0.0, 0.0, 1.0], [0.1, 0.01 * step, 1.0]))
        seconds.append(time.process_time() - start)
    assert statistics.median(seconds) < 0.002
