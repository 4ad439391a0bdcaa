// SPDX-License-Identifier: Apache-2.0
// Sum of lobes -> linear radiance, a latlong map. Each texel holds the value at its centre.
#version 410 core

#include "lib/latlong.glsl"
#include "lobes_block.glsl"

uniform vec2 u_size;  // columns and rows of the target

layout(location = 0) out vec4 o_radiance;

void main() {
    vec3 direction = latlong_direction(gl_FragCoord.xy / u_size);
    o_radiance = vec4(lobes_radiance(direction), 1.0);
}
