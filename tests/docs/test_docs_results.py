# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.results`: pages are made by their commands, and hold no other numbers."""

import errno
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.results import __main__ as command
from benchmarks.results.blocks import Block, blocks, is_of_numbers, loose_numbers, with_blocks
from benchmarks.results.parts import PARTS_FILE, chosen, read_parts
from benchmarks.results.readers import read_tables
from benchmarks.results.running import complaints, here
from tests.support.old_files import old_files

ROOT = Path(__file__).resolve().parents[2]

TABLE = "| map | error |\n| --- | --: |\n| lobby | 0.12 |\n| venice | 0.03 |"
PRINTS = "python -c \"print('| map | error |\\\\n|---|--:|\\\\n| lobby | 0.5 |')\""


def repository(root: Path, page: str, toml: str) -> tuple[Path, Path]:
    """Write a README.md, an empty page of results and a file of parts."""
    (root / "docs" / "results").mkdir(parents=True)
    (root / "README.md").write_text(page)
    (root / "parts.toml").write_text(toml)
    return root / "README.md", root / "parts.toml"


def run(root: Path, *words: str) -> int:
    places = ["--root", str(root), "--parts-file", str(root / "parts.toml")]
    return command.main([*places, "-o", str(root / "out"), *words])


def test_every_number_of_readme_and_results_has_a_command_of_parts_toml() -> None:
    assert complaints(ROOT, read_parts()) == []


def test_every_part_says_what_it_makes() -> None:
    for part in read_parts(PARTS_FILE).values():
        assert part.commands
        assert part.source == "stdout" or Path(part.source).suffix in (".html", ".md", ".json")


def test_a_table_of_numbers_without_a_command_is_found() -> None:
    page = f"text\n\n{TABLE}\n\nmore"
    assert loose_numbers(page) == ["| map | error |"]
    inside = f"text\n<!-- made by: a b [part.1] -->\n{TABLE}\n<!-- end -->\n"
    assert loose_numbers(inside) == []
    assert blocks(inside) == [Block("part.1", "a b", TABLE)]


@pytest.mark.parametrize(
    "table",
    [
        "| key | what |\n|---|---|\n| `Space` | Play |\n| `0` | Exposure of 0 EV |\n| `L` | Loop |",
        "| option | default | |\n|---|---|---|\n| `--lobes` | 15 | how many |\n| `--fps` | 24 | |\n"
        "| `-o` | none | where |",
    ],
)
def test_a_table_that_explains_is_none_of_numbers(table: str) -> None:
    assert not is_of_numbers(table)


@pytest.mark.parametrize("cell", ["0.12", "**0.1**", "-3 %", "1,024", "4e-07", "x 1.02", "1 / 2"])
def test_numbers_are_known_in_every_dress(cell: str) -> None:
    assert is_of_numbers(f"| a | b |\n|---|---|\n| name | {cell} |")


