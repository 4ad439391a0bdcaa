// SPDX-License-Identifier: Apache-2.0
// The ground under a ball and a post, lit by lobes: linear radiance, with a soft shadow of both for
// each lobe. With POST, the post itself, over ground and ball.
//
// Ground frame: +Y up, +Z level towards the camera, which is far away. Compiled with WINDOW, that of
// all sheets. asglight/viewer/uniforms/ground_blocks.py packs the block.
#version 410 core

#include "lib/occlusion.glsl"

layout(std140) uniform GroundBlock {
    OcclusionSheet u_sheets[MAX_SHEETS];
};

uniform int u_count;
uniform vec3 u_base;         // diffuse reflectance
uniform vec2 u_middle;       // pixel that shows u_focus
uniform float u_unit;        // pixels of the ball's radius
uniform vec3 u_focus;
uniform float u_pitch_sine;  // of the camera over the ground
uniform float u_pitch_cosine;
uniform vec3 u_ball;         // centre; the radius is 1
uniform vec3 u_foot;         // of the post
uniform vec2 u_post;         // its radius and height

layout(location = 0) out vec4 o_radiance;

#ifndef WINDOW
#define WINDOW WINDOW_COSINE
#endif

// Return a point that a pixel looks at; rows count from the top.
vec3 origin() {
    vec2 place = (gl_FragCoord.xy - u_middle) / u_unit;
    return u_focus + vec3(place.x, -place.y * u_pitch_cosine, place.y * u_pitch_sine);
}

#ifdef POST

// Return what the post shows at a point with a normal. Its normal changes, so the sheets hold the mean
// of z, its variance, and those of x and y, in place of what they hold for the ground.
vec3 shaded(vec3 point, vec3 normal) {
    vec3 sum = vec3(0.0);
    OcclusionPatch ball = occlusion_ball_patch(point, u_ball, 1.0);
    for (int i = 0; i < u_count; ++i) {
        OcclusionSheet sheet = u_sheets[i];
        vec3 axis_z = cross(sheet.axis_x.xyz, sheet.axis_y.xyz);
        vec3 along = vec3(dot(normal, sheet.axis_x.xyz), dot(normal, sheet.axis_y.xyz),
                          dot(normal, axis_z));
        float variance = dot(along * along, vec3(sheet.more.zw, sheet.more.x));
        float mean = along.z * sheet.light.w;
        float lit = rectified_irradiance_over_pi(mean, sqrt(variance));
        sheet.light.w = mean;
        sheet.more.x = variance;
        sheet.more.z = 1.0 / max(lit, LIGHT_MIN);
        sum += sheet.light.rgb * (lit * occlusion_visible(sheet, ball, normal, WINDOW));
    }
    return sum;
}

void main() {
    vec3 start = origin();
    vec3 view = vec3(0.0, u_pitch_sine, u_pitch_cosine);
    vec2 aside = start.xz - u_foot.xz;
    float edge = u_post.x - abs(aside.x);
    float coverage = clamp(edge * u_unit + 0.5, 0.0, 1.0);
    float depth = sqrt(max(u_post.x * u_post.x - aside.x * aside.x, 0.0));
    vec3 normal = vec3(aside.x, 0.0, depth) / u_post.x;
    normal = normalize(vec3(normal.x, 0.0, max(normal.z, 1e-3)));
    float t = (depth - aside.y) / view.z;
    vec3 point = start + t * view;
    if (point.y > u_post.y) {  // above the mantle: the lid, a round one
        t = (u_post.y - start.y) / max(view.y, 1e-4);
        point = start + t * view;
        normal = vec3(0.0, 1.0, 0.0);
        float rim = u_post.x - length(point.xz - u_foot.xz);
        coverage = min(coverage, clamp(rim * u_unit * max(view.y, 0.2) + 0.5, 0.0, 1.0));
    }
    // where it meets the ground, and where the ball is nearer
    coverage *= clamp(point.y * u_unit + 0.5, 0.0, 1.0);
    vec3 towards = start - u_ball;
    float along = dot(towards, view);
    float chord2 = 1.0 - dot(towards, towards) + along * along;
    if (chord2 > 0.0 && sqrt(chord2) - along > t) coverage = 0.0;
    if (coverage == 0.0) discard;
    o_radiance = vec4(u_base * shaded(point, normal), 1.0) * coverage;
}

#else

void main() {
    vec3 start = origin();
    vec3 point = start - vec3(0.0, u_pitch_sine, u_pitch_cosine) * (start.y / u_pitch_sine);
    vec3 up = vec3(0.0, 1.0, 0.0);
    OcclusionPatch ball = occlusion_ball_patch(point, u_ball, 1.0);
    OcclusionPatch post = occlusion_post_patch(point, u_foot, u_post.x, u_post.y);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < u_count; ++i) {
        OcclusionSheet sheet = u_sheets[i];
        float left = occlusion_visible(sheet, ball, up, WINDOW)
            * occlusion_visible(sheet, post, up, WINDOW);
        sum += sheet.light.rgb * left;
    }
    o_radiance = vec4(u_base * sum, 1.0);
}

#endif
