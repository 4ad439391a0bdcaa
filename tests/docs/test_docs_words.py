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
def texts() -> dict[str, tuple[str, str]]:
    """Return each text by its name, and once more without capitals."""
    found = {}
    for path in files():
        text = path.read_text(errors="ignore")
        found[str(path.relative_to(ROOT))] = text, text.casefold()
    return found


def test_the_list_is_read() -> None:
    words = given_up()
    assert len(words) > 15
    assert {"leash", "turn (deg)", "HDRI, integrated"} <= set(words)


@pytest.mark.parametrize("word", given_up())
def test_a_word_that_was_given_up_is_nowhere(word: str, texts: dict[str, tuple[str, str]]) -> None:
    pattern = re.compile(rf"(?<!\w){re.escape(word)}(?!\w)", re.IGNORECASE)
    assert pattern.search(f"a {word}, b")  # it can fail
    where = {
        name: found[0]
        for name, (text, plain) in texts.items()
        if word.casefold() in plain  # which is soon asked
        and (found := pattern.search(text))
        and not name.startswith(OTHERWISE.get(word, ("-",)))
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


OTHERS = re.compile(
    r"^(scripts|code|nn_utils)/|(^|/)(even|sphere|totals|sg_render|sg_rendering)\.py$"
)
"""Files of other projects, and those that a worked example of docs/contributing adds."""


def ends_of_files() -> set[str]:
    """Return how files of the project can be named: by their paths, or by the ends of these."""
    folders = [each for each in ROOT.iterdir() if each.is_dir() and not each.name.startswith(".")]
    found = [ROOT / name for name in ("hatch_build.py", "README.md", "CONTRIBUTING.md")]
    for folder in folders:
        found += [*folder.rglob("*.py"), *folder.rglob("*.md")]
    parts = [path.relative_to(ROOT).parts for path in found]
    return {"/".join(each[k:]) for each in parts for k in range(len(each))}


def test_files_that_pages_name_are_there() -> None:
    ends = ends_of_files()
    named = [
        (str(page.relative_to(ROOT)), name)
        for page in ROOT.glob("docs/**/*.md")
        if not any(page.is_relative_to(each) for each in SPARED)
        for name in re.findall(r"`([\w/]+\.py)`", page.read_text())
        if not OTHERS.search(name)
    ]
    assert len(named) > 50
    assert not {each for each in named if each[1] not in ends}


def test_files_that_code_names_are_there() -> None:
    """In docstrings and comments: `(slots.py)` says where to read on."""
    ends = ends_of_files()
    named = {
        (str(path.relative_to(ROOT)), name)
        for pattern in ("asglight/**/*.py", "asglight/**/*.[ch]", "shaders/**/*.*")
        for path in ROOT.glob(pattern)
        for name in re.findall(r"(?<![\w/.-])[\w/-]+\.(?:py|md)\b", path.read_text())
        if not OTHERS.search(name)
    }
    assert len(named) > 150
    assert not {each for each in named if each[1] not in ends}


def test_targets_that_texts_name_are_there() -> None:
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    in_code = re.compile(r"(?:`|^    )make ([a-z][a-z0-9-]+)", re.MULTILINE)
    named = {
        (str(path.relative_to(ROOT)), target)
        for path in files()
        for target in in_code.findall(path.read_text(errors="ignore"))
    }
    assert len(named) > 20
    message = ("docs/guides/troubleshooting.md", "room")  # make room on the disk
    assert {each for each in named if each[1] not in targets} <= {message}


def test_modules_that_texts_name_are_there() -> None:
    dotted = re.compile(r"\b(?:asglight|benchmarks)(?:\.[a-z_]+)+")
    named = {
        found
        for pattern in ("docs/**/*.md", "*.md", "benchmarks/**/*.py", "asglight/**/*.py")
        for path in ROOT.glob(pattern)
        if not any(path.is_relative_to(each) for each in SPARED)
        for found in dotted.findall(path.read_text())
    }
    assert len(named) > 200
    assert not {name for name in named if not is_there(name)} - {"benchmarks.some"}


def is_there(name: str) -> bool:
    """Whether a dotted name is a module, a room, or what one of them defines."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:count])
        source = next(
            (each for each in (place.with_suffix(".py"), place / "__init__.py") if each.is_file()),
            None,
        )
        if source is not None:
            return count == len(parts) or parts[count] in source.read_text()
        if place.is_dir():
            return count == len(parts)
    return False
