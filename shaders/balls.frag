// SPDX-License-Identifier: Apache-2.0
// Lobes -> one ball: linear radiance times coverage, and coverage. asglight/viewer/uniforms/ball_blocks.py
// packs the blocks.
//
// Compiled with WINDOW, the one that all sheets have, and ISOTROPIC where they are all round;
// without them it serves every scene.
#version 410 core

#include "lib/ggx_lobes.glsl"

// What every surface needs to know of a sheet, 64 bytes in std140.
struct Sheet {
    vec4 axis_z;    // byte 0:  xyz unit axis, w mean of z
    vec4 spread_x;  // byte 16: xyz axis_x times the deviation of x, w variance of z
    vec4 spread_y;  // byte 32: xyz axis_y times the deviation of y, w mean of (1 - v.h)^5
    vec4 light;     // byte 48: rgb amplitude times integral over pi, w unused
};

layout(std140) uniform SheetsBlock {
    Sheet u_sheets[MAX_SHEETS];
};

layout(std140) uniform GgxSheetsBlock {
    GgxSheet u_ggx_sheets[MAX_SHEETS];
};

layout(std140) uniform BallBlock {
    vec4 u_cell;        // xy centre and z radius in pixels of the target; w roughness
    vec4 u_f0;          // rgb reflectance along the normal, w alpha
    vec4 u_base;        // rgb diffuse reflectance under the layer
    ivec4 u_runs;       // sheets of narrow: 0 to x; of broad: y to z; of the base: 0 to w
    ivec2 u_kind;       // x a WINDOW_ number, y whether there is a layer
    float u_disc;       // of the DISC_SCALES
    vec4 u_kernel[4 * BROAD_TERMS];
};

uniform sampler2D u_albedo_table;

layout(location = 0) out vec4 o_radiance;

#ifndef WINDOW
#define WINDOW u_kind.x
#endif

// Return mean and standard deviation of the cosine between a normal and a sheet's light.
vec2 cosine(Sheet sheet, vec3 normal) {
    float x = dot(normal, sheet.spread_x.xyz);
    float y = dot(normal, sheet.spread_y.xyz);
    float z = dot(normal, sheet.axis_z.xyz);
    return vec2(z * sheet.axis_z.w, sqrt(x * x + y * y + z * z * sheet.spread_x.w));
}

// Return what the base shows with nothing over it.
vec3 base_radiance(vec3 normal) {
    vec3 irradiance_over_pi = vec3(0.0);
    for (int i = 0; i < u_runs.w; ++i) {
        vec2 c = cosine(u_sheets[i], normal);
        irradiance_over_pi += u_sheets[i].light.rgb * rectified_irradiance_over_pi(c.x, c.y);
    }
    return u_base.rgb * irradiance_over_pi;
}

// Return what the layer shows; `albedo` is its directional albedo.
vec3 layer_radiance(GgxLobesSurface seen, vec3 albedo) {
    vec3 mirrored = vec3(0.0);
    for (int i = 0; i < u_runs.x; ++i) {
        vec2 c = cosine(u_sheets[i], seen.normal);
        float value = u_ggx_sheets[i].slope_x.w * ggx_lobes_narrow(u_ggx_sheets[i], seen, u_f0.w, c);
        vec3 fresnel = u_f0.rgb + (1.0 - u_f0.rgb) * u_sheets[i].spread_y.w;
        mirrored += u_sheets[i].light.rgb * fresnel * value;
    }
    vec3 blurred = vec3(0.0);
    if (u_runs.y < u_runs.z) {
        GgxLobesKernel kernel = ggx_lobes_kernel(seen, u_f0.w, u_kernel);
        for (int i = u_runs.y; i < u_runs.z; ++i) {
            vec3 axis_z = u_sheets[i].axis_z.xyz;
            float value = ggx_lobes_broad(u_ggx_sheets[i], axis_z, kernel, WINDOW, u_disc);
            blurred += u_sheets[i].light.rgb * (u_ggx_sheets[i].slope_y.w * value);
        }
    }
    return mirrored + albedo * blurred;
}

void main() {
    // Rows count from the top of the image, so up on the ball is down in gl_FragCoord.y.
    vec2 place = (gl_FragCoord.xy - u_cell.xy) * vec2(1.0, -1.0) / u_cell.z;
    float pixel = 1.0 / u_cell.z;
    float distance = length(place);
    float coverage = clamp((1.0 - distance) / pixel + 0.5, 0.0, 1.0);
    if (coverage == 0.0) {
        discard;
    }
    // On the edge, the middle of what is covered of the pixel.
    float inner = min(distance, 0.5 * (distance + 1.0 - 0.5 * pixel));
    vec2 xy = distance > 0.0 ? place * (inner / distance) : place;
    vec3 normal = vec3(xy, sqrt(max(1.0 - inner * inner, 0.0)));
    vec3 radiance = vec3(0.0);
    vec3 let_through = vec3(1.0);
    if (u_kind.y != 0) {
        GgxLobesSurface seen = ggx_lobes_surface(normal);
        vec2 parts = ggx_albedo_parts(u_albedo_table, seen.cos_view, u_cell.w);
        vec3 albedo = u_f0.rgb * parts.x + parts.y;
        radiance = layer_radiance(seen, albedo);
        let_through = 1.0 - albedo;
    }
    if (u_runs.w > 0) {
        radiance += let_through * base_radiance(normal);
    }
    // the terms of a flat lobe have both signs, and are each shown to a percent or so
    o_radiance = vec4(max(radiance, vec3(0.0)), 1.0) * coverage;
}
