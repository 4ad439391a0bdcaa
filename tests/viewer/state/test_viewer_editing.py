# SPDX-License-Identifier: Apache-2.0
"""Edits of several lobes, of a range of frames, and those that add, delete and rename."""

import colorsys
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from light_edits import scale_amplitude
from scipy.spatial.transform import Rotation
from usd_tracks import moving

from asglight.lobes import LobeTracks
from asglight.viewer.state.commands import command
from asglight.viewer.state.edits import acting, editing
from asglight.viewer.state.edits.absolute import lamp_of
from asglight.viewer.state.edits.applying import apply
from asglight.viewer.state.edits.edit import Add, Edit, Span
from asglight.viewer.state.edits.editing import Editing, Moment, Scope
from asglight.viewer.state.edits.history import EditHistory
from asglight.viewer.state.edits.hue import SATURATION_MAX, hue_of, with_hue
from asglight.viewer.state.viewer_state import MAX_LOBES, ViewerState

FRAMES = (1, 2, 3, 5, 6, 7, 8, 9, 10)
"""Frame 4 is missing: softness counts frames, not places."""


def test_a_soft_range_comes_and_goes_as_a_smoothstep_of_frames() -> None:
    weights = Span(4, 5, soft=3).weights(FRAMES)  # frames 6 and 7

    def falling(distance: float) -> float:
        t = min(distance / 4, 1)
        return 1 - 3 * t**2 + 2 * t**3

    wanted = [falling(max(6 - frame, frame - 7, 0)) for frame in FRAMES]
    np.testing.assert_allclose(weights, wanted, atol=1e-15)
    assert weights[4:6].tolist() == [1, 1]
    assert Span(4, 5).weights(FRAMES).tolist() == [0, 0, 0, 0, 1, 1, 0, 0, 0]


def test_a_soft_edit_is_that_share_of_it_in_each_frame() -> None:
    before = moving(FRAMES)
    span = Span(3, 4, soft=4)
    turned = Rotation.from_rotvec([0.9, -0.5, 0.3])
    x, y, z, w = (float(value) for value in turned.as_quat())
    edit = Edit(1, span, (1.0, -2.0, 0.5), (1.5, -1.0), (w, x, y, z))
    after = apply(before, edit)
    for place, share in enumerate(span.weights(FRAMES).tolist()):
        old, new = before.lobes[place, 1], after.lobes[place, 1]
        gain = 2.0 ** (share * np.array([1.0, -2.0, 0.5]))
        np.testing.assert_allclose(new.amplitude, old.amplitude.double().numpy() * gain, rtol=2e-7)
        power = 2.0 ** (share * np.array([1.5, -1.0]))
        np.testing.assert_allclose(new.sharpness, old.sharpness.double().numpy() * power, rtol=2e-7)
        part = Rotation.from_rotvec(share * turned.as_rotvec()).as_matrix()
        np.testing.assert_allclose(new.axes, old.axes.double().numpy() @ part.T, atol=5e-7)


@pytest.mark.parametrize(("first", "last", "soft"), [(2, 1, 0), (-1, 1, 0), (0, 1, -1)])
def test_a_span_of_no_meaning_cannot_be_made(first: int, last: int, soft: int) -> None:
    with pytest.raises(ValueError, match="span: "):
        Span(first, last, soft)


def test_the_scope_chooses_the_frames_and_a_range_is_edited_within() -> None:
    moment = Moment(2, 4, 6)
    hand = Editing()
    assert hand.span(moment) is None
    hand.scope = Scope.ONE
    assert hand.span(moment) == Span(2, 2)
    hand.scope, hand.soft = Scope.RANGE, 3
    assert hand.span(moment) == Span(4, 6, 3)
    assert not hand.reaches(moment)
    assert hand.reaches(Moment(5, 4, 6))


MOMENT = Moment(1, 0, 2)


@pytest.mark.parametrize(
    ("field", "change"),
    [("azimuth", 20.0), ("elevation", 5.0), ("roll", -30.0), ("intensity", 1.5)],
)
def test_selected_lobes_change_by_as_much_as_the_first(field: str, change: float) -> None:
    history = EditHistory(moving(range(3)))
    before = [getattr(lamp_of(history.tracks.lobes[1, lobe]), field) for lobe in range(3)]
    Editing().set_value(history, (2, 0), MOMENT, field, before[2] + change)
    after = [getattr(lamp_of(history.tracks.lobes[1, lobe]), field) for lobe in range(3)]
    moved = [math.remainder(new - old, 360) for old, new in zip(before, after, strict=True)]
    assert moved == pytest.approx([change, 0, change], abs=2e-4)


