// SPDX-License-Identifier: Apache-2.0
// Points, and what is drawn with them. Cosines and vectors are in the frame of a surface, normal +Z.

#include "lib/math.glsl"

// Return four random numbers for four numbers: pcg4d [Jarzynski and Olano 2020].
uvec4 sampling_hash(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v += v.yzxy * v.wxyz;
    v ^= v >> 16;
    v += v.yzxy * v.wxyz;
    return v;
}

// Return points in [0, 1) whose digits are those of `digits`, changed where `scramble` has a 1.
vec4 sampling_scrambled(uvec4 digits, uvec4 scramble) {
    return vec4((digits ^ scramble) >> 8) * (1.0 / 16777216.0);  // 24 bits: rounding would give 1
}

// Return a half vector, distributed as the normals of the microfacets that the view sees
// [Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps"].
vec3 sampling_visible_half(vec3 view, float alpha, vec2 point) {
    vec3 stretched = normalize(vec3(alpha * view.xy, view.z));
    float turn = 2.0 * PI * point.x;
    float z = 1.0 - point.y * (1.0 + stretched.z);
    float sine = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 cap = vec3(sine * cos(turn), sine * sin(turn), z) + stretched;
    // alpha * 0 of both only where the cap's point is opposite to the view: one point of all
    return normalize(vec3(alpha * cap.xy, max(cap.z, 1e-20)));
}

// Return a direction, evenly distributed over the solid angle of a texel of a latlong map.
vec3 sampling_texel_direction(vec2 texel, vec2 size, vec2 point) {
    float longitude = PI - 2.0 * PI * (texel.x + point.x) / size.x;
    // sin^2 of half the angle to the nearer pole: it is even over the area, and keeps its digits
    // where sines of latitudes are all but 1.
    bool upper = 2.0 * texel.y < size.y;
    float row = upper ? texel.y : size.y - 1.0 - texel.y;
    vec2 half_sine = sin(0.5 * PI * vec2(row, row + 1.0) / size.y);
    float area = mix(half_sine.x * half_sine.x, half_sine.y * half_sine.y, point.y);
    float level = 2.0 * sqrt(area * (1.0 - area));
    float y = 1.0 - 2.0 * area;
    return vec3(level * sin(longitude), upper ? y : -y, level * cos(longitude));
}
