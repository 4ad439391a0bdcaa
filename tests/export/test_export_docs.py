# SPDX-License-Identifier: Apache-2.0
"""The host of docs/reference/export.md works as it is written there."""

import re

import moderngl
import numpy as np
from places import ROOT
from usd_tracks import moving

from asglight.export.environment import BLOCK, environment

PAGE = ROOT / "docs" / "reference" / "export.md"
VERTEX = """#version 330 core
out vec3 v_position;
out vec3 v_normal;
void main() {
    vec2 place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
    v_position = vec3(place, 0.0);
    v_normal = vec3(0.0, 0.0, 2.0);
    gl_Position = vec4(place, 0.0, 1.0);
}
"""


def test_the_host_of_the_page_draws(opengl: moderngl.Context) -> None:
    made = environment(moving([1, 2, 3]), "environment.f32")
    assert made.blocks is not None
    match = re.search(r"```glsl\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert match is not None
    fragment = match[1].replace('#include "environment.glsl"', made.text)
    assert "#include" not in fragment
    program = opengl.program(vertex_shader=VERTEX, fragment_shader=fragment)
    program["u_camera"] = 0.0, 0.0, 3.0
    program[BLOCK].binding = 0
    # So that the host may ask the driver for the size of a block.
    assert program[BLOCK].size == made.blocks[0].nbytes
    target = opengl.framebuffer([opengl.texture((8, 8), 4, dtype="f4")])
    target.use()
    opengl.enable_only(moderngl.NOTHING)
    pictures = []
    for frame in range(3):
        block = made.blocks.tobytes()[frame * made.blocks[0].nbytes :][: made.blocks[0].nbytes]
        opengl.buffer(block).bind_to_uniform_block(0)
        opengl.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
        pictures.append(np.frombuffer(target.read(components=3, dtype="f4"), np.float32))
    assert np.isfinite(pictures).all()
    assert np.min(pictures) > 0
    assert (pictures[0] != pictures[2]).all()
