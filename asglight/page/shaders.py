# SPDX-License-Identifier: Apache-2.0
"""The viewer's shaders in GLSL ES 3.00, which WebGL 2 takes: the same lines under another head."""

import re
from collections.abc import Mapping

from asglight import shader_files
from asglight.viewer.uniforms.shader_defines import DEFINES

HEAD = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;"""
"""In place of `#version 410 core`. Mobile GPUs have three precisions, and a sun overflows the
others."""

_VERSION = re.compile(r"^\s*#\s*version\b")
_COMMENT = re.compile(r"\s*//.*$")


def es_shader(name: str, special: Mapping[str, float] | None = None) -> str:
    """Return a shader file as GLSL ES 3.00, without its comments.

    Args:
        name: Its name in shaders/.
        special: Constants of one page, such as the sheets that a block has room for.
    """
    defines = {**DEFINES, **(special or {})}
    lines = [line.text for line in shader_files.included_lines(name)]
    assert sum(_VERSION.match(line) is not None for line in lines) == 1, name
    constants = [f"#define {key} {value}" for key, value in defines.items()]
    rest = [_COMMENT.sub("", line) for line in lines if not _VERSION.match(line)]
    return "\n".join([HEAD, *constants, *filter(str.strip, rest)]) + "\n"
