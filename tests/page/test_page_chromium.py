# SPDX-License-Identifier: Apache-2.0
"""The page in a headless Chromium: starts, scrubs, plays, and shows the viewer's pixels."""

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest
import torch
from chromium import PROGRAM, Page, chromium
from matplotlib.image import imread
from usd_tracks import moving

from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, LobeTracks
from asglight.page.html import page_balls, write_page
from asglight.page.numbers import numbers_of
from asglight.page.reference import reference_of
from asglight.shading.balls import coverage
from asglight.viewer.gl import passes
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.display_pass import DisplayPass
from asglight.viewer.gl.layers import MAP_ROWS
from asglight.viewer.state.display import Comparison, Display
from asglight.viewer.uniforms.map_lobes import widened

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="needs Chromium (Debian: chromium)")

FRAMES = range(1001, 1006)
WITHIN = 0.99
"""Share of the pixels of balls that are within a step of 8 bits of the viewer's."""


def shot_of(form: Form, *, dark: int | None = None) -> LobeTracks:
    """Return five lobes that move, one of them dark in a frame."""
    tracks = moving(FRAMES, 5, form)
    if dark is not None:
        tracks.lobes.amplitude[2, dark] = 0
    return tracks


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as opened:
        yield opened


def opened(page: Page, path: Path, tracks: LobeTracks, fragment: str = "", **size: int) -> Page:
    write_page(path, tracks, "a <b>shot</b> & more")
    page.faults.clear()
    page.open(path, fragment, **size)
    page.settle()
    assert page.run("document.getElementById('trouble').hidden"), page.faults
    assert page.faults == []
    return page


def canvas(page: Page, name: str) -> np.ndarray:
    """Return the pixels of a canvas.  [H, W, 3] in 0 to 255."""
    url = page.run(f"document.getElementById({name!r}).toDataURL('image/png')")
    picture = imread(io.BytesIO(base64.b64decode(url.partition(",")[2])))
    return np.rint(255 * picture[..., :3]).astype(int)