@pytest.mark.parametrize(
    ("page", "message"),
    [
        ("<!-- made by: a [p.1] -->\n", "p.1: has no <!-- end -->"),
        ("<!-- made by: a [p.1] -->\n<!-- made by: b [p.2] -->\n<!-- end -->", "before p.2"),
        ("<!-- end -->", "without a block"),
    ],
)
def test_a_block_that_does_not_end_is_refused(page: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        blocks(page)


def test_text_beside_blocks_stays_to_the_letter() -> None:
    page = f"a\n\n<!-- made by: x [p.1] -->\n\n{TABLE}\n\n<!-- end -->\n  b\n"
    assert with_blocks(page, lambda block: block) == page
    other = with_blocks(page, lambda block: Block(block.name, "y", "new"))
    assert other == "a\n\n<!-- made by: y [p.1] -->\n\nnew\n\n<!-- end -->\n  b\n"


def test_a_part_is_run_and_its_table_replaced(tmp_path: Path) -> None:
    toml = f"[fake]\ncommands = ['''{PRINTS}''']\n"
    readme, _ = repository(tmp_path, "", toml)
    shown = read_parts(tmp_path / "parts.toml")["fake"].shown()
    readme.write_text(f"head\n\n<!-- made by: {shown} [fake.1] -->\n{TABLE}\n<!-- end -->\ntail\n")
    assert run(tmp_path, "fake") == 0
    (made,) = blocks(readme.read_text())
    assert made.content.startswith("| map | error |\n|---|--:|\n| lobby | 0.5 |\n\n<!-- Made by `")
    assert "cores, at commit" in made.content
    assert readme.read_text().startswith("head\n\n<!--")
    assert readme.read_text().endswith("<!-- end -->\ntail\n")
    assert run(tmp_path) == 0  # a second time the line below is replaced, not repeated
    assert readme.read_text().count("Made by `") == 1


def test_pages_and_pictures_are_taken_from_the_output(tmp_path: Path) -> None:
    writes = (
        "python -c \"import sys, pathlib as p; f = p.Path(sys.argv[1]); (f / 'a.md').write_text("
        "'made'); (f / 'b.png').write_text('drawn')\" {output}"
    )
    toml = (
        f"[fake]\ncommands = ['''{writes}''']\n"
        "page = 'a.md'\npictures = {'docs/b.png' = 'b.png'}\n"
    )
    readme, _ = repository(tmp_path, "", toml)
    shown = read_parts(tmp_path / "parts.toml")["fake"].shown()
    readme.write_text(
        f"<!-- made by: {shown} [fake.page] -->\n<!-- end -->\n"
        f"<!-- made by: {shown} [fake.picture] -->\n![A ball](docs/b.png)\n<!-- end -->\n"
    )
    (drawn,) = old_files(tmp_path / "docs", "b.png")
    page, old = readme.read_text(), tmp_path / "README.kept"
    os.link(readme, old)
    assert run(tmp_path) == 0
    assert (drawn.read_text(), old.read_text()) == ("old", page)
    made, picture = blocks(readme.read_text())
    assert made.content.startswith("made\n\n<!-- Made by")
    assert picture.content.startswith("![A ball](docs/b.png)\n\n<!-- Made by")
    assert (tmp_path / "docs" / "b.png").read_text() == "drawn"


def test_results_show_their_command_machine_and_commit(tmp_path: Path) -> None:
    toml = f"[fake]\ncommands = ['''{PRINTS}''']\n"
    _, file = repository(tmp_path, "", toml)
    shown = read_parts(file)["fake"].shown()
    page = tmp_path / "docs" / "results" / "a.md"
    page.write_text(f"<!-- made by: {shown} [fake.1] -->\n<!-- end -->\n")
    assert run(tmp_path) == 0
    (made,) = blocks(page.read_text())
    note = made.content.split("\n")[-1]
    assert note.startswith(f"*Made by `{shown}`, on ")
    assert note.endswith(".*")


def test_pictures_of_one_part_keep_each_its_own_link(tmp_path: Path) -> None:
    draws = "python -c \"import sys; open(sys.argv[1] + '/a.png', 'w')\" {output}"
    toml = f"[fake]\ncommands = ['''{draws}''']\npictures = {{'docs/a.png' = 'a.png'}}\n"
    readme, file = repository(tmp_path, "", toml)
    start = f"<!-- made by: {read_parts(file)['fake'].shown()} [fake.picture] -->"
    readme.write_text(f"{start}\n![A](a.png)\n<!-- end -->\n{start}\n![B](b.png)\n<!-- end -->\n")
    assert run(tmp_path) == 0
    assert [made.content.split("\n")[0] for made in blocks(readme.read_text())] == [
        "![A](a.png)",
        "![B](b.png)",
    ]


def test_a_page_that_cannot_be_written_is_said_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme, file = repository(tmp_path, "", f"[fake]\ncommands = ['''{PRINTS}''']\n")
    start = f"<!-- made by: {read_parts(file)['fake'].shown()} [fake.1] -->"
    readme.write_text(f"{start}\nx\n<!-- end -->\n")
    text = readme.read_text()

    def full(path: Path, written: str, **_: object) -> None:
        if path.suffix == ".md":
            path.open("w").write(written[:5])
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    assert run(tmp_path) == 1
    assert "results: fake: " in capsys.readouterr().err
    assert readme.read_text() == text


def draws_a_picture(root: Path, pictures: str) -> None:
    """Make a repository with an old picture, whose part draws it anew, and says what it draws."""
    draws = "python -c \"import sys; open(sys.argv[1] + '/a.png', 'w').write('new')\" {output}"
    toml = f"[fake]\ncommands = ['''{draws}''']\npictures = {pictures}\n"
    readme, file = repository(root, "", toml)
    start = f"<!-- made by: {read_parts(file)['fake'].shown()} [fake.picture] -->"
    readme.write_text(f"{start}\n![A](docs/a.png)\n<!-- end -->\n")
    old_files(root / "docs", "a.png")


def test_a_picture_stays_as_it_was_where_its_page_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draws_a_picture(tmp_path, "{'docs/a.png' = 'a.png'}")
    write = Path.write_text

    def full(path: Path, written: str, **named: Any) -> int:
        if path.suffix == ".md":
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, written, **named)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", full)
        assert run(tmp_path) == 1
    assert (tmp_path / "docs" / "a.png").read_text() == "old"
    assert not list(tmp_path.rglob(".asglight*"))


