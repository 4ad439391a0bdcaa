# SPDX-License-Identifier: Apache-2.0
"""A file of parts that `python -m benchmarks.results` cannot take."""

import os
from pathlib import Path

import pytest

from benchmarks.results import __main__ as command


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "No such file or directory; expected the parts as TOML."),
        ("[a", "is no TOML; expected the parts as TOML."),
        (b"\xff", "is no text; expected the parts as TOML."),
        ("a = 1", "a: is no part; expected commands and what they leave."),
        ("[a]", "a: is no part; expected commands and what they leave."),
        ('[a]\ncommands = "python"', "a: is no part; expected commands and what they leave."),
        ('[a]\ncommands = ["python"]\nb = 1', "a: is no part; expected commands and what they"),
    ],
)
def test_a_file_of_parts_that_is_none_is_said_in_a_line(
    tmp_path: Path, text: str | bytes | None, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "parts.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    assert command.main(["--list", "--parts-file", str(tmp_path / "parts.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"results: {tmp_path}/parts.toml: {said}")


def test_a_pipe_or_a_folder_of_parts_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name in ("folder", "pipe"):
        assert command.main(["--list", "--parts-file", str(tmp_path / name)]) == 2
        assert "is no file; expected the parts as TOML." in capsys.readouterr().err
