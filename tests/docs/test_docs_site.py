# SPDX-License-Identifier: Apache-2.0
"""The site: it builds without a network or a warning, and holds all that the code says."""

import re
import socket
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

import asglight
from asglight.cli.main import COMMANDS

pytest.importorskip("mkdocs")
commands = pytest.importorskip("website.commands")
equations = pytest.importorskip("website.equations")

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
OWN_PAGES = ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "benchmarks/README.md")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")

pytestmark = pytest.mark.skipif(
    not (DOCS / "images").is_dir(), reason="pages without their pictures, as in an sdist"
)


class Loaded(HTMLParser):
    """What a page loads by itself: scripts, styles, pictures, frames."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in ("script", "img", "iframe", "source") and given.get("src"):
            self.sources.append(str(given["src"]))
        if tag == "link" and given.get("rel") != "canonical":
            self.sources.append(str(given.get("href")))


def refused(*_: object) -> None:
    raise ConnectionRefusedError("a site is built without a network")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built with no way to a network: a proxy that is none."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    target = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("http_proxy", "https_proxy", "HTTPS_PROXY"):
            patch.setenv(name, "http://127.0.0.1:9")
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        patch.setattr(socket.socket, "connect", refused)
        patch.chdir(ROOT)
        config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(target), strict=True)
        build(config)  # raises at the first warning
    return target


def test_the_site_loads_nothing_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(list(DOCS.rglob("*.md")))
    for page in pages:
        loaded = Loaded()
        loaded.feed(page.read_text())
        away = [source for source in loaded.sources if re.match(r"(https?:)?//", source)]
        assert not away, page
    for style in site.rglob("*.css"):
        assert not re.search(r"url\(\s*['\"]?(https?:)?//|@import", style.read_text()), style


def test_every_command_and_public_name_has_its_section(site: Path) -> None:
    page = (site / "reference" / "commands.html").read_text()
    for name in COMMANDS:
        assert f">asglight {name}<" in page
    names = (site / "reference" / "api.html").read_text()
    for name in asglight.__all__:
        assert name.startswith("__") or re.search(rf'id="asglight[\w.]*\.{name}"', names), name


def test_equations_are_mathml(site: Path) -> None:
    page = (site / "method" / "objective.html").read_text()
    assert page.count("<math") > 5
    assert "```math" not in page
    assert "$`" not in page


def test_every_option_of_every_command_is_in_the_reference() -> None:
    text = commands.reference()
    for name in COMMANDS:
        for action in commands.parser_of(name)._actions:
            for option in action.option_strings:
                assert option in ("-h", "--help") or option in text, (name, option)


def test_the_table_of_commands_is_the_list_of_commands() -> None:
    page = (DOCS / "reference" / "commands.md").read_text()
    rows = re.findall(r"^\| `asglight ([\w-]+)` \| (.*) \|$", page, re.MULTILINE)
    assert dict(rows) == COMMANDS


def test_an_equation_becomes_mathml_and_text_stays() -> None:
    page = equations.with_mathml("a $`x^2`$ b `$` c\n\n```math\nE = \\pi L\n```\n\nd\n")
    assert page.startswith('a <math xmlns="http://www.w3.org/1998/Math/MathML" display="inline">')
    assert "<msup><mi>x</mi><mn>2</mn></msup>" in page
    assert " b `$` c\n\n" in page
    assert page.endswith("</math></div>\n\n\nd\n")


def test_an_equation_that_is_none_is_refused_with_its_text() -> None:
    with pytest.raises(ValueError, match=r"equation '\\\\frac': "):
        equations.with_mathml("$`\\frac`$")


def links(page: Path) -> Iterator[str]:
    """Return the targets of a page's links that are files."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for target in LINK.findall(text):
        if not re.match(r"[a-z]+:|#", target):
            yield target.partition("#")[0]


@pytest.mark.parametrize("page", [*OWN_PAGES, *sorted(DOCS.rglob("*.md"))], ids=str)
def test_no_link_between_pages_is_dead(page: str | Path) -> None:
    path = ROOT / page
    dead = [target for target in links(path) if not (path.parent / target).exists()]
    assert not dead


def test_no_page_of_instructions_sends_its_reader_to_an_experiment() -> None:
    lists = {DOCS / "README.md", DOCS / "method" / "README.md"}  # which say that there are such
    for page in set(DOCS.rglob("*.md")) - lists:
        if page.parent.name != "experiments":
            assert not [target for target in links(page) if "experiments/" in target], page


def test_experiments_are_dated_and_listed() -> None:
    folder = DOCS / "experiments"
    listed = (folder / "README.md").read_text()
    logs = [path for path in folder.glob("*.md") if path.name != "README.md"]
    assert logs
    for log in logs:
        assert re.match(r"20\d\d-\d\d-\d\d-[\w-]+\.md$", log.name)
        assert f"({log.name})" in listed


def test_messages_that_are_explained_are_said_somewhere() -> None:
    page = (DOCS / "guides" / "troubleshooting.md").read_text()
    code = "".join(path.read_text() for path in (ROOT / "asglight").rglob("*.py"))
    messages = re.findall(r"^\| `(.+?)` \| [A-Z]", page, re.MULTILINE)
    assert len(messages) > 12
    assert [message for message in messages if message not in code] == []


def test_no_file_that_is_shown_is_unused_and_none_is_too_large() -> None:
    pages = [ROOT / "README.md", *DOCS.rglob("*.md")]
    shown = {(page.parent / target).resolve() for page in pages for target in links(page)}
    for path in DOCS.rglob("*.*"):
        if path.suffix in (".png", ".webp", ".html", ".json"):
            assert path.resolve() in shown, path
            assert path.stat().st_size < 3_000_000, path


def test_readme_is_short_and_begins_with_a_picture_that_moves() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 150
    assert text.index("scrub.webp") < text.index("## ")
    webp = (DOCS / "images" / "scrub.webp").read_bytes()
    assert webp[8:12] == b"WEBP"
    assert b"ANIM" in webp[:64]
