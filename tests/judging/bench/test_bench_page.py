# SPDX-License-Identifier: Apache-2.0
"""The bench's page: whole, by itself, in both colour schemes; and what is drawn on it."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import bench_records
import matplotlib.image
import pytest
from matplotlib.figure import Figure

from asglight.judging.bench import looks as bench_looks
from asglight.judging.bench import page as bench_page
from asglight.judging.bench import plots as bench_plots
from asglight.judging.pictures import charts, layout

VOID = {"meta", "link", "br", "img", "hr", "input"}
"""Elements that HTML never closes."""


class Reader(HTMLParser):
    """Checks that every element is closed in turn; gathers attributes and words."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.tags: list[str] = []
        self.words = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def page_of(*records: dict[str, Any]) -> str:
    pictures = {
        record["name"]: {
            name: bench_looks.svg(draw(record, bench_looks.PAGE_THEME))
            for name, draw in bench_plots.pictures(record).items()
        }
        for record in records
    }
    return bench_page.page(bench_records.document(*records), pictures)


@pytest.fixture(scope="module")
def text() -> str:
    return page_of(bench_records.still("<sky> & 'co'"), bench_records.sequence())


@pytest.fixture(scope="module")
def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    reader.close()
    return reader


def test_every_element_is_closed(read: Reader) -> None:
    assert read.open == []
    assert read.tags.count("svg") == 3 + 4


def test_parts_of_pictures_have_names_of_their_own(text: str) -> None:
    names = re.findall(r' id="([^"]*)"', text)
    assert len(names) == len(set(names))
    used = re.findall(r'(?:url\(#|href="#)([^")]*)', text)
    assert used
    assert set(used) <= set(names)


def test_nothing_is_fetched_and_nothing_runs(text: str, read: Reader) -> None:
    assert "script" not in read.tags
    assert not {"link", "img", "iframe", "object"} & set(read.tags)
    named = [value for name, value in read.attributes if name in ("href", "src", "xlink:href")]
    assert named
    assert all(value.startswith("#") for value in named)
    assert all(target.startswith("#") for target in re.findall(r"url\(['\"]?([^)'\"]*)", text))
    assert "http" not in text
    assert "@import" not in text


def test_colours_follow_the_scheme_of_the_reader(text: str) -> None:
    assert "@media (prefers-color-scheme: light)" in text
    dark, light = re.findall(r":root \{([^}]*)\}", text)
    names = set(re.findall(r"var\(--([\w-]+)\)", text))
    assert {"ground", "text", "fast", "paper", "em"} <= names
    for scheme in (dark, light):
        assert names <= set(re.findall(r"--([\w-]+):", scheme))
    assert "#fe0" not in text, "a stand-in is left"


def test_names_are_text_and_not_markup(read: Reader) -> None:
    assert "asglight bench: <sky> & 'co', shot" in read.words
    assert "sky" not in read.tags


def test_every_method_and_what_was_left_out_is_named(read: Reader) -> None:
    assert "240 of 24,000 steps" in read.words
    assert "Not run: asg-l2, sg-l2, srbf, physg" in read.words
    for name in ("fast:", "best:", "em: vMF EM", "sh: Harmonics", "independent:"):
        assert name in read.words


def test_who_is_ahead_of_ours_is_said() -> None:
    errors = {
        "fast": {"irr": 0.02, "env": 0.3},
        "best": {"irr": 0.03, "env": 0.2},
        "em": {"irr": 0.01, "env": 0.25},
        "sh": {"irr": 0.019999, "env": 0.9},  # the same in four decimals
    }
    sentence = bench_page.ahead(errors, ("fast", "best"))
    assert sentence == "Ahead of fast and best: em in irr (0.0100 against 0.0200)."
    del errors["em"]
    sentence = bench_page.ahead(errors, ("fast", "best"))
    assert sentence == "No other method here is ahead of fast and best in any error."


def test_nothing_beats_a_point_of_the_front() -> None:
    points = [(1.0, 5.0), (2.0, 6.0), (3.0, 2.0), (3.0, 1.0), (4.0, 1.0)]
    assert bench_plots.front(points) == [(1.0, 5.0), (3.0, 1.0)]


def test_the_paper_is_compared_across_lobes_at_like_steps() -> None:
    record = bench_records.still()
    other = bench_records.fit("paper", 4, bench_records.point(60, 1.0, 0.9), published=24_000)
    record["fits"].append(other)
    found = bench_plots.at_like_steps(record, "paper")
    assert [(fit["lobes"], point["steps"]) for fit, point in found] == [(15, 60), (4, 60)]


def test_pictures_are_written_dark(tmp_path: Path) -> None:
    record = bench_records.sequence()
    for name, draw in bench_plots.pictures(record).items():
        path = tmp_path / f"{name}.png"
        layout.save(draw(record, layout.DARK), path)
        picture = matplotlib.image.imread(path)
        assert picture.shape[:2] == (1120, 1500)
        assert picture[0, 0, :3].mean() < 0.2


def test_a_name_moves_aside_for_another() -> None:
    axes = charts.panel_grid(Figure(figsize=(10, 5), dpi=100), 1, 1, (90, 40, 40, 40), 0.1)[0][0]
    axes.set(xlim=(0, 1), ylim=(0, 1))
    places = [(0.5, 0.5), (0.5, 0.5), (0.99, 0.5)]
    charts.label_points(axes, places, ["one", "two", "outside"], "red", places)
    first, second, third = (text.get_position() for text in axes.texts)
    assert first[0] > 0, "to the right, where there is room"
    assert second[0] < 0, "to the left, where the other one is not"
    assert third[0] <= 0, "not beyond the frame"
