// SPDX-License-Identifier: Apache-2.0
// Linear radiance -> sRGB, texel by texel: the only pass that knows exposure, tone curve and sRGB.
#version 410 core

#include "lib/display.glsl"

uniform sampler2D u_radiance;  // same size as the target
uniform float u_exposure_ev;
uniform int u_tone_curve;  // a TONE_CURVE_ number

layout(location = 0) out vec4 o_color;

void main() {
    vec3 radiance = texelFetch(u_radiance, ivec2(gl_FragCoord.xy), 0).rgb;
    vec3 exposed = display_exposed(radiance, u_exposure_ev);
    o_color = vec4(display_srgb(display_tone_mapped(exposed, u_tone_curve)), 1.0);
}
