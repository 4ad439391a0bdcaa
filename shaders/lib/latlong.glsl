// SPDX-License-Identifier: Apache-2.0
// The latlong map; the twin of asglight/sphere/latlong.py.
//
// Right-handed, +Y up. uv is in [0, 1] from the top left corner: v = 0 is +Y, the centre is +Z,
// u = 1/4 is +X.

#include "lib/math.glsl"

// Return the unit direction of latlong coordinates.
vec3 latlong_direction(vec2 uv) {
    float longitude = PI - 2.0 * PI * uv.x;
    float latitude = 0.5 * PI - PI * uv.y;
    float cos_latitude = cos(latitude);
    return vec3(cos_latitude * sin(longitude), sin(latitude), cos_latitude * cos(longitude));
}

// Return the latlong coordinates of a vector of any positive length; at a pole u is 1/2.
vec2 latlong_uv(vec3 direction) {
    float horizontal = length(direction.xz);
    // GLSL leaves atan(0, 0) undefined.
    float longitude = horizontal > 0.0 ? atan(direction.x, direction.z) : 0.0;
    return vec2(0.5 - longitude / (2.0 * PI), 0.5 - atan(direction.y, horizontal) / PI);
}
