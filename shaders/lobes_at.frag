// SPDX-License-Identifier: Apache-2.0
// Sum of lobes -> linear radiance at given directions, one a pixel.
#version 410 core

#include "lobes_block.glsl"

uniform sampler2D u_directions;  // unit, RGB32F, as many as the target has pixels

layout(location = 0) out vec4 o_radiance;

void main() {
    vec3 direction = texelFetch(u_directions, ivec2(gl_FragCoord.xy), 0).xyz;
    o_radiance = vec4(lobes_radiance(direction), 1.0);
}