def test_no_picture_is_replaced_where_another_was_not_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draws_a_picture(tmp_path, "{'docs/a.png' = 'a.png', 'docs/b.png' = 'b.png'}")
    assert run(tmp_path) == 1
    assert "results: fake: made no b.png" in capsys.readouterr().err
    assert (tmp_path / "docs" / "a.png").read_text() == "old"


def test_what_fails_is_said_and_the_other_parts_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toml = (
        "[bad]\ncommands = ['''python -c \"exit(3)\"''']\n"
        f"[few]\ncommands = ['''{PRINTS}''']\n"
        f"[good]\ncommands = ['''{PRINTS}''']\n"
    )
    readme, file = repository(tmp_path, "", toml)
    marks = [
        f"<!-- made by: {part.shown()} [{name}.{2 if name == 'few' else 1}] -->\nx\n<!-- end -->"
        for name, part in read_parts(file).items()
    ]
    readme.write_text("\n".join(marks))
    assert run(tmp_path) == 1
    said = capsys.readouterr().err
    assert "results: bad: " in said
    assert "ended with status 3" in said
    assert "results: few: made no few.2" in said
    assert [made.content[:1] for made in blocks(readme.read_text())] == ["x", "x", "|"]


def test_a_part_that_leaves_an_old_file_or_none_is_said_and_the_others_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prints = "python -c \"print('| map | error |')\" {output}"
    toml = (
        f"[old]\ncommands = ['''{prints}''']\npictures = {{'docs/a.png' = 'a.png'}}\n"
        f"[no]\ncommands = ['''{prints}''']\nsource = 'no.md'\n"
        f"[json]\ncommands = ['''{prints}''']\nreader = 'compared'\n"
        "[tool]\ncommands = ['no-such-tool']\n"
        f"[good]\ncommands = ['''{PRINTS}''']\n"
    )
    readme, file = repository(tmp_path, "", toml)
    marks = [
        f"<!-- made by: {part.shown()} [{name}.{'picture' if name == 'old' else 1}] -->\nx\n"
        "<!-- end -->"
        for name, part in read_parts(file).items()
    ]
    readme.write_text("\n".join(marks))
    (tmp_path / "out" / "old").mkdir(parents=True)
    (tmp_path / "out" / "old" / "a.png").write_text("of an earlier run")
    assert run(tmp_path) == 1
    said = capsys.readouterr().err
    assert "results: old: made no a.png\n" in said
    assert "results: no: made no no.md\n" in said
    assert "results: json: stdout: Expecting value" in said
    assert "results: tool: no-such-tool: No such file or directory\n" in said
    assert not (tmp_path / "docs" / "a.png").exists()
    assert [made.content[:1] for made in blocks(readme.read_text())] == [*"xxxx", "|"]


def test_nothing_is_run_for_a_page_that_holds_a_number_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toml = "[bad]\ncommands = ['''python -c \"exit(3)\"''']\n"
    readme, file = repository(tmp_path, "", toml)
    shown = read_parts(file)["bad"].shown()
    readme.write_text(
        f"{TABLE}\n\n<!-- made by: another [bad.2] -->\n<!-- end -->\n"
        f"<!-- made by: {shown} [none.1] -->\n<!-- end -->\n"
    )
    assert run(tmp_path) == 1
    said = capsys.readouterr().err
    assert "README.md: no command for the table | map | error |" in said
    assert "README.md: [bad.2]: names another command than parts.toml" in said
    assert "README.md: [none.1]: parts.toml has no such part" in said
    assert "status" not in said


