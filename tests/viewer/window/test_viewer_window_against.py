# SPDX-License-Identifier: Apache-2.0
"""Two fits of a shot, A and B, in the real window and headless."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
import torch
import windows
from imgui_bundle import imgui
from PIL import Image
from windows import Driven, rendered

from asglight.cli.main import main
from asglight.cli.sources.opening import opened_in_window
from asglight.errors import InputError
from asglight.images import write_exr
from asglight.lobes import LobeTracks, asg
from asglight.usd import write_usd
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.state.commands import command
from asglight.viewer.state.compared.against import Against
from asglight.viewer.state.display import Comparison, Subject
from asglight.viewer.state.inspector import inspect_map
from asglight.viewer.state.viewer_state import MAX_LOBES, ViewerState

SIZE = (360, 180)


def other(tracks: LobeTracks, factor: float = 2.0) -> Against:
    """Return tracks that are brighter, as B."""
    lobes = replace(tracks.lobes, amplitude=factor * tracks.lobes.amplitude)
    return Against("b.usda", replace(tracks, lobes=lobes))


def test_the_difference_of_a_and_b_is_the_rest_of_the_light(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps)
    state.compare_against(other(two_lamps, 3.0))
    assert state.shown is Comparison.ROWS
    renderer = Renderer(opengl)
    renderer.balls(state, SIZE)
    rows = renderer.radiance(state)
    half = SIZE[1] // 2
    np.testing.assert_allclose(rows[half:], 3 * rows[:half], rtol=1e-4, atol=1e-6)
    assert rows[:half].max() > 0.1
    errors = renderer.ball_errors(state)
    assert errors == pytest.approx([2 / 3] * 6, rel=1e-3)  # |a - 3 a| / 3 a
    assert renderer.ball_errors(state, of_b=True) is None  # there is no truth to hold it against
    state.compared.comparison = Comparison.DIFFERENCE
    renderer.balls(state, SIZE)
    single = renderer.radiance(state)[45 : 45 + half]
    np.testing.assert_allclose(single, -2 * rows[:half], rtol=1e-4, atol=1e-6)


def test_both_have_their_errors_against_the_reference(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    state = ViewerState(two_lamps, windows.grey(two_lamps))
    assert state.references is not None
    state.references.look_at(1001, 0)
    assert state.references.wait(1001, 10) is not None
    state.compare_against(other(two_lamps))
    assert state.parts == 3
    renderer = Renderer(opengl)
    for _ in range(200):
        renderer.balls(state, SIZE)
        if renderer.reference_progress >= 1:
            break
    third = SIZE[1] // 3
    rows = renderer.radiance(state)
    a, b, truth = (rows[part * third : (part + 1) * third] for part in range(3))
    found = renderer.ball_errors(state), renderer.ball_errors(state, of_b=True)
    for picture, errors in zip((a, b), found, strict=True):
        wanted = [
            np.abs(picture - truth)[y : y + size, x : x + size].sum()
            / truth[y : y + size, x : x + size].sum()
            for x, y, size in cells((SIZE[0], third), 6)
        ]
        assert errors == pytest.approx(wanted, rel=1e-4)
    state.compared.subject = Subject.TOTAL
    assert state.parts == 2
    state.references.close()


def test_b_is_held_before_and_after_its_frames_and_is_continuous_between(
    two_lamps: LobeTracks,
) -> None:
    late = replace(two_lamps, frames=(1002, 1003, 1006))
    against = Against("late", late)
    assert torch.equal(against.lobes_at(1001).axes, late.lobes[0].axes)
    assert torch.equal(against.lobes_at(1010).axes, late.lobes[2].axes)
    assert torch.equal(against.lobes_at(1003).axes, late.lobes[1].axes)
    assert against.label(1001) == "B: late, held at 1002"
    assert against.label(1004) == "B: late"
    assert against.label(1006.5) == "B: late, held at 1006"
    alone = ViewerState(late)
    alone.playback.go_to_time(1004.5)
    assert torch.equal(against.lobes_at(1004.5).axes, alone.lobes.axes)


def test_the_inspector_reads_b_in_place_of_the_reference(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.compare_against(other(two_lamps))
    found = inspect_map(state, 0.25, 0.25)
    direction = torch.from_numpy(found.direction)
    wanted = asg.evaluate(two_lamps.lobes[0], direction[None].float())[0]
    np.testing.assert_allclose(found.fit, wanted, rtol=1e-5)
    np.testing.assert_allclose(found.reference, 2 * wanted, rtol=1e-5)


def test_subjects_are_those_that_there_are(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    assert state.subjects == ()
    state.compare_against(other(two_lamps))
    assert state.subject is Subject.AGAINST
    command("Overall, fit only, shading only or A and B").run(state)
    assert state.subject is Subject.AGAINST  # nothing else is there
    command("End A and B").run(state)
    assert state.against is None
    assert state.shown is Comparison.FIT
    with_images = ViewerState(two_lamps, windows.grey(two_lamps))
    with_images.compare_against(other(two_lamps))
    command("Overall, fit only, shading only or A and B").run(with_images)
    assert with_images.subject is Subject.TOTAL
    with_images.compare_with(None)


def test_b_with_too_many_lobes_is_refused(two_lamps: LobeTracks) -> None:
    lobes = two_lamps.lobes.select(torch.zeros(MAX_LOBES + 1, dtype=torch.long))
    state = ViewerState(two_lamps)
    with pytest.raises(InputError, match=f"{MAX_LOBES + 1} lobes; expected at most {MAX_LOBES}"):
        state.compare_against(Against("many", LobeTracks(two_lamps.frames, 24.0, lobes)))
    assert state.against is None


def test_b_is_opened_flipped_to_and_closed_in_the_window(
    opengl: moderngl.Context, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    stage = tmp_path / "b.usda"
    write_usd(other(two_lamps).tracks, stage)
    (tmp_path / "sky.exr").write_bytes(b"")
    ctrl, shift = int(imgui.Key.mod_ctrl), int(imgui.Key.mod_shift)

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.key_press(ctrl | int(imgui.Key.b))
        test.yield_(3)
        browser = driven.window.documents.browser
        assert browser is not None
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        driven.window.documents.open_against(str(tmp_path / "sky.exr"))
        assert state.message.startswith("sky.exr: images; expected a stage to be B.")
        driven.window.documents.open_against(str(tmp_path / "none.usda"))
        assert "none.usda: no such file" in state.message
        driven.window.documents.open_against(str(stage))
        assert state.message == "B is b.usda."
        test.yield_(3)
        state.compared.comparison = Comparison.FIT
        a = rendered(test, driven, tmp_path / "a.exr")
        test.key_down(int(imgui.Key.f))
        test.yield_(3)
        b = rendered(test, driven, tmp_path / "b.exr")
        test.key_up(int(imgui.Key.f))
        assert a.max() > 0.1
        np.testing.assert_allclose(b, 2 * a, rtol=2e-3, atol=1e-5)  # half floats
        test.key_press(shift | int(imgui.Key.b))
        test.yield_(2)
        assert state.against is None
        assert state.shown is Comparison.FIT

    windows.drive(two_lamps, script, opener=opened_in_window)
    opengl.__enter__()


@pytest.mark.usefixtures("opengl")
def test_headless_a_and_b_are_in_one_picture(two_lamps: LobeTracks, tmp_path: Path) -> None:
    a, b, out = (str(tmp_path / name) for name in ("a.usda", "b.usda", "ab.png"))
    write_usd(two_lamps, Path(a))
    write_usd(other(two_lamps, 0.0).tracks, Path(b))
    options = ["--against", b, "--screenshot", out, "--bare", "--size", "360x180"]
    assert main(["view", a, *options]) == 0
    pixels = np.asarray(Image.open(out).convert("RGB"), dtype=int)
    is_green = pixels[..., 1] - pixels[..., 0] > 60  # labels are white
    assert is_green[:80].sum() > 100  # the lamp of A
    assert is_green[80:].sum() == 0  # B is black


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sky.exr", "images; expected a stage. To compare with images: --reference"),
        ("none.usda", "none.usda: no such file; expected a USD stage."),
    ],
)
def test_what_cannot_be_b_is_said(
    two_lamps: LobeTracks,
    tmp_path: Path,
    name: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_usd(two_lamps, tmp_path / "a.usda")
    write_exr(tmp_path / "sky.exr", torch.ones(16, 32, 3))
    status = main(
        [
            "view",
            str(tmp_path / "a.usda"),
            "--against",
            str(tmp_path / name),
            "--screenshot",
            "x.png",
        ]
    )
    assert status == 2
    assert message in capsys.readouterr().err
