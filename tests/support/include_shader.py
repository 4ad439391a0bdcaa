# SPDX-License-Identifier: Apache-2.0
"""A small shader of its own that includes an exported environment and calls it at given points."""

from collections.abc import Callable

import moderngl
import numpy as np
import torch
from torch import Tensor

from asglight.export.environment import BLOCK

POINTS = 256
DESKTOP, EMBEDDED = "#version 330 core\n", "#version 300 es\n"
VERTEX = """
void main() {
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""
# The includer may have a PI of its own.
MAIN = """
#define PI 3.0
uniform highp sampler2D u_points;
uniform float u_roughness;
uniform vec3 u_f0;
layout(location = 0) out vec4 o;
void main() {
    int x = int(gl_FragCoord.x);
    vec3 normal = texelFetch(u_points, ivec2(x, 0), 0).xyz;
    vec3 view = texelFetch(u_points, ivec2(x, 1), 0).xyz;
    o = RESULT;
}
"""

Shown = Callable[..., Tensor]


def points() -> Tensor:
    """Return unit normals and views that see them, near grazing too, of float32.  [2, P, 3]."""
    generator = torch.Generator().manual_seed(1)
    normal, other = torch.nn.functional.normalize(
        torch.randn(2, POINTS, 3, generator=generator, dtype=torch.float64), dim=-1
    )
    across = torch.nn.functional.normalize(torch.linalg.cross(normal, other), dim=-1)
    cos_view = torch.linspace(0.02, 1, POINTS, dtype=torch.float64)[:, None]
    view = cos_view * normal + (1 - cos_view**2).sqrt() * across
    return torch.stack([normal, view]).float().double()


def shown(opengl: moderngl.Context, include: str, result: str, version: str = DESKTOP) -> Shown:
    """Compile a shader that includes the text; return what runs it at the points.  [P, 4]."""
    fragment = version + include + "precision highp float;\n" + MAIN.replace("RESULT", result)
    program = opengl.program(vertex_shader=version + VERTEX, fragment_shader=fragment)
    if BLOCK in program:
        program[BLOCK].binding = 0
    triangle = opengl.vertex_array(program, [])
    texture = opengl.texture((POINTS, 2), 3, points().float().numpy().tobytes(), dtype="f4")
    target = opengl.framebuffer([opengl.texture((POINTS, 1), 4, dtype="f4")])

    def run(roughness: float = 1.0, f0: tuple[float, float, float] = (0, 0, 0)) -> Tensor:
        for name, value in {"u_roughness": roughness, "u_f0": f0, "u_points": 0}.items():
            if name in program:
                program[name] = value
        texture.use(0)
        target.use()
        opengl.enable_only(moderngl.NOTHING)
        triangle.render(moderngl.TRIANGLES, vertices=3)
        values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
        return torch.from_numpy(values.copy()).double().reshape(POINTS, 4)

    return run