@pytest.mark.parametrize("option", ["--check", "--rename", "bad"])
def test_a_block_without_an_end_is_said_in_a_line_and_nothing_is_done(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "<!-- made by: old [bad.1] -->\nx\n"
    readme, _ = repository(tmp_path, text, "[bad]\ncommands = ['no-such-tool']\n")
    assert run(tmp_path, option) == 1
    assert capsys.readouterr().err == "results: README.md: bad.1: has no <!-- end -->\n"
    assert readme.read_text() == text


def test_commands_of_pages_follow_the_file_of_parts(tmp_path: Path) -> None:
    toml = "[moved]\ncommands = ['python -m benchmarks.new {maps}/*.exr -o {output}']\n"
    old = "<!-- made by: old [moved.1] -->\nx\n<!-- end -->\n"
    readme, _ = repository(tmp_path, old, toml)
    assert run(tmp_path, "--rename") == 0
    new = "python -m benchmarks.new ../shared/hdri/*.exr -o results-output/moved"
    assert readme.read_text() == f"<!-- made by: {new} [moved.1] -->\n\nx\n\n<!-- end -->\n"


def test_a_part_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["nonsense", "--list"]) == 2
    assert "part: 'nonsense'; expected some of " in capsys.readouterr().err


def test_patterns_are_expanded_from_the_root_and_places_filled(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in "ba":
        (tmp_path / "in" / f"{name}.exr").touch()
    (tmp_path / "parts.toml").write_text("[p]\ncommands = ['tool {maps}/*.exr -o {output}']\n")
    (part,) = chosen(read_parts(tmp_path / "parts.toml"), [])
    places = {"maps": "in", "sequences": "", "sequences2x": ""}
    words = part.words(places, Path("out"), tmp_path)[0]
    assert words == ["tool", "in/a.exr", "in/b.exr", "-o", "out"]


def test_what_a_command_says_of_its_input_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    maps = tmp_path / "maps"
    prints = "python -c 'import sys; print(sys.argv[1:])' {maps} {output}"
    page = "<!-- made by: x [p.picture] -->\n\n![a](b)\n\n<!-- end -->\n"
    root = tmp_path / "root"
    repository(root, page, f"[p]\ncommands = [{json.dumps(prints)}]\n")
    run(root, "--rename", "--maps", str(maps))
    assert run(root, "--maps", str(maps)) == 0
    assert (root / "out" / "p" / "stdout.txt").read_text() == "['../maps', 'out/p']\n"


def test_tables_are_read_of_html() -> None:
    table = "<table><tr><th>map</th><th>irr</th></tr><tr><td>a</td><td><b>0.1</b></td></tr></table>"
    page = f"<p>Errors.</p>{table}<p>None is ahead.</p><svg><text>irr</text></svg>"
    assert read_tables(page, ".html", None) == ["| map | irr |\n| --- | --: |\n| a | **0.1** |"]


def test_tables_are_read_of_a_comparison() -> None:
    metrics = dict.fromkeys(("env", "flux", "irr", "irrMax", "r0.5", "r0.25"), 0.25)
    ball = {"rmse": 0.125, "si_rmse": 0.5, "angular": 2.0}
    method = {
        "title": "EM",
        "floats": 120,
        "cpu_seconds": 1.04,
        "steps": 0,
        "published_steps": 0,
        **metrics,
        "psnr_db": None,
        "hdr_flip": 0.25,
        "spheres": {"mirror": ball},
    }
    short = method | {"title": "PhySG", "steps": 2_000, "published_steps": 100_000}
    text = json.dumps({"frames": [{"methods": [method, short]}]})
    errors, spheres = read_tables(text, "", "compared")
    row = "| EM | 120 | 1.0 | 0.2500 | 0.2500 | 0.2500 | 0.2500 | 0.2500 | 0.2500 | – | 0.250 |"
    assert errors.split("\n")[2] == row
    assert spheres.split("\n")[2] == "| EM | 0.125 | 0.5 | 2 |"
    for table in (errors, spheres):  # as the command's own table says it
        assert table.split("\n")[3].startswith("| PhySG, 2,000 of 100,000 steps | ")


def test_a_table_names_its_commit_and_whether_a_tracked_file_had_changed(tmp_path: Path) -> None:
    """Pages change while parts are made, so they do not count."""

    def git(*words: str) -> str:
        name = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
        command = ["git", "-C", str(tmp_path), *name, *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    (tmp_path / "docs").mkdir()
    source, page = tmp_path / "fit.py", tmp_path / "docs" / "page.md"
    source.write_text("one")
    page.write_text("one")
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    commit = git("rev-parse", "--short", "HEAD")
    page.write_text("two")
    assert here(tmp_path).commit == commit
    source.write_text("two")
    assert here(tmp_path).commit == f"{commit} and changes after it"


def test_a_table_that_was_made_outside_of_git_says_so(tmp_path: Path) -> None:
    assert here(tmp_path).commit == "unknown"
