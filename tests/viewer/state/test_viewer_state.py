# SPDX-License-Identifier: Apache-2.0
"""The viewer's state, its commands and what lies under the pointer; no OpenGL, no window."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from places import ROOT
from windows import grey

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.viewer.gl.arrangement import cells, hit, mirroring
from asglight.viewer.state.commands import COMMANDS, command
from asglight.viewer.state.display import EXPOSURE_EV_MAX, Comparison, Display
from asglight.viewer.state.edits import acting
from asglight.viewer.state.edits.absolute import lamp_of
from asglight.viewer.state.edits.editing import Moment, Scope
from asglight.viewer.state.inspector import angles_deg, inspect_ball, inspect_map, stops
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request


def test_lobes_are_those_of_the_frame(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.playback.go_to(1004)
    torch.testing.assert_close(state.lobes.axes, two_lamps.at(1004).axes)


def test_exposure_stops_at_its_ends() -> None:
    display = Display()
    display.expose(1e9)
    assert display.exposure_ev == EXPOSURE_EV_MAX
    display.expose(-1e9)
    assert display.exposure_ev == -EXPOSURE_EV_MAX


def test_more_lobes_than_the_viewer_holds_are_refused() -> None:
    lobes = Lobes(torch.eye(3).expand(1, 129, 3, 3), torch.ones(1, 129, 2), torch.ones(1, 129, 3))
    with pytest.raises(InputError, match=r"^tracks: 129 lobes; expected at most 128"):
        ViewerState(LobeTracks((1,), 24.0, lobes))
    flat = Lobes(lobes.axes[:, :86], lobes.sharpness[:, :86], lobes.amplitude[:, :86], Form.FLAT)
    with pytest.raises(InputError, match=r"^tracks: 86 lobes; expected at most 85"):
        ViewerState(LobeTracks((1,), 24.0, flat))


def test_the_brightest_lobe_is_selected_at_first(two_lamps: LobeTracks) -> None:
    # equal but for their colour: of the same radiance, green has more luminance than red
    assert ViewerState(two_lamps).selection.lobe == 0
    empty = two_lamps.lobes.select(torch.tensor([], dtype=torch.long))
    state = ViewerState(LobeTracks(two_lamps.frames, 24.0, empty))
    assert state.selection.lobe is None
    state.replace_tracks(two_lamps)  # as when a live fit has its first frame
    assert state.selection.lobe == 0


@pytest.mark.parametrize(
    ("solo", "muted", "lit"),
    [((), (), (0, 1)), ((), (1,), (0,)), ((1,), (), (1,)), ((1,), (1,), ()), ((), (0, 1), ())],
)
def test_solo_and_mute_decide_which_lobes_light(
    two_lamps: LobeTracks, solo: tuple[int, ...], muted: tuple[int, ...], lit: tuple[int, ...]
) -> None:
    state = ViewerState(two_lamps)
    state.selection.solo.update(solo)
    for lobe in muted:
        state.toggle_mute(lobe)
    assert state.lit == lit
    torch.testing.assert_close(state.lit_lobes.axes, state.lobes.axes[list(lit)])


def test_a_solo_of_a_lobe_that_is_undone_leaves_the_others_lit(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    acting.add_lobe(state, (0.0, 0.0, 1.0))
    acting.toggle_solo(state, state.selected)
    assert state.lit == (2,)
    state.history.undo()
    assert state.lit == (0, 1)
    state.history.redo()
    assert state.lit == (2,)


def test_metering_brings_the_mean_radiance_to_middle_grey(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.environment.intensity_ev = 1.0
    assert state.meter()
    flux = asg.flux(state.lobes).sum(0) @ torch.tensor([0.2126, 0.7152, 0.0722])
    exposed = float(flux) / (4 * math.pi) * 2.0 ** (state.display.exposure_ev + 1)
    assert abs(math.log2(exposed / 0.18)) <= 0.25  # half a step of the key
    state.toggle_mute(0)
    state.toggle_mute(1)
    assert not state.meter()


def test_without_a_reference_the_fit_is_shown(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.compared.comparison = Comparison.WIPE
    assert state.shown is Comparison.FIT
    state.compare_with(grey(two_lamps))
    assert state.shown is Comparison.ROWS
    state.compare_with(None)
    assert state.shown is Comparison.FIT


@pytest.mark.parametrize("comparison", list(Comparison))
def test_flipping_shows_the_other_picture(two_lamps: LobeTracks, comparison: Comparison) -> None:
    state = ViewerState(two_lamps, grey(two_lamps))
    state.compared.comparison = comparison
    state.compared.is_flipped = True
    is_reference = comparison is Comparison.REFERENCE
    assert state.shown is (Comparison.FIT if is_reference else Comparison.REFERENCE)
    state.compare_with(None)


def test_no_two_commands_share_a_key_or_a_name() -> None:
    keys = [entry.keys for entry in COMMANDS]
    assert len(set(keys)) == len(keys)
    assert "F" not in keys  # held to flip
    assert len({entry.name for entry in COMMANDS}) == len(COMMANDS)


def test_the_manual_lists_every_key() -> None:
    manual = (ROOT / "docs" / "guides" / "viewer.md").read_text()
    for entry in COMMANDS:
        assert f"| `{entry.keys}` | {entry.name} |" in manual


@pytest.mark.parametrize("entry", COMMANDS, ids=lambda entry: entry.name)
def test_every_command_runs_on_any_state(two_lamps: LobeTracks, entry: object) -> None:
    empty = two_lamps.lobes.select(torch.tensor([], dtype=torch.long))
    for tracks in (two_lamps, LobeTracks(two_lamps.frames, 24.0, empty)):
        state = ViewerState(tracks)
        entry.run(state)  # type: ignore[attr-defined]
        assert state.playback.frame in tracks.frames


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "Next comparison",
            "Nothing to compare with. Drop an HDR image or sequence on the window, or open "
            "another stage as B.",
        ),
        ("Solo the selected lobe", "No lobe is selected. Click one in the map or in the list."),
        ("Mute the selected lobe", "No lobe is selected. Click one in the map or in the list."),
        ("Undo", "Nothing to undo."),
        ("Redo", "Nothing to do again."),
    ],
)
def test_commands_without_effect_say_so(two_lamps: LobeTracks, name: str, message: str) -> None:
    state = ViewerState(two_lamps)
    state.select(None)
    command(name).run(state)
    assert state.message == message


def test_metering_the_dark_says_so(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.toggle_mute(0)
    state.toggle_mute(1)
    command("Expose the mean radiance to middle grey").run(state)
    assert state.message == "No light to meter."


def test_file_commands_ask_the_window(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    for name in ("Open", "Save the edits as a layer", "Save the picture"):
        command(name).run(state)
    assert state.requests == [Request.OPEN, Request.SAVE_EDITS, Request.SAVE_PICTURE]


def test_undo_and_redo_go_through_the_history(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    stops = lamp_of(state.lobes[0]).intensity
    state.editing.set_value(state.history, (0,), state.moment, "intensity", stops + 1)
    state.editing.commit(state.history)
    torch.testing.assert_close(state.lobes.amplitude[0], 2 * two_lamps.lobes.amplitude[0, 0])
    command("Undo").run(state)
    assert state.message == "Undone."
    torch.testing.assert_close(state.lobes.amplitude, two_lamps.lobes.amplitude[0])
    command("Redo").run(state)
    assert state.message == "Done again."
    torch.testing.assert_close(state.lobes.amplitude[0], 2 * two_lamps.lobes.amplitude[0, 0])


@pytest.mark.parametrize("form", list(Form))
def test_controls_change_the_lobe_of_the_shown_frame(two_lamps: LobeTracks, form: Form) -> None:
    tracks = replace(two_lamps, lobes=replace(two_lamps.lobes, form=form))
    state = ViewerState(tracks)
    state.editing.scope = Scope.ONE
    lamp = lamp_of(state.tracks.lobes[2, 1])
    state.editing.set_value(state.history, (1,), Moment(2, 0, 2), "intensity", lamp.intensity - 2)
    state.editing.commit(state.history)
    wanted = tracks.lobes.amplitude.clone()
    wanted[2, 1] /= 4
    torch.testing.assert_close(state.tracks.lobes.amplitude, wanted)
    state.editing.set_value(state.history, (1,), Moment(2, 0, 2), "width", lamp.width / 2)
    narrow = lamp_of(state.tracks.lobes[2, 1])
    assert narrow.width == pytest.approx(lamp.width / 2, rel=1e-4)
    height = lamp.height / 2 if form is Form.SG else lamp.height
    assert narrow.height == pytest.approx(height, rel=1e-4)
    assert state.history.edited_lobes == (1,)


@pytest.mark.parametrize(
    ("size", "side", "columns"), [((600, 100), 80, 6), ((300, 200), 80, 3), ((100, 900), 80, 1)]
)
def test_balls_are_as_large_as_they_fit(size: tuple[int, int], side: int, columns: int) -> None:
    arrangement = cells(size, 6)
    assert len({cell.x for cell in arrangement}) == columns
    assert {cell.size for cell in arrangement} == {side}
    for x, y, _ in arrangement:
        assert 0 <= x <= size[0] - side
        assert 0 <= y <= size[1] - side
    pairs = [(a, b) for a in arrangement for b in arrangement if a is not b]
    assert all(abs(a.x - b.x) >= side or abs(a.y - b.y) >= side for a, b in pairs)


def test_a_picture_of_one_pixel_still_has_its_balls() -> None:
    assert all(cell.size == 1 for cell in cells((1, 1), 6))


def test_the_middle_of_a_ball_faces_the_camera_and_its_edge_does_not() -> None:
    arrangement = cells((600, 100), 6)
    x, y, side = arrangement[2]
    middle = hit(arrangement, x + side / 2, y + side / 2)
    assert middle is not None
    assert middle.ball == 2
    np.testing.assert_allclose(middle.normal, [0, 0, 1])
    np.testing.assert_allclose(middle.mirrored, [0, 0, 1])
    # where the normal leans by 45 degrees, a mirror shows what lies at right angles
    up = hit(arrangement, x + side / 2, y + side / 2 * (1 - math.sqrt(0.5)))
    assert up is not None
    np.testing.assert_allclose(up.mirrored, [0, 1, 0], atol=1e-12)
    assert hit(arrangement, x, y) is None


def test_the_map_is_inspected_in_numbers(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps, grey(two_lamps))
    assert state.references is not None
    state.references.wait(1001, 10)
    state.environment.intensity_ev = 1.0
    found = inspect_map(state, 0.25, 0.25)  # the centre of the green lamp
    np.testing.assert_allclose(found.direction, [math.sqrt(0.5), math.sqrt(0.5), 0], atol=1e-6)
    assert found.fit is not None
    np.testing.assert_allclose(found.fit, [0, 1.8, 0], atol=1e-5)  # twice 0.9, float32
    np.testing.assert_allclose(found.reference, [1, 1, 1])
    assert found.shares == [(0, pytest.approx(1.0))]
    longitude, latitude = angles_deg(found.direction)
    assert (longitude, latitude) == (pytest.approx(90), pytest.approx(45))
    state.compare_with(None)


def test_a_ball_is_inspected_where_its_mirror_looks(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.camera.yaw_deg = 90  # the camera stands at +X
    arrangement = cells((600, 100), 6)
    x, y, side = arrangement[0]
    middle = hit(arrangement, x + side / 2, y + side / 2)
    assert middle is not None
    found = inspect_ball(state, "roughness 0.05", middle, np.array([0.2, 0.4, 0.6]), None)
    np.testing.assert_allclose(found.direction, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.fit, [0.2, 0.4, 0.6])
    assert found.reference is None


def test_stops_count_from_middle_grey() -> None:
    assert stops(np.array([0.72, 0.72, 0.72])) == pytest.approx(2)
    assert stops(np.zeros(3)) == -math.inf


def test_a_ball_mirrors_a_direction_where_it_is_hit() -> None:
    (cell,) = cells((100, 100), 1)
    for x, y in ((20.0, 60.0), (50.0, 50.0), (70.0, 30.0)):
        found = hit([cell], x, y)
        assert found is not None
        np.testing.assert_allclose(mirroring(found.mirrored), found.normal, atol=1e-12)
    assert mirroring(np.array([0.0, 0.0, -1.0])) is None  # right behind: only the rim mirrors it
