# SPDX-License-Identifier: Apache-2.0
"""The GPU passes: arguments in, a drawn target out. No pass keeps the viewer's state.

Targets keep row 0 of the image in row 0 of the texture (shaders/README.md), so reading one back
gives the image's rows from the top.

Symbols: N lobes; H, W rows and columns of a target, sizes written (W, H) as OpenGL does.
"""

from collections.abc import Mapping
from typing import NamedTuple

import moderngl
import numpy as np

from asglight import shader_files
from asglight.lobes import Lobes
from asglight.viewer.gl import glsl
from asglight.viewer.state.viewer_state import MAX_LOBES
from asglight.viewer.uniforms.shader_defines import DEFINES

Area = tuple[int, int, int, int]
"""x, y, columns and rows of a part of a target; row 0 is the top."""

_HEADER = np.dtype([("count", "<i4"), ("form", "<i4"), ("padding", "<i4", 2)])
_LOBE = np.dtype(
    [
        ("axis_x", "<f4", 3),
        ("sharpness_x", "<f4"),
        ("axis_y", "<f4", 3),
        ("sharpness_y", "<f4"),
        ("axis_z", "<f4", 4),
        ("amplitude", "<f4", 4),
    ]
)
_BLOCK_BYTES = _HEADER.itemsize + MAX_LOBES * _LOBE.itemsize


def pass_program(
    context: moderngl.Context,
    fragment: str,
    special: Mapping[str, float] | None = None,
    before: str = "",
) -> moderngl.Program:
    """Compile the pass of a fragment shader in shaders/, with constants of one scene if any.

    `before` is GLSL that it calls, if any.
    """
    vertex = glsl.expanded(shader_files.VERTEX_SHADER)
    defines = {**DEFINES, **(special or {})}
    return glsl.program(context, vertex, glsl.expanded(fragment, defines, before=before))


def radiance_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for linear radiance, RGBA32F: half floats end below a sun."""
    texture = context.texture(size, 4, dtype="f4")
    texture.repeat_x = texture.repeat_y = False  # a coarse picture is filtered up to its edges
    return context.framebuffer([texture])


def display_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for sRGB, RGBA8."""
    texture = context.texture(size, 4)
    texture.filter = moderngl.NEAREST, moderngl.NEAREST  # a texel is a pixel, magnified or not
    return context.framebuffer([texture])


def target_texture(target: moderngl.Framebuffer) -> moderngl.Texture:
    """Return the texture that a target draws into."""
    (texture,) = target.color_attachments
    assert isinstance(texture, moderngl.Texture)
    return texture


def packed_lobes(lobes: Lobes) -> bytes:
    """Lay lobes out as LobesBlock of shaders/lobes_block.glsl (std140).

    Args:
        lobes: At most MAX_LOBES.  [N, .]
    """
    assert lobes.count <= MAX_LOBES, lobes.count
    header = np.zeros(1, _HEADER)
    header["count"] = lobes.count
    header["form"] = shader_files.enum_number(lobes.form)
    block = np.zeros(lobes.count, _LOBE)
    values = lobes.to("cpu")
    for name in ("axis_x", "axis_y", "axis_z", "amplitude"):
        block[name][:, :3] = getattr(values, name).detach().numpy()
    block["sharpness_x"], block["sharpness_y"] = values.sharpness.detach().numpy().T
    return header.tobytes() + block.tobytes()


class LobesPass:
    """Sum of lobes -> linear radiance, a latlong map (shaders/lobes.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        self._context = context
        self._program = pass_program(context, "lobes.frag")
        self._program["LobesBlock"].binding = 0
        self._triangle = context.vertex_array(self._program, [])
        self._block = context.buffer(reserve=_BLOCK_BYTES)

    def draw(self, lobes: Lobes, target: moderngl.Framebuffer) -> None:
        """Draw the radiance of N lobes at the centre of each texel of a radiance target."""
        self._block.write(packed_lobes(lobes))
        self._block.bind_to_uniform_block(0)
        self._program["u_size"] = target.size
        cover(self._context, self._triangle, target)


class BackgroundPass:
    """A latlong map -> the radiance behind the balls (shaders/background.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        self._context = context
        self._program = pass_program(context, "background.frag")
        self._program["u_latlong"] = 0
        self._triangle = context.vertex_array(self._program, [])

    def draw(
        self,
        latlong: moderngl.Texture,
        camera_from_environment: np.ndarray,
        target: moderngl.Framebuffer,
    ) -> None:
        """Draw a latlong map, 90 degrees of it across a radiance target, as a camera sees it.

        Args:
            latlong: Radiance, filtered linearly, repeating in columns.
            camera_from_environment: A rotation.  [3, 3]
            target: A radiance target.
        """
        latlong.use(location=0)
        self._program["u_size"] = target.size
        # OpenGL stores columns
        self._program["u_camera_from_environment"].write(
            camera_from_environment.T.astype("f4").tobytes()
        )
        cover(self._context, self._triangle, target)


class Picture(NamedTuple):
    """Linear radiance to be shown, of any size.

    Attributes:
        front: RGB multiplied by the coverage in alpha.
        background: What shows through, or None.
    """

    front: moderngl.Texture
    background: moderngl.Texture | None = None


def cover(
    context: moderngl.Context,
    triangle: moderngl.VertexArray,
    target: moderngl.Framebuffer,
    area: Area | None = None,
) -> None:
    """Draw over a target or an area of it, whatever state the last user of the context left."""
    target.use()
    context.enable_only(moderngl.NOTHING)
    target.viewport = area or (0, 0, *target.size)
    triangle.render(moderngl.TRIANGLES, vertices=3)
