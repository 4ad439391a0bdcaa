# SPDX-License-Identifier: Apache-2.0
"""Views of OpenColorIO: shader against processor and the sRGB formula, and every message."""

from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import PyOpenColorIO
import pytest
from windows import Drive, Driven

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.viewer.colour import opencolorio
from asglight.viewer.gl.display_pass import DisplayPass
from asglight.viewer.gl.passes import Picture, display_target
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.state.display import ColourView, Comparison, Display, ViewTransform
from asglight.viewer.state.viewer_state import ViewerState

VIEWS = [
    ColourView(),
    ColourView("ACES 2.0", "Display P3 - Display", "ACES 2.0 - SDR 100 nits (P3 D65)"),
    ColourView("ACES 1.3", "sRGB - Display", "ACES 1.0 - SDR Video"),
    ColourView("ACES 1.3", "Display P3 - Display", "Un-tone-mapped"),
]

PLAIN = ColourView("ACES 2.0", "sRGB - Display", "Un-tone-mapped")


def colours() -> np.ndarray:
    """Return greys and colours from black to far above white.  [16, 16, 3]."""
    generator = np.random.default_rng(0)
    values = np.geomspace(1e-3, 50, 256)[:, None] * generator.uniform(0.05, 1, (256, 3))
    values[::4] = values[::4, :1]
    values[0] = 0
    return values.reshape(16, 16, 3).astype(np.float32)


def displayed(opengl: moderngl.Context, radiance: np.ndarray, display: Display) -> np.ndarray:
    height, width = radiance.shape[:2]
    rgba = np.concatenate([radiance, np.ones((height, width, 1), np.float32)], axis=-1)
    front = opengl.texture((width, height), 4, rgba.tobytes(), dtype="f4")
    target = display_target(opengl, (width, height))
    DisplayPass(opengl).draw(Picture(front), None, display, Comparison.FIT, target)
    pixels = np.frombuffer(target.read(components=3, alignment=1), np.uint8)
    return pixels.reshape(height, width, 3)


def shown_by(view: ColourView, exposure_ev: float = 0.0) -> Display:
    return Display(exposure_ev, ViewTransform.OPENCOLORIO, colour_view=view)


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_the_shader_shows_what_the_processor_does(
    opengl: moderngl.Context, view: ColourView
) -> None:
    radiance = colours()
    config = PyOpenColorIO.Config.CreateFromFile(opencolorio.BUILT_IN[view.config])
    processor = config.getProcessor(
        PyOpenColorIO.DisplayViewTransform("Linear Rec.709 (sRGB)", view.display, view.view)
    ).getDefaultCPUProcessor()
    wanted = (2 * radiance).reshape(-1, 3)
    processor.applyRGB(wanted)
    found = displayed(opengl, radiance, shown_by(view, 1.0)) / 255
    # 8 bits; the processor and the shader take different ways through ACES 2.0's tables
    np.testing.assert_allclose(found.reshape(-1, 3), wanted.clip(0, 1), atol=2.5 / 255)


def test_without_tone_mapping_a_screen_of_srgb_gets_the_srgb_formula(
    opengl: moderngl.Context,
) -> None:
    radiance = colours()
    plain = displayed(opengl, radiance, Display())
    found = displayed(opengl, radiance, shown_by(PLAIN))
    assert np.abs(found.astype(int) - plain).max() <= 1


def test_zebra_marks_what_the_screen_clips(opengl: moderngl.Context) -> None:
    bright = np.full((8, 8, 3), 1.5, np.float32)
    display = shown_by(PLAIN)
    display.zebra = True
    assert set(np.unique(displayed(opengl, bright, display))) == {0, 255}
    # ACES brings the same light below white
    display.colour_view = ColourView()
    assert len(np.unique(displayed(opengl, bright, display))) == 1


