// SPDX-License-Identifier: Apache-2.0
// A GGX layer under lobes with view and roughness free at each point: what
// asglight/viewer/gl/balls_pass.py computes once for a ball. Twins of functions of
// asglight/shading/ggx_layer.py, where the formulas are explained.

#include "lib/ggx_lobes.glsl"

struct GgxLobesTilt {
    vec3 half_vector;
    vec3 slope_x;
    vec3 slope_y;
};

// Place the frame of tangent, bitangent and normal; `view` is unit, towards the camera.
GgxLobesSurface ggx_lobes_surface_seen_from(vec3 view, vec3 normal) {
    float cos_view = dot(normal, view);
    vec3 tangential = view - cos_view * normal;
    float sin_view = length(tangential);
    // Seen along the normal every tangent is as good.
    vec3 helper = abs(normal.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
    vec3 tangent = sin_view > SIN_VIEW_MIN ? tangential / sin_view : normalize(cross(helper, normal));
    return GgxLobesSurface(normal, tangent, cross(normal, tangent), max(cos_view, COS_VIEW_MIN),
                           sin_view);
}

// Return how a sheet spreads half vectors; `spread_x` and `spread_y` are its axes times the
// deviations along them.
GgxLobesTilt ggx_lobes_tilt(vec3 spread_x, vec3 spread_y, vec3 axis_z, vec3 view, float log_gain) {
    vec3 sum = axis_z + view;
    float size = max(length(sum), HALF_MIN);
    // A light straight behind has its half vectors across the view, one as good as another.
    vec3 half_vector = size > HALF_MIN ? sum / size : normalize(spread_x);
    float widening = sqrt(2.0 * exp(log_gain)) / size;
    vec3 slope_x = (spread_x - half_vector * dot(half_vector, spread_x)) * widening;
    vec3 slope_y = (spread_y - half_vector * dot(half_vector, spread_y)) * widening;
    return GgxLobesTilt(half_vector, slope_x, slope_y);
}

// Return the mean of Schlick's (1 - v.h)^5 over a sheet; `cosine` holds mean and deviation of v.w.
float ggx_lobes_grazing(vec2 cosine, float alpha) {
    const vec3 WEIGHTS = vec3(1.0, 4.0, 1.0) / 6.0;  // of Gauss and Hermite's three nodes
    vec3 nodes = vec3(-1.0, 0.0, 1.0) * (sqrt(3.0) * alpha * cosine.y);
    vec3 cos_half = sqrt(clamp(0.5 + 0.5 * (cosine.x + nodes), 0.0, 1.0));
    vec3 weights = WEIGHTS * max(cos_half * cos_half, HALF_MIN * HALF_MIN);
    vec3 sine = 1.0 - cos_half;
    vec3 sine2 = sine * sine;
    return dot(weights, sine2 * sine2 * sine) / dot(weights, vec3(1.0));
}

// Return the mean of (v.h)^2 over a sheet; `cos_view` is the mean of v.w.
float ggx_lobes_cos_half2(float cos_view) {
    return max(0.5 + 0.5 * cos_view, HALF_MIN * HALF_MIN);
}

// Return how narrow a sheet is to the layer: 0 where both approximations count the same. `fitted`
// holds the centre for the sheet's window, log slope, weights of the ratio and of v.h.
float ggx_lobes_narrowness(vec2 disc_variance, float cos_half2, float alpha, vec4 fitted) {
    const float TO_LOG10 = 0.434294481903252;
    float alpha2 = alpha * alpha;
    float slopes = alpha2 / max(1.0 - alpha2, UNSHARP_MIN);
    float narrow = log(0.5 * slopes * inversesqrt(disc_variance.x * disc_variance.y));
    float ratio = abs(log(disc_variance.x / disc_variance.y));
    return (narrow + fitted.z * ratio + fitted.w * 0.5 * log(cos_half2)) * TO_LOG10 - fitted.x;
}

// Return the share of ggx_lobes_narrow, exactly 0 or 1 where it is within SHARE_MIN.
float ggx_lobes_share(float narrowness, float log_slope) {
    float part = 1.0 / (1.0 + exp(-exp(log_slope) * narrowness));
    return part < SHARE_MIN ? 0.0 : part > 1.0 - SHARE_MIN ? 1.0 : part;
}

// Return how much of ggx_lobes_broad is left of a light behind the ball.
float ggx_lobes_kept(float cos_half2, float alpha, float log_lost) {
    return 1.0 - exp(-cos_half2 / (exp(log_lost) * alpha * alpha));
}
