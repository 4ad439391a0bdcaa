// SPDX-License-Identifier: Apache-2.0
// A ball lit by a latlong map without samples: linear radiance times coverage, and coverage.
//
// With TABLE, what asglight/shading/ball_tables.py has summed at normals. Without it, for the
// sharpest balls while something moves: the map's mip levels around the mirror direction. GGX is a
// mixture of even discs in slopes, of which SMOOTH_DISCS of equal weight are looked up, each in the
// level that is as wide as its light; disc k has rho^2 = alpha^2 sqrt(W) / (1 - sqrt(W)) with
// W = (k + 1/2) / SMOOTH_DISCS, which is the mixture's distribution inverted.
#version 410 core

#include "lib/ggx.glsl"
#include "lib/latlong.glsl"

const int SMOOTH_DISCS = 5;

uniform vec3 u_cell;          // column, row and size in pixels
uniform sampler2D u_table;    // radiance over angles and azimuths of normals; without TABLE, irradiance over pi
#ifndef TABLE
uniform sampler2D u_map;      // with mips
uniform sampler2D u_albedo_table;
uniform mat3 u_world_from_camera;  // columns right, up, view
uniform float u_roughness;
uniform vec3 u_f0;
uniform vec3 u_albedo;
#endif

layout(location = 0) out vec4 o_radiance;

// Return what the table holds for the normal at a place of the picture, x right, y down: rows are
// angles to the view, columns azimuths.
vec3 at_normal(vec2 place, float radius) {
    vec2 size = vec2(textureSize(u_table, 0));
    float angle = asin(min(radius, 1.0)) / (0.5 * PI);
    float azimuth = radius > 0.0 ? atan(-place.y, place.x) / (2.0 * PI) : 0.0;
    vec2 texel = vec2(azimuth * size.x, angle * (size.y - 1.0)) + 0.5;
    return textureLod(u_table, texel / size, 0.0).rgb;
}

#ifndef TABLE
// Return the map in texels of a squared width, filtered linearly.
vec3 around(vec3 direction, float width2) {
    float rows = float(textureSize(u_map, 0).y);
    float lod = log2(max(sqrt(width2) * rows / PI, 1.0));
    return textureLod(u_map, latlong_uv(direction), lod).rgb;
}

vec3 mirrored(vec3 normal, float pixel) {
    float alpha = u_roughness * u_roughness;
    vec3 direction = u_world_from_camera * (2.0 * normal.z * normal - vec3(0.0, 0.0, 1.0));
    float of_pixel = 4.0 * pixel * pixel;  // dw = 4 dx dy on a mirror ball
    vec3 sum = vec3(0.0);
    for (int k = 0; k < SMOOTH_DISCS; ++k) {
        float root = sqrt((float(k) + 0.5) / float(SMOOTH_DISCS));
        float rho2 = alpha * alpha * root / (1.0 - root);
        // dl = 4 v.h dh; a texel filtered linearly has the variance of an even disc of its width as
        // radius. Texels as wide as pixels are apart show each lamp with all of its light.
        sum += around(direction, min(of_pixel + 4.0 * normal.z * rho2, 4.0));
    }
    return sum / float(SMOOTH_DISCS);
}
#endif

void main() {
    vec2 place = 2.0 * (gl_FragCoord.xy - u_cell.xy) / u_cell.z - 1.0;
    float pixel = 2.0 / u_cell.z;
    float radius = length(place);
    float coverage = clamp((1.0 - radius) / pixel + 0.5, 0.0, 1.0);
    // On the edge, the middle of what is covered of the pixel.
    float inner = max(min(radius, 0.5 * (radius + 1.0 - 0.5 * pixel)), 0.0);
    vec2 xy = radius > 0.0 ? place * (inner / radius) : place;
#ifdef TABLE
    vec3 radiance = at_normal(xy, inner);
#else
    vec3 normal = vec3(xy.x, -xy.y, sqrt(max(1.0 - inner * inner, 0.0)));
    vec2 parts = ggx_albedo_parts(u_albedo_table, normal.z, u_roughness);
    vec3 albedo = u_f0 * parts.x + parts.y;
    vec3 radiance = albedo * mirrored(normal, pixel)
        + u_albedo * (1.0 - albedo) * at_normal(xy, inner);
#endif
    o_radiance = vec4(radiance, 1.0) * coverage;
}