def test_a_studios_config_is_found_by_the_variable(
    opengl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One that knows linear Rec.709 by no name of ACES: it is reached by the interchange."""
    linear = PyOpenColorIO.ColorSpace(
        PyOpenColorIO.REFERENCE_SPACE_SCENE, "house linear", isData=False
    )
    encoded = PyOpenColorIO.ColorSpace(PyOpenColorIO.REFERENCE_SPACE_SCENE, "house screen")
    encoded.setTransform(
        PyOpenColorIO.ExponentTransform([2.0, 2.0, 2.0, 1.0], PyOpenColorIO.NEGATIVE_CLAMP),
        PyOpenColorIO.COLORSPACE_DIR_TO_REFERENCE,
    )
    config = PyOpenColorIO.Config.CreateRaw()
    for space in (linear, encoded):
        config.addColorSpace(space)
    config.setRole("aces_interchange", "house linear")
    config.addDisplayView("house display", "plain", "house screen")
    path = tmp_path / "house.ocio"
    path.write_text(config.serialize())
    monkeypatch.setenv("OCIO", str(path))
    transform, view = opencolorio.chosen("$OCIO/house display/plain")
    assert transform is ViewTransform.OPENCOLORIO
    radiance = np.full((2, 2, 3), 0.25, np.float32)
    # greys are the same in ACES2065-1; the screen's curve is a square root
    found = displayed(opengl, radiance, shown_by(view))
    np.testing.assert_allclose(found / 255, 0.5, atol=1 / 255)
    assert opencolorio.configs()[-1] == "$OCIO"


def test_a_config_that_cannot_be_read_leaves_srgb_with_a_message(
    opengl: moderngl.Context,
    two_lamps: LobeTracks,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setenv("OCIO", str(tmp_path / "none.ocio"))
    state = ViewerState(two_lamps)
    state.display = shown_by(ColourView("$OCIO", "a", "b"))
    Renderer(opengl).balls(state, (60, 10))
    assert state.display.transform is ViewTransform.SRGB
    assert "none.ocio: not a config of OpenColorIO" in state.message
    assert "Set the environment variable OCIO" in state.message


def test_a_config_without_a_way_in_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    config = PyOpenColorIO.Config.CreateRaw()
    config.addDisplayView("d", "v", "raw")
    (tmp_path / "raw.ocio").write_text(config.serialize())
    monkeypatch.setenv("OCIO", str(tmp_path / "raw.ocio"))
    with pytest.raises(InputError, match="neither a colour space"):
        opencolorio.view_shader(ColourView("$OCIO", "d", "v"))
    with pytest.raises(InputError, match="OpenColorIO cannot make it"):
        opencolorio.view_shader(ColourView("ACES 2.0", "no such screen", "v"))


@pytest.mark.parametrize(
    ("view", "message"),
    [
        (
            "log",
            "--view: no view or config 'log'; expected one of sRGB, filmic, false colour,",
        ),
        ("ACES 2.0/tube", "--view: no display of ACES 2.0 'tube'; expected one of sRGB"),
        (
            "ACES 2.0/sRGB - Display/x",
            "--view: no view of sRGB - Display 'x'; expected one of",
        ),
        ("$OCIO", "--view $OCIO: the environment variable OCIO is not set"),
    ],
)
def test_a_view_that_there_is_not_is_refused(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    stage_of_two_lamps: Path,
    view: str,
    message: str,
) -> None:
    monkeypatch.delenv("OCIO", raising=False)
    picture = stage_of_two_lamps.with_suffix(".png")
    arguments = ["view", str(stage_of_two_lamps), "--view", view, "--screenshot", str(picture)]
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert not picture.exists()


def test_the_panel_offers_config_screen_and_rendering(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        display = driven.state.display
        test.yield_(3)
        test.set_ref("Look")
        test.combo_click("view/OpenColorIO")
        test.yield_(2)
        assert display.transform is ViewTransform.OPENCOLORIO
        assert display.colour_view == ColourView()
        test.combo_click("config/ACES 1.3")
        test.yield_(2)
        # what the other config calls otherwise is its first choice
        assert display.colour_view == ColourView(
            "ACES 1.3", "sRGB - Display", "ACES 1.0 - SDR Video"
        )
        test.combo_click("screen/Display P3 - Display")
        test.yield_(2)
        assert display.colour_view.display == "Display P3 - Display"

    drive(script)
