# SPDX-License-Identifier: Apache-2.0
"""The display pass is exposure, tone curve and sRGB, and runs only when it has to."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest

from asglight.lobes import LobeTracks
from asglight.viewer import passes
from asglight.viewer.renderer import Renderer
from asglight.viewer.state import Display, ToneCurve, ViewerState

# An 8-bit target rounds to the nearest of 255 steps; OpenGL allows 0.6 of a step where halves meet.
STEP = 0.6 / 255


def displayed(opengl: moderngl.Context, radiance: np.ndarray, display: Display) -> np.ndarray:
    """Run the display pass over radiance [H, W, 3] and return 8-bit sRGB [H, W, 3]."""
    height, width = radiance.shape[:2]
    rgba = np.concatenate([radiance, np.ones((height, width, 1))], axis=2).astype(np.float32)
    texture = opengl.texture((width, height), 4, rgba.tobytes(), dtype="f4")
    target = passes.display_target(opengl, (width, height))
    passes.DisplayPass(opengl).draw(texture, display, target)
    return np.frombuffer(target.read(components=3, alignment=1), np.uint8).reshape(height, width, 3)


def srgb(linear: np.ndarray) -> np.ndarray:
    """Encode [0, 1] as IEC 61966-2-1 prints it."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("exposure_ev", [0.0, -3.0, 2.5])
def test_transfer_is_the_srgb_formula(opengl: moderngl.Context, exposure_ev: float) -> None:
    ramp = np.concatenate([np.linspace(0, 0.01, 300), np.geomspace(0.01, 1e5, 724)])
    radiance = np.stack([ramp, ramp[::-1], 0.5 * ramp], axis=-1).reshape(32, 32, 3)
    shown = displayed(opengl, radiance, Display(exposure_ev))
    expected = srgb(np.clip(radiance.astype(np.float32) * 2.0**exposure_ev, 0, 1))
    np.testing.assert_allclose(shown / 255, expected, rtol=0, atol=STEP)


@pytest.mark.parametrize(("linear", "code"), [(0.0, 0), (0.18, 118), (0.5, 188), (1.0, 255)])
def test_transfer_has_the_published_values(
    opengl: moderngl.Context, linear: float, code: int
) -> None:
    assert (displayed(opengl, np.full((1, 1, 3), linear), Display()) == code).all()


@pytest.mark.parametrize(
    ("radiance", "tone_curve", "code"),
    [
        (7.0, ToneCurve.CLIP, 255),
        (np.inf, ToneCurve.CLIP, 255),
        (-1.0, ToneCurve.CLIP, 0),
        (1.0, ToneCurve.REINHARD, 188),  # 1 / (1 + 1)
        (3.0, ToneCurve.REINHARD, 225),  # 3/4
        (np.inf, ToneCurve.REINHARD, 255),
        (-1.0, ToneCurve.REINHARD, 0),
    ],
)
def test_tone_curve_ends_and_middle(
    opengl: moderngl.Context, radiance: float, tone_curve: ToneCurve, code: int
) -> None:
    shown = displayed(opengl, np.full((1, 1, 3), radiance), Display(0.0, tone_curve))
    assert (shown == code).all()


def test_row_0_of_the_image_is_row_0_of_the_picture(opengl: moderngl.Context) -> None:
    radiance = np.zeros((2, 3, 3))
    radiance[0, 2, 1] = 1.0
    shown = displayed(opengl, radiance, Display())
    assert np.argwhere(shown).tolist() == [[0, 2, 1]]


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Collect the name of each pass that draws."""
    drawn: list[str] = []
    for cls in (passes.LobesPass, passes.DisplayPass):
        monkeypatch.setattr(cls, "draw", _noting(cls.draw, cls.__name__, drawn))
    return drawn


def _noting(draw: Callable[..., None], name: str, drawn: list[str]) -> Callable[..., None]:
    def wrapper(*arguments: object) -> None:
        drawn.append(name)
        draw(*arguments)

    return wrapper


def test_exposure_runs_the_display_pass_alone(
    opengl: moderngl.Context, two_lamps: LobeTracks, counted: list[str]
) -> None:
    state = ViewerState(two_lamps)
    renderer = Renderer(opengl, (16, 8))
    renderer.draw(state)
    assert counted == ["LobesPass", "DisplayPass"]
    renderer.draw(state)
    assert counted[2:] == []
    state.display.expose(1.0)
    renderer.draw(state)
    assert counted[2:] == ["DisplayPass"]
    state.step(1)
    renderer.draw(state)
    assert counted[3:] == ["LobesPass", "DisplayPass"]
    renderer.resize((24, 12))  # as while a window is dragged: not every size is drawn
    renderer.resize((32, 16))
    assert renderer.draw(state).size == (32, 16)
    assert counted[5:] == ["LobesPass", "DisplayPass"]


def test_passes_draw_right_after_another_user_of_the_context_left_its_state(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    clean = Renderer(opengl, (64, 32)).draw(ViewerState(two_lamps)).read()
    assert max(clean) > 100
    opengl.enable(moderngl.BLEND | moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    opengl.blend_func = moderngl.ZERO, moderngl.ONE
    opengl.viewport = (0, 0, 1, 1)
    assert Renderer(opengl, (64, 32)).draw(ViewerState(two_lamps)).read() == clean
