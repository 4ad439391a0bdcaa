// SPDX-License-Identifier: Apache-2.0
// A latlong map -> the linear radiance behind the balls, in perspective.
#version 410 core

#include "lib/latlong.glsl"

uniform sampler2D u_latlong;
uniform vec2 u_size;  // columns and rows of the target
uniform mat3 u_camera_from_environment;

layout(location = 0) out vec4 o_radiance;

void main() {
    // 90 degrees across: the camera looks along -z, columns reach from -1 to 1.
    vec2 across = (2.0 * gl_FragCoord.xy - u_size) / u_size.x;
    vec3 direction = normalize(vec3(across.x, -across.y, -1.0));  // row 0 is the top
    vec2 uv = latlong_uv(transpose(u_camera_from_environment) * direction);
    // Without derivatives: across the seam they would choose the smallest mip.
    o_radiance = vec4(textureLod(u_latlong, uv, 0.0).rgb, 1.0);
}