def test_selected_lobes_grow_and_are_tinted_alike() -> None:
    history = EditHistory(moving(range(3)))
    old = history.tracks.lobes
    lamp = lamp_of(old[1, 0])
    hand = Editing()
    hand.set_value(history, (0, 2), MOMENT, "width", lamp.width / 2)
    hand.commit(history)
    ratio = history.tracks.lobes.sharpness / old.sharpness
    assert float(ratio[1, 0, 0]) > 2
    torch.testing.assert_close(ratio[:, 2], ratio[:, 0])
    assert (ratio[:, 1] == 1).all()
    hand.set_colour(history, (0, 2), MOMENT, (1.0, 0.6, 0.3))
    tint = history.tracks.lobes.amplitude / old.amplitude
    torch.testing.assert_close(tint[:, 2], tint[:, 0])
    hand.commit(history)
    assert [len(step) for step in history.steps] == [2, 2]
    history.undo()
    history.undo()
    torch.testing.assert_close(history.tracks.lobes.sharpness, old.sharpness, rtol=0, atol=0)


def test_selected_lobes_turn_as_one_body() -> None:
    history = EditHistory(moving(range(3)))
    old = history.tracks.lobes
    hand = Editing()
    target = [0.0, 0.6, 0.8]
    hand.aim(history, (1, 2), MOMENT, target)
    new = history.tracks.lobes
    np.testing.assert_allclose(new.axis_z[1, 1], target, atol=5e-7)
    between = (old.axis_z[1, 1] * old.axis_z[1, 2]).sum()
    torch.testing.assert_close((new.axis_z[1, 1] * new.axis_z[1, 2]).sum(), between)


def test_lobes_are_added_deleted_renamed_and_all_of_it_is_undone() -> None:
    history = EditHistory(moving(range(3)))
    lobe = editing.add(history, 1, (0.0, 1.0, 0.0))
    assert lobe == 3
    assert history.names == ("lobe_00", "lobe_01", "lobe_02", "lobe_03")
    added = lamp_of(history.tracks.lobes[0, 3])
    assert added.elevation == pytest.approx(90)
    assert added.width == added.height == pytest.approx(15.03, abs=0.01)
    peaks = sorted(float(peak) for peak in history.original.lobes.amplitude[1].amax(-1))
    assert float(history.tracks.lobes.amplitude[2, 3, 0]) == pytest.approx(peaks[1])
    history.add(scale_amplitude(3, None, 1.0))
    editing.rename(history, 3, "practical ##1")
    editing.rename(history, 0, "lobe_00")  # its name already: no step
    assert history.position == 3
    assert history.names[3] == "practical ##1"
    editing.delete(history, (0, 3))
    assert history.present == (1, 2)
    assert not history.lit_tracks.lobes.amplitude[:, [0, 3]].any()
    before = history.tracks.lobes.amplitude
    history.go_to(0)
    assert history.names == ("lobe_00", "lobe_01", "lobe_02")
    assert history.present == (0, 1, 2)
    assert torch.equal(history.tracks.lobes.amplitude, history.original.lobes.amplitude)
    history.go_to(4)
    assert history.present == (1, 2)
    assert history.names[3] == "practical ##1"
    assert torch.equal(history.tracks.lobes.amplitude, before)


def test_a_lobe_is_brought_back_to_what_was_fitted_or_added() -> None:
    history = EditHistory(moving(range(3)))
    lobe = editing.add(history, 1, (1.0, 0.0, 0.0))
    first = history.tracks.lobes.amplitude[:, lobe].clone()
    for one in (0, lobe):
        history.add(scale_amplitude(one, None, 2.0))
        history.add(scale_amplitude(one, Span.at(1), 2.0))
    editing.restore(history, (0, lobe))
    lobes = history.tracks.lobes
    assert torch.equal(lobes.amplitude[:, 0], history.original.lobes.amplitude[:, 0])
    assert torch.equal(lobes.amplitude[:, lobe], first)
    history.undo()
    assert float(history.tracks.lobes.amplitude[1, lobe, 0]) == pytest.approx(
        16 * float(first[1, 0])
    )


