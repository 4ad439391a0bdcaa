# SPDX-License-Identifier: Apache-2.0
"""The GPU passes: arguments in, a drawn target out. No pass keeps the viewer's state.

Targets keep row 0 of the image in row 0 of the texture (shaders/README.md), so reading one back
gives the image's rows from the top.

Symbols: N lobes; H, W rows and columns of a target, sizes written (W, H) as OpenGL does.
"""

import moderngl
import numpy as np

from asglight.lobes import Form, Lobes
from asglight.viewer import glsl
from asglight.viewer.state import MAX_LOBES, Display, ToneCurve

DEFINES = {"MAX_LOBES": MAX_LOBES, **glsl.enum_defines(Form), **glsl.enum_defines(ToneCurve)}
"""The constants that Python and GLSL share."""

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


def pass_program(context: moderngl.Context, fragment: str) -> moderngl.Program:
    """Compile the pass of a fragment shader in shaders/."""
    vertex = glsl.expanded(glsl.VERTEX_SHADER)
    return glsl.program(context, vertex, glsl.expanded(fragment, DEFINES))


def radiance_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for linear radiance, RGBA32F: half floats end below a sun."""
    return context.framebuffer([context.texture(size, 4, dtype="f4")])


def display_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for sRGB, RGBA8."""
    return context.framebuffer([context.texture(size, 4)])


def target_texture(target: moderngl.Framebuffer) -> moderngl.Texture:
    """Return the texture that a target draws into."""
    (texture,) = target.color_attachments
    assert isinstance(texture, moderngl.Texture)
    return texture


def release_target(target: moderngl.Framebuffer) -> None:
    """Free a target with its texture."""
    texture = target_texture(target)
    target.release()
    texture.release()


def packed_lobes(lobes: Lobes) -> bytes:
    """Lay lobes out as LobesBlock of shaders/lobes_block.glsl (std140).

    Args:
        lobes: At most MAX_LOBES.  [N, .]
    """
    assert lobes.count <= MAX_LOBES, lobes.count
    header = np.zeros(1, _HEADER)
    header["count"] = lobes.count
    header["form"] = glsl.enum_number(lobes.form)
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
        _cover(self._context, self._triangle, target)


class DisplayPass:
    """Linear radiance -> exposure, tone curve, sRGB (shaders/display.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        self._context = context
        self._program = pass_program(context, "display.frag")
        self._program["u_radiance"] = 0
        self._triangle = context.vertex_array(self._program, [])

    def draw(
        self, radiance: moderngl.Texture, display: Display, target: moderngl.Framebuffer
    ) -> None:
        """Draw radiance, texel by texel, into a display target of the same size."""
        assert radiance.size == target.size, (radiance.size, target.size)
        radiance.use(location=0)
        self._program["u_exposure_ev"] = display.exposure_ev
        self._program["u_tone_curve"] = glsl.enum_number(display.tone_curve)
        _cover(self._context, self._triangle, target)


def _cover(
    context: moderngl.Context, triangle: moderngl.VertexArray, target: moderngl.Framebuffer
) -> None:
    """Draw over a whole target, whatever state the last user of the context left behind."""
    target.use()
    context.enable_only(moderngl.NOTHING)
    triangle.render(moderngl.TRIANGLES, vertices=3)
