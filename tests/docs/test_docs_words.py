# SPDX-License-Identifier: Apache-2.0
"""One name for one thing: the glossary is true, and words that were given up do not come back."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = ROOT / "docs" / "conventions.md"

SEARCHED = ("asglight/**/*.py", "shaders/**/*.*", "docs/**/*.md", "*.md", "benchmarks/**/*.py")
"""Code with its messages, and pages."""

SPARED = (GLOSSARY, ROOT / "docs" / "experiments", ROOT / "CHANGELOG.md")
"""Where words are named as given up, and where history stands."""

OTHERWISE = {
    "effort": ("asglight/judging/", "asglight/cli/", "docs/results/", "benchmarks/"),
}
"""Places where a word means something else: how much `asglight bench` measures."""


def given_up() -> list[str]:
    section = GLOSSARY.read_text().partition("## Words given up")[2]
    rows = re.findall(r"^\| (`.+?) \| [^|]+ \|$", section, re.MULTILINE)
    return [word for row in rows for word in re.findall(r"`([^`]+)`", row)]


def files() -> Iterator[Path]:
    for pattern in SEARCHED:
        for path in ROOT.glob(pattern):
            if path.is_file() and not any(path.is_relative_to(each) for each in SPARED):
                yield path


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    found = {}
    for path in files():
        found[str(path.relative_to(ROOT))] = path.read_text(errors="ignore")
    return found


def test_the_list_is_read() -> None:
    words = given_up()
    assert len(words) > 15
    assert {"leash", "turn (deg)", "HDRI, integrated"} <= set(words)


@pytest.mark.parametrize("word", given_up())
def test_a_word_that_was_given_up_is_nowhere(word: str, texts: dict[str, str]) -> None:
    pattern = re.compile(rf"(?<!\w){re.escape(word)}(?!\w)", re.IGNORECASE)
    assert pattern.search(f"a {word}, b")  # it can fail
    where = {
        name: found[0]
        for name, text in texts.items()
        if (found := pattern.search(text)) and not name.startswith(OTHERWISE.get(word, ("-",)))
    }
    assert not where


def test_every_term_of_the_glossary_is_defined_where_it_says() -> None:
    section = GLOSSARY.read_text().partition("## Glossary")[2].partition("\n## ")[0]
    rows = [line[1:-1].split("|") for line in section.split("\n") if line.startswith("| ")]
    terms = [[cell.strip() for cell in row] for row in rows[1:]]
    assert len(terms) > 30
    for term, *_, place in terms:
        path = re.fullmatch(r"`([\w/.]+)`", place)
        assert path is None or (ROOT / path[1]).is_file(), (term, place)
    names = [term.partition(":")[0].lower() for term, *_ in terms]
    assert names == sorted(names)
