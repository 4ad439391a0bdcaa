// SPDX-License-Identifier: Apache-2.0
// Two pictures of the same balls under two lights -> under both: radiance adds, coverage is the same.
#version 410 core

uniform sampler2D u_first;
uniform sampler2D u_second;

layout(location = 0) out vec4 o_radiance;

void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    vec4 first = texelFetch(u_first, place, 0);
    o_radiance = vec4(first.rgb + texelFetch(u_second, place, 0).rgb, first.a);
}