def test_muting_several_makes_them_all_what_the_first_is_not() -> None:
    history = EditHistory(moving(range(3)), muted={1})
    assert history.muted == {1}
    assert not history.is_changed
    editing.toggle_mute(history, (0, 1))
    assert history.muted == {0, 1}
    editing.toggle_mute(history, (1, 0))
    assert history.muted == set()
    history.go_to(0)
    assert history.muted == {1}


def test_an_added_lobe_stays_the_last_when_its_stage_comes_with_more_lobes() -> None:
    history = EditHistory(moving(range(3)))
    editing.add(history, 0, (1.0, 0.0, 0.0))
    moved = history.over(moving(range(3)))
    assert moved.tracks.lobes.count == 4
    more = history.over(moving(range(3), lobes=5))
    assert more.tracks.lobes.count == 6
    assert more.edited_lobes == (5,)


def test_a_lobe_cannot_be_added_out_of_order() -> None:
    history = EditHistory(moving(range(3)))
    with pytest.raises(ValueError, match="lobe: 5 after 3"):
        history.add(Add(5, (0.0, 0.0, 1.0), 40.0, (1.0, 1.0, 1.0)))


def test_hue_and_saturation_are_those_of_python() -> None:
    random = np.random.default_rng(4)
    for colour in random.uniform(0.05, 3, (50, 3)).tolist():
        hue, saturation, _ = colorsys.rgb_to_hsv(*(value / max(colour) for value in colour))
        assert hue_of(colour) == pytest.approx((360 * hue, saturation))
        other = with_hue(colour, hue=200.0)
        assert hue_of(other) == pytest.approx((200, saturation))
        assert hue_of(with_hue(colour, saturation=0.25)) == pytest.approx((360 * hue, 0.25))
    assert min(with_hue((1.0, 0.5, 0.2), saturation=1.0)) == pytest.approx(1 - SATURATION_MAX)


def state_of(lobes: int = 4) -> ViewerState:
    return ViewerState(moving(range(3), lobes=lobes))


def test_selection_grows_shrinks_and_spans() -> None:
    state = state_of()
    state.select(2)
    acting.select_also(state, 0)
    assert state.selected == (0, 2)
    acting.select_also(state, 0)
    assert state.selected == (2,)
    acting.select_to(state, 1, [3, 1, 0, 2])
    assert state.selected == (2, 1, 0)
    acting.select_to(state, 3, [3, 1, 0, 2])
    assert state.selected == (2, 3, 1, 0)
    command("Delete the selected lobe").run(state)
    assert state.selected == ()
    assert state.history.present == ()
    command("Undo").run(state)
    command("Select every lobe").run(state)
    assert sorted(state.selected) == [0, 1, 2, 3]
    command("Solo the selected lobe").run(state)
    assert state.lit == (0, 1, 2, 3)
    command("Mute the selected lobe").run(state)
    assert state.lit == ()


def test_what_is_selected_and_undone_is_not_selected() -> None:
    state = state_of()
    command("Add a lobe at the pointer").run(state)
    assert state.selected == (4,)
    command("Undo").run(state)
    assert state.selected == ()
    command("Delete the selected lobe").run(state)
    assert state.message == "No lobe is selected. Click one in the map or in the list."


def test_no_lobe_is_added_while_a_fit_brings_some_or_without_room() -> None:
    state = state_of()
    state.is_fitting = True
    command("Add a lobe at the pointer").run(state)
    assert state.message == "Lobes can be added when the fit has ended."
    full = state_of(MAX_LOBES)
    command("Add a lobe at the pointer").run(full)
    assert full.message == f"No room: the viewer holds {MAX_LOBES} lobes."
    assert full.tracks.lobes.count == MAX_LOBES


def test_names_of_the_stage_are_what_lobes_are_called() -> None:
    tracks: LobeTracks = replace(moving(range(3)), display_names={"lobe_01": "sun"})
    history = EditHistory(tracks)
    assert history.names == ("lobe_00", "sun", "lobe_02")
    editing.rename(history, 1, "")
    assert history.names[1] == "lobe_01"
    assert history.saved_tracks.display_names == {}
    editing.rename(history, 2, "sky")
    assert history.saved_tracks.display_names == {"lobe_02": "sky"}