def cells_of(width: int, columns: int, count: int) -> list[tuple[int, int, int]]:
    """Return where the page puts its balls: in cells as wide as they fit, at 0.88 of a cell."""
    pitch = width // columns
    size = round(0.88 * pitch)
    left, top = (width - columns * pitch + pitch - size) // 2, (pitch - size) // 2
    return [(left + i % columns * pitch, top + i // columns * pitch, size) for i in range(count)]


def by_viewer(
    opengl: moderngl.Context, tracks: LobeTracks, place: int, shape: tuple[int, ...], stops: float
) -> np.ndarray:
    """Draw the balls by the viewer's passes.  [H, W, 3]."""
    height, width, _ = shape
    balls = page_balls()
    target = passes.radiance_target(opengl, (width, height))
    target.use()
    target.clear()
    cells = cells_of(width, len(balls), len(balls))
    drawing = BallsPass(opengl, albedo_table(opengl))
    drawing.draw(tracks.lobes[place], balls, np.eye(3), cells, target)
    return displayed(opengl, target, stops)


def displayed(
    opengl: moderngl.Context,
    radiance: moderngl.Framebuffer,
    stops: float,
    size: tuple[int, int] | None = None,
) -> np.ndarray:
    shown = passes.display_target(opengl, size or radiance.size)
    picture = passes.Picture(passes.target_texture(radiance))
    DisplayPass(opengl).draw(picture, None, Display(exposure_ev=stops), Comparison.FIT, shown)
    width, height = shown.size
    pixels = np.frombuffer(shown.read(components=3, alignment=1), np.uint8)
    return pixels.reshape(height, width, 3).astype(int)


def inside(shape: tuple[int, ...], cells: list[tuple[int, int, int]]) -> np.ndarray:
    """Mark the pixels of balls."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return np.any(
        [np.hypot(x - cx - size / 2, y - cy - size / 2) < size / 2 for cx, cy, size in cells],
        axis=0,
    )


@pytest.mark.parametrize("form", Form)
def test_balls_are_the_viewers_in_every_form_and_frame(
    form: Form, page: Page, tmp_path: Path, opengl: moderngl.Context
) -> None:
    tracks = shot_of(form, dark=1)
    opened(page, tmp_path / "shot.html", tracks)
    stops = numbers_of(tracks, page_balls()).document["exposure"]
    for place in (0, 2, 4):  # scrubbed, as a finger does it
        page.run(
            f"time.value = {place}; time.dispatchEvent(new Event('input'))".replace(
                "time.", "document.getElementById('time')."
            )
        )
        page.settle()
        assert page.run("document.getElementById('frame').textContent").startswith(
            str(FRAMES[place])
        )
        found = canvas(page, "balls")
        wanted = by_viewer(opengl, tracks, place, found.shape, stops)
        cells = cells_of(found.shape[1], 6, 6)
        balls = inside(found.shape, cells)
        near = (np.abs(found - wanted).max(-1) <= 1)[balls]
        assert near.mean() >= WITHIN, near.mean()
        assert wanted[balls].max() > 100  # there is something to see
        assert np.array_equal(found[~balls][0], wanted[~balls][0])  # the ground
    assert page.faults == []


def test_the_map_is_the_viewers_but_for_outlines(
    page: Page, tmp_path: Path, opengl: moderngl.Context
) -> None:
    tracks = shot_of(Form.ASG)
    opened(page, tmp_path / "shot.html", tracks)
    drawn = canvas(page, "map")
    page.run("document.getElementById('outlines').click()")
    page.settle()
    plain = canvas(page, "map")
    assert (np.abs(drawn - plain).max(-1) > 30).mean() > 1e-3  # outlines were there
    target = passes.radiance_target(opengl, (2 * MAP_ROWS, MAP_ROWS))
    passes.target_texture(target).filter = moderngl.LINEAR, moderngl.LINEAR
    passes.LobesPass(opengl).draw(widened(tracks.lobes[0], MAP_ROWS), target)
    stops = numbers_of(tracks, page_balls()).document["exposure"]
    height, width, _ = plain.shape
    wanted = displayed(opengl, target, stops, (width, height))
    # interpolation between texels is of 8 bits in some drivers
    assert (np.abs(plain - wanted).max(-1) <= 2).mean() > 0.98


def test_solo_shows_one_lobe_and_exposure_is_in_stops(
    page: Page, tmp_path: Path, opengl: moderngl.Context
) -> None:
    tracks = shot_of(Form.ASG)
    opened(page, tmp_path / "shot.html", tracks)
    stops = numbers_of(tracks, page_balls()).document["exposure"]
    assert page.run("document.querySelectorAll('#lobes button').length") == 5
    page.run("document.querySelectorAll('#lobes button')[3].click()")
    page.run(
        "const e = document.getElementById('exposure'); e.value = Number(e.value) + 2;"
        "e.dispatchEvent(new Event('input'))"
    )
    page.settle()
    found = canvas(page, "balls")
    alone = replace(tracks.lobes, amplitude=tracks.lobes.amplitude.clone())
    alone.amplitude[:, [0, 1, 2, 4]] = 0
    shown = float(page.run("document.getElementById('stops').textContent").split()[0])
    assert shown == pytest.approx(stops + 2, abs=0.11)
    slider = float(page.run("document.getElementById('exposure').value"))
    wanted = by_viewer(opengl, replace(tracks, lobes=alone), 0, found.shape, slider)
    balls = inside(found.shape, cells_of(found.shape[1], 6, 6))
    assert (np.abs(found - wanted).max(-1) <= 1)[balls].mean() >= WITHIN
    page.run("document.getElementById('all').click()")
    page.settle()
    assert page.run("document.getElementById('all').hidden")


def test_it_plays_and_opens_at_the_frame_of_its_address(page: Page, tmp_path: Path) -> None:
    opened(page, tmp_path / "shot.html", shot_of(Form.ASG), "#1004")
    frame = "document.getElementById('frame').textContent"
    assert page.run(frame).startswith("1004")
    page.run("document.getElementById('play').click()")
    page.wait(f"!{frame}.startsWith('1004')")
    page.run("document.getElementById('play').click()")
    page.settle()
    stopped = page.run(frame)
    page.settle()
    assert page.run(frame) == stopped


def test_without_an_address_it_opens_at_its_first_frame(page: Page, tmp_path: Path) -> None:
    tracks = replace(shot_of(Form.ASG), frames=(-2, -1, 0, 1, 2))
    opened(page, tmp_path / "shot.html", tracks)
    assert page.run("document.getElementById('frame').textContent").startswith("-2")
    opened(page, tmp_path / "zero.html", tracks, "#0")
    assert page.run("document.getElementById('frame').textContent").startswith("0")


def test_frames_that_are_left_out_take_their_time(page: Page, tmp_path: Path) -> None:
    tracks = replace(shot_of(Form.ASG), frames=(1001, 1101, 1201, 1301, 1401))
    opened(page, tmp_path / "shot.html", tracks)
    # the clock of the pictures is the test's: 24 frames a second
    page.run(
        "window.steps = []; window.performance.now = () => 0;"
        "window.requestAnimationFrame = (step) => window.steps.push(step)"
    )
    page.run("document.getElementById('play').click()")
    for seconds, frame in ((0, 1001), (4.1, 1001), (4.2, 1101), (16.68, 1401), (17, 1001)):
        page.run(f"window.steps.splice(0).forEach((step) => step({1000 * seconds}))")
        page.run(f"window.steps.splice(0).forEach((step) => step({1000 * seconds}))")
        shown = page.run("document.getElementById('frame').textContent")
        assert shown.startswith(str(frame)), (seconds, shown)


def test_an_arrow_stops_and_steps_unless_it_is_the_browsers(page: Page, tmp_path: Path) -> None:
    tracks = replace(shot_of(Form.ASG), fps=0.01)  # the next frame is far away
    opened(page, tmp_path / "shot.html", tracks)

    def press(more: str = "") -> bool:
        return page.run(
            f"document.body.dispatchEvent(new KeyboardEvent('keydown', {{key: 'ArrowRight', {more}"
            "bubbles: true, cancelable: true}))"
        )

    page.run("document.getElementById('play').click()")
    assert not press()  # taken
    page.settle()
    page.settle()
    assert page.run("document.getElementById('frame').textContent").startswith("1002")
    assert page.run("document.getElementById('play').getAttribute('aria-label')") == "Play"
    for held in ("altKey", "ctrlKey", "metaKey"):
        assert press(f"{held}: true, ")  # left to the browser
    page.settle()
    assert page.run("document.getElementById('frame').textContent").startswith("1002")


def test_a_finger_scrubs_on_a_telephone_and_nothing_is_cut_off(page: Page, tmp_path: Path) -> None:
    opened(page, tmp_path / "shot.html", shot_of(Form.ASG))
    page.resize(390, 800, is_mobile=True)
    page.ask("Emulation.setTouchEmulationEnabled", enabled=True)
    page.settle()
    page.settle()
    assert page.run("document.documentElement.scrollWidth") <= 390
    page.run("document.getElementById('time').scrollIntoView()")
    box = page.run(
        "(({x, y, width, height}) => [x, y, width, height])"
        "(document.getElementById('time').getBoundingClientRect())"
    )
    x, y, width, height = box
    for kind, share in (("touchStart", 0.02), ("touchMove", 0.5), ("touchMove", 0.97)):
        points = [{"x": x + share * width, "y": y + height / 2}]
        page.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    page.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    page.settle()
    assert page.run("document.getElementById('frame').textContent").startswith("1005")
    page.ask("Emulation.setTouchEmulationEnabled", enabled=False)
    assert page.faults == []


def test_words_of_the_stage_are_words_on_the_page(page: Page, tmp_path: Path) -> None:
    names = ("sun", "lamp", "fill", "rim", "bounce")
    tracks = replace(shot_of(Form.ASG), names=names)
    opened(page, tmp_path / "shot.html", tracks)
    assert page.run("document.querySelector('h1').textContent") == "a <b>shot</b> & more"
    assert page.run("document.title") == "a <b>shot</b> & more"
    listed = "[...document.querySelectorAll('#lobes button span:nth-child(2)')]"
    assert page.run(f"{listed}.map(one => one.textContent)") == list(names)


def test_a_black_still_is_black_and_has_no_timeline(page: Page, tmp_path: Path) -> None:
    tracks = shot_of(Form.ASG)
    lobes = replace(tracks.lobes, amplitude=torch.zeros_like(tracks.lobes.amplitude))[:1]
    opened(page, tmp_path / "shot.html", replace(tracks, frames=(1001,), lobes=lobes))
    assert page.run("document.getElementById('transport').hidden")
    assert not canvas(page, "map").any()
    found = canvas(page, "balls")
    for x, y, size in cells_of(found.shape[1], 6, 6):
        assert not found[y + size // 4 : y + 3 * size // 4, x + size // 4 : x + 3 * size // 4].any()
    assert page.run(
        "[...document.querySelectorAll('#lobes span:nth-child(3)')].every("
        "one => one.textContent === 'dark')"
    )


GREYS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Radiance of balls that a test puts in the place of rendered ones."""


def test_the_reference_is_shown_with_its_errors(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def even(maps: torch.Tensor, roughness: Sequence[float], *, size: int) -> torch.Tensor:
        assert len(roughness) == len(GREYS)
        colours = torch.tensor(GREYS)[:, None] * torch.tensor([1.0, 0.5, 0.25])
        balls = coverage(size)[..., None] * colours[:, None, None]
        return balls.expand(len(maps), *balls.shape)

    monkeypatch.setattr("asglight.page.reference.render_balls", even)
    tracks = replace(shot_of(Form.ASG), frames=(1001, 1002), lobes=shot_of(Form.ASG).lobes[:2])
    maps = [torch.full((16, 32, 3), level) for level in (0.1, 0.3)]
    reference = reference_of("sky.####.exr", maps, tracks, page_balls())
    write_page(tmp_path / "shot.html", tracks, "shot", reference)
    page.faults.clear()
    page.open(tmp_path / "shot.html", "#1002")
    page.wait("document.getElementById('truth').width > 300")
    page.settle()
    stops = numbers_of(tracks, page_balls()).document["exposure"]

    def srgb(radiance: np.ndarray) -> np.ndarray:
        """Return what a screen shows (IEC 61966-2-1)."""
        linear = np.clip(radiance * 2.0**stops, 0, 1)
        low, high = 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
        return 255 * np.where(linear <= 0.0031308, low, high)

    found = canvas(page, "truth")
    # a matte ball under an even map shows the map
    wanted = [np.array([1.0, 0.5, 0.25]) * grey for grey in GREYS] + [np.full(3, 0.3)]
    for (x, y, size), colour in zip(cells_of(found.shape[1], 6, 6), wanted, strict=True):
        middle = found[y + size // 3 : y + 2 * size // 3, x + size // 3 : x + 2 * size // 3]
        # a JPEG of quality 92: two steps of a hundredth of the ball's range
        np.testing.assert_allclose(middle.mean((0, 1)), srgb(colour), atol=4)
        assert tuple(found[y, x]) == tuple(found[0, 0])  # the ground shows beside a ball
    row = page.run("[...document.querySelectorAll('#errors td')].map(one => one.textContent)")
    shown = dict(zip(row[::2], row[1::2], strict=True))
    irr = 100 * frame_errors(tracks.at(1002), maps[1]).values["irr"]
    assert float(shown["white ball irr"].rstrip(" %")) == pytest.approx(irr, rel=0.06)
    page.run("document.getElementById('outlines').click()")
    page.run("document.querySelector('[data-map=reference]').click()")
    page.settle()
    np.testing.assert_allclose(canvas(page, "map").mean((0, 1)), srgb(np.full(3, 0.3)), atol=4)
    assert page.faults == []
