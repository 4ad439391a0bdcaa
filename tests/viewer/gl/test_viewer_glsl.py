# SPDX-License-Identifier: Apache-2.0
"""Shaders are found, put together and, when wrong, explained by file and line."""

from collections.abc import Callable
from pathlib import Path

import moderngl
import pytest

from asglight import shader_files
from asglight.lobes import Form
from asglight.shader_files import ShaderError
from asglight.viewer.gl import glsl, passes
from asglight.viewer.state.display import ViewTransform

LIBRARY = [
    path.relative_to(shader_files.shader_folder()).as_posix()
    for path in sorted(shader_files.shader_folder().rglob("*.glsl"))
    if path.parent.name != "export"  # needs the lobes: tests/export/
]
TWO_LINES = glsl.ShaderSource(
    (
        shader_files.Line("#version 410 core", "shaders/lobes.frag:3"),
        shader_files.Line("foo();", "shaders/lib/asg.glsl:31"),
    )
)


def write(folder: Path, **files: str) -> None:
    """Write shader files; `__` in a name stands for a folder and `_` before the end for a dot."""
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


@pytest.mark.parametrize("name", glsl.fragment_shaders())
def test_every_pass_compiles(opengl: moderngl.Context, name: str) -> None:
    assert passes.pass_program(opengl, name).glo > 0


@pytest.mark.parametrize("name", LIBRARY)
def test_every_included_file_compiles_on_its_own(
    probe_program: Callable[[str], moderngl.Program], name: str
) -> None:
    program = probe_program(
        f'#version 410 core\n#include "{name}"\nout vec4 o;\nvoid main() {{ o = vec4(0.0); }}\n'
    )
    assert program.glo > 0


def test_includes_nest_and_come_once(tmp_path: Path) -> None:
    write(
        tmp_path,
        a_frag='#version 410 core\n#include "lib/b.glsl"\n#include "lib/c.glsl"\nint a;\n',
        lib__b_glsl='#include "lib/c.glsl"  // for c\nint b;\n',
        lib__c_glsl='#include "lib/b.glsl"\nint c;\n',
    )
    source = glsl.expanded("a.frag", folder=tmp_path)
    assert source.text == "#version 410 core\nint c;\nint b;\nint a;\n"
    assert [line.place for line in source.lines] == [
        "shaders/a.frag:1",
        "shaders/lib/c.glsl:2",
        "shaders/lib/b.glsl:2",
        "shaders/a.frag:4",
    ]


def test_version_is_first_then_the_constants(tmp_path: Path) -> None:
    write(tmp_path, a_frag="// a licence\n#version 410 core\nint a;\n")
    text = glsl.expanded("a.frag", {"MAX": 3}, tmp_path).text
    assert text == "#version 410 core\n#define MAX 3\n// a licence\nint a;\n"


def test_enum_members_are_numbered_in_their_order() -> None:
    assert shader_files.enum_defines(Form) == {
        "FORM_ASG": 0,
        "FORM_BINGHAM": 1,
        "FORM_SG": 2,
        "FORM_FLAT": 3,
    }
    assert shader_files.enum_defines(ViewTransform) == {
        "VIEW_TRANSFORM_SRGB": 0,
        "VIEW_TRANSFORM_FILMIC": 1,
        "VIEW_TRANSFORM_FALSE_COLOUR": 2,
        "VIEW_TRANSFORM_OPENCOLORIO": 3,
    }


def test_missing_include_is_named_with_the_line_that_asks(tmp_path: Path) -> None:
    write(tmp_path, a_frag='#version 410 core\n\n#include "lib/none.glsl"\n')
    with pytest.raises(ShaderError, match=r"^shaders/a\.frag:3: lib/none\.glsl cannot be"):
        glsl.expanded("a.frag", folder=tmp_path)


def test_missing_shader_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShaderError, match=r"^shaders/none\.frag: .* \(No such file"):
        glsl.expanded("none.frag", folder=tmp_path)


