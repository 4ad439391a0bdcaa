# SPDX-License-Identifier: Apache-2.0
"""The GGX layer's directional albedo as a texture: one table for every pass that shades balls."""

import moderngl

from asglight.viewer.uniforms.albedo_values import SIZE, albedo_values


def albedo_table(context: moderngl.Context) -> moderngl.Texture:
    """Return A and B of `f0 A + B` over the roots of n.v (columns) and roughness (rows), RG32F."""
    table = context.texture((SIZE, SIZE), 2, albedo_values().tobytes(), dtype="f4")
    table.filter = moderngl.LINEAR, moderngl.LINEAR
    table.repeat_x = table.repeat_y = False
    return table
