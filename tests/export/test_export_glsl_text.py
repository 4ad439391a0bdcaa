# SPDX-License-Identifier: Apache-2.0
"""Shader text is taken apart by definition, conditions are decided, names get a prefix."""

import pytest

from asglight.export import glsl_text

TEXT = """\
// A file.

const float PI = 3.14;

// A struct.
struct Lobe {
    vec4 axis;  // uses nothing
};

float unused(float x) {
    return PI * x;
}

// Uses Lobe, says unused.
float used(Lobe lobe) {
    for (;;) {
    }
    return lobe.axis.x;
}

const vec2 LIST[2] = vec2[2](
    vec2(1.0, 2.0),
    vec2(3.0, 4.0));
"""


def names(every: list[glsl_text.Block]) -> list[str]:
    return [block.name for block in every]


def test_blocks_are_definitions_with_their_comments() -> None:
    every = glsl_text.blocks(TEXT.splitlines())
    assert names(every) == ["PI", "Lobe", "unused", "used", "LIST"]
    assert every[1].text == ("// A struct.\nstruct Lobe {\n    vec4 axis;  // uses nothing\n};")


def test_only_what_the_roots_need_is_reached() -> None:
    every = glsl_text.blocks(TEXT.splitlines())
    assert names(glsl_text.reached(every, ["used"])) == ["Lobe", "used"]  # a comment needs nothing


@pytest.mark.parametrize("line", ["#define X 1", "uniform float u_x;", "    float x;"])
def test_a_line_outside_definitions_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match="no definition"):
        glsl_text.blocks(["float f() {", "}", line])


def test_a_definition_without_end_is_refused() -> None:
    with pytest.raises(ValueError, match="no end: f"):
        glsl_text.blocks(["float f() {", "    if (true) {", "}"])


@pytest.mark.parametrize(
    ("defined", "expected"),
    [((), "abfi"), (("X",), "acdhi"), (("X", "Y"), "aceghi")],
)
def test_conditions_keep_the_side_that_holds(defined: tuple[str, ...], expected: str) -> None:
    lines = (
        "a|#ifndef X|b|#else|c|#ifndef Y|d|#else|e|#endif|#endif|#ifdef X|#ifdef Y // y|g|#endif"
    )
    lines += "|h|#else|f|#endif|i"
    assert "".join(glsl_text.resolved(lines.split("|"), defined)) == expected


def test_names_get_the_prefix_of_their_kind() -> None:
    chosen = glsl_text.prefixed(["PI", "Lobe", "used", "asg_x", "ASG_Y", "AsgZ"])
    assert chosen == {"PI": "ASG_PI", "Lobe": "AsgLobe", "used": "asg_used"}
    text = "used(PI, PIE, x.used_y) // Lobe, used.py"
    assert glsl_text.renamed(text, chosen) == "asg_used(ASG_PI, PIE, x.used_y) // AsgLobe, used.py"