def test_missing_version_is_named(tmp_path: Path) -> None:
    write(tmp_path, a_frag="int a;\n")
    with pytest.raises(ShaderError, match=r"^shaders/a\.frag: no #version; expected one"):
        glsl.expanded("a.frag", folder=tmp_path)


def test_driver_message_names_the_included_file_and_its_line(
    opengl: moderngl.Context, tmp_path: Path
) -> None:
    write(
        tmp_path,
        a_frag='// x\n#version 410 core\n#include "lib/b.glsl"\nvoid main() { b(); }\n',
        lib__b_glsl='#include "lib/c.glsl"\n\nvec4 b() {\n    return missing;\n}\n',
        lib__c_glsl="const int c = 1;\n",
    )
    with pytest.raises(ShaderError, match=r"^shaders/lib/b\.glsl:4: .*missing"):
        glsl.program(
            opengl,
            glsl.expanded(shader_files.VERTEX_SHADER),
            glsl.expanded("a.frag", {"X": 1, "Y": 2}, tmp_path),
        )


def test_driver_message_after_an_include_names_the_outer_line(
    opengl: moderngl.Context, tmp_path: Path
) -> None:
    write(
        tmp_path,
        a_frag='#version 410 core\n#include "lib/c.glsl"\nout vec4 o;\nvoid main() { o = no; }\n',
        lib__c_glsl="const int c = 1;\n\n\n",
    )
    with pytest.raises(ShaderError, match=r"^shaders/a\.frag:4: "):
        glsl.program(
            opengl,
            glsl.expanded(shader_files.VERTEX_SHADER),
            glsl.expanded("a.frag", folder=tmp_path),
        )


def test_driver_message_of_the_vertex_stage_names_the_vertex_file(
    opengl: moderngl.Context, tmp_path: Path
) -> None:
    write(tmp_path, a_vert="#version 410 core\nvoid main() { gl_Position = no; }\n")
    with pytest.raises(ShaderError, match=r"^shaders/a\.vert:2: "):
        glsl.program(
            opengl,
            glsl.expanded("a.vert", folder=tmp_path),
            glsl.expanded("display.frag", passes.DEFINES),
        )


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("0:2(5): error: no foo", "shaders/lib/asg.glsl:31: error: no foo"),
        ("0(2) : error C1008: no foo", "shaders/lib/asg.glsl:31: error C1008: no foo"),
        ("ERROR: 0:2: 'foo' : undeclared", "shaders/lib/asg.glsl:31: error: 'foo' : undeclared"),
        ("0:3(1): error: end of file", "shaders/lib/asg.glsl:31: error: end of file"),
    ],
    ids=["mesa", "nvidia", "apple-amd-intel", "after the last line"],
)
def test_messages_of_every_driver_are_understood(line: str, expected: str) -> None:
    message = f"GLSL Compiler failed\n\nfragment_shader\n===============\n{line}\n\n"
    assert glsl.readable(message, TWO_LINES) == expected


def test_message_without_a_place_is_kept() -> None:
    message = "GLSL Linker failed\n\nProgram\n=======\nerror: too many outputs\n"
    assert glsl.readable(message, TWO_LINES) == message.strip()


@pytest.mark.parametrize("place", ["shaders", "asglight/shaders"], ids=["checkout", "wheel"])
def test_shaders_are_found_in_a_checkout_and_in_a_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / place).mkdir(parents=True)
    (tmp_path / place / shader_files.VERTEX_SHADER).touch()
    monkeypatch.setattr(shader_files, "__file__", str(tmp_path / "asglight" / "shader_files.py"))
    assert shader_files.shader_folder.__wrapped__() == tmp_path / place


def test_missing_shaders_are_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shader_files, "__file__", str(tmp_path / "asglight" / "shader_files.py"))
    with pytest.raises(ShaderError, match=r"^shaders: no fullscreen\.vert in .* complete\?"):
        shader_files.shader_folder.__wrapped__()
