# SPDX-License-Identifier: Apache-2.0
"""What the page tells, in a headless Chromium, where it cannot draw."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import PROGRAM, Page, chromium
from usd_tracks import moving

from asglight.lobes import Form
from asglight.page.html import write_page

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="needs Chromium (Debian: chromium)")

FRAMES = range(1001, 1004)


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as opened:
        yield opened


def test_a_browser_without_what_it_takes_is_told(page: Page, tmp_path: Path) -> None:
    write_page(tmp_path / "shot.html", moving(FRAMES, 5, Form.ASG), "shot")
    broken = (tmp_path / "shot.html").read_text().replace("EXT_color_buffer_float", "EXT_none")
    (tmp_path / "old.html").write_text(broken)
    page.open(tmp_path / "old.html")
    said = page.run("document.getElementById('trouble').textContent")
    assert said == "This browser cannot draw 32-bit floats (EXT_none)."
    assert not page.run("document.getElementById('trouble').hidden")


def test_more_lobes_than_a_browser_shades_are_told_in_one_line(page: Page, tmp_path: Path) -> None:
    write_page(tmp_path / "shot.html", moving(FRAMES[:1], 512, Form.FLAT), "shot")
    page.open(tmp_path / "shot.html")
    said = page.run("document.getElementById('trouble').textContent")
    assert said == (
        "512 lobes of form flat are more than the graphics of this browser shade at once. "
        "Fit the shot with fewer (--lobes)."
    )


GIVEN = """
<script>
const given = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...others) {
  const found = given.call(this, kind, ...others);
  if (kind === "webgl2") window.lose = found.getExtension("WEBGL_lose_context");
  return found;
};
</script>
"""
"""Lets a test take the graphics away, as a browser does whose driver has failed."""


def redrawn(page: Page) -> None:
    """Wait until it is drawn at its width, which may have got a scroll bar or lost one."""
    page.settle()
    page.run("window.onresize()")
    page.settle()


def balls(page: Page) -> str:
    return page.run("document.getElementById('balls').toDataURL()")


def test_graphics_that_are_lost_are_told_and_drawn_again(page: Page, tmp_path: Path) -> None:
    path = tmp_path / "shot.html"
    write_page(path, moving(FRAMES, 5, Form.ASG), "shot")
    path.write_text(path.read_text().replace("<body>", f"<body>{GIVEN}"))
    page.faults.clear()
    page.open(path)
    redrawn(page)
    before = balls(page)
    page.run("lose.loseContext()")
    page.wait("!document.getElementById('trouble').hidden")
    assert page.run("document.getElementById('trouble').textContent") == (
        "The browser has taken the graphics away. The page draws again when they are back."
    )
    page.run("location.hash = '#1003'")
    page.settle()
    assert balls(page) == before, "what was drawn stays"
    page.run("lose.restoreContext()")
    page.wait("document.getElementById('trouble').hidden")
    page.settle()
    after = balls(page)
    assert page.faults == []
    page.open(tmp_path / "shot.html", "?again#1003")
    redrawn(page)
    assert after == balls(page)
    assert after != before
