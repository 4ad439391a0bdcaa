// SPDX-License-Identifier: Apache-2.0
// Soft shadows of lobes in closed form; the twin of asglight/shading/occlusion.py, where the formulas
// are explained.

#include "lib/math.glsl"
#include "lib/rectified.glsl"

// A sheet as shadows take it.
struct OcclusionSheet {
    vec4 axis_x;  // xyz unit axis, w disc variance along it
    vec4 axis_y;  // xyz unit axis, w disc variance along it
    vec4 light;   // rgb irradiance over pi of the surface, w mean of the cosine to its normal
    vec4 more;    // x variance of the cosine, y the Gaussian's integral over the sheet's, z 1 over the
                  // mean of the positive cosine, w free
};

// An ellipse of directions.
struct OcclusionPatch {
    vec3 centre;
    vec3 half_x;
    vec3 half_y;
};

// Return where a ball stands, from a point outside of it.
OcclusionPatch occlusion_ball_patch(vec3 point, vec3 centre, float radius) {
    vec3 towards = centre - point;
    float away = length(towards);
    vec3 axis = towards / away;
    float sine = min(radius / away, 1.0);
    vec3 helper = abs(axis.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 0.0, 1.0);
    vec3 across = normalize(cross(helper, axis));
    return OcclusionPatch(axis * sqrt(1.0 - sine * sine), across * sine, cross(axis, across) * sine);
}

// Return where an upright post stands, from a point on the ground.
OcclusionPatch occlusion_post_patch(vec3 point, vec3 foot, float radius, float height) {
    vec3 away = foot - point;
    float apart = length(away);
    float level = max(apart, radius);
    vec3 forward = away / max(apart, 1e-9);  // at the very foot
    float middle = 0.5 * atan(height, level);
    float c = cos(middle), s = sin(middle);
    vec3 up = vec3(0.0, 1.0, 0.0);
    vec3 side = cross(up, forward);
    float wide = min(radius / level, 1.0) * c;
    return OcclusionPatch(forward * c + up * s, side * (SQUARE_ELLIPSE * wide),
                          (up * c - forward * s) * (SQUARE_ELLIPSE * middle));
}

// Return Phi by a tanh, within 3e-4: two of it are needed at each place.
float occlusion_phi(float x) {
    float u = clamp(x, -8.0, 8.0);
    return 1.0 / (1.0 + exp(-u * (1.5957691 + 0.0713548 * u * u)));
}

// Return P(|X|^2 < 1) by three places across a long light.
float occlusion_by_places(float along, float across, float longer, float shorter) {
    float kept = CIRCLE_VARIANCE / (CIRCLE_VARIANCE + shorter);
    float middle = across * kept;
    float step_ = sqrt(3.0 * shorter * kept);
    float scale = sqrt(kept) * exp(-0.5 * across * across / (CIRCLE_VARIANCE + shorter));
    float inverse = inversesqrt(longer);
    float total = 0.0;
    for (int k = -1; k <= 1; ++k) {
        float place = middle + float(k) * step_;
        float chord = sqrt(max(1.0 - place * place, 0.0));
        float inside = occlusion_phi((chord - along) * inverse)
            - occlusion_phi((-chord - along) * inverse);
        float bell = exp(0.5 / CIRCLE_VARIANCE * min(place * place, 1.0));
        total += (k == 0 ? 4.0 : 1.0) / 6.0 * bell * inside;
    }
    return clamp(scale * total, 0.0, 1.0);
}

// Return P(|X|^2 < 1) for a light wider than the circle, which is taken as a bell.
float occlusion_by_bell(vec2 mu, float s_xx, float s_yy, float s_xy, float determinant) {
    float blurred = determinant + 0.25 * (s_xx + s_yy) + 0.0625;  // a sum of positive terms
    float square = (s_yy + 0.25) * mu.x * mu.x - 2.0 * s_xy * mu.x * mu.y
        + (s_xx + 0.25) * mu.y * mu.y;
    // rounding may bring the square of a very long light, which is not wide, below 0
    return 0.5 * inversesqrt(blurred) * exp(-0.5 * max(square / blurred, 0.0));
}

// Return P(|X|^2 < 1) by the power that is nearly normal.
float occlusion_by_power(vec2 mu, float s_xx, float s_yy, float s_xy, float determinant) {
    float trace = s_xx + s_yy;
    float mu2 = dot(mu, mu);
    float mu_s_mu = s_xx * mu.x * mu.x + 2.0 * s_xy * mu.x * mu.y + s_yy * mu.y * mu.y;
    float first = trace + mu2;
    float second = max(trace * trace - 2.0 * determinant + 2.0 * mu_s_mu, 1e-12);
    float third = trace * trace * trace - 3.0 * trace * determinant
        + 3.0 * (trace * mu_s_mu - determinant * mu2);
    float power = 1.0 - 2.0 * first * third / (3.0 * second * second);
    power = abs(power) < POWER_MIN ? POWER_MIN : power;
    float raised = (exp(clamp(-power * log(first), -60.0, 60.0)) - 1.0) / power;
    float z = (raised - second * (power - 1.0) / (first * first)) * first
        * inversesqrt(2.0 * second);
    return occlusion_phi(z);
}

// Return the share of a Gaussian on the disc that lies in an ellipse.
float occlusion_probability(vec2 centre, vec2 half_x, vec2 half_y, vec2 variance) {
    float area = half_x.x * half_y.y - half_y.x * half_x.y;
    bool is_thin = abs(area) < AREA_MIN;
    float inverse = 1.0 / (is_thin ? 1.0 : area);
    vec2 mu = -inverse * vec2(half_y.y * centre.x - half_y.x * centre.y,
                              half_x.x * centre.y - half_x.y * centre.x);
    vec2 v = variance * (inverse * inverse);
    float s_xx = half_y.y * half_y.y * v.x + half_y.x * half_y.x * v.y;
    float s_yy = half_x.y * half_x.y * v.x + half_x.x * half_x.x * v.y;
    float s_xy = -(half_y.y * half_x.y * v.x + half_y.x * half_x.x * v.y);
    float trace = s_xx + s_yy;
    float determinant = v.x * variance.y;
    float apart = sqrt(0.25 * (s_xx - s_yy) * (s_xx - s_yy) + s_xy * s_xy);
    float longer = 0.5 * trace + apart;
    float shorter = determinant / longer;
    float half_ = 0.5 * (s_xx - s_yy);
    vec2 axis = half_ > 0.0 ? vec2(half_ + apart, s_xy) : vec2(s_xy, apart - half_);
    axis /= max(length(axis), 1e-30);  // a round light, whose axes are any
    float along = dot(axis, mu);
    float across = axis.x * mu.y - axis.y * mu.x;
    float ratio = sqrt(longer / shorter);
    float part = clamp((ratio - RATIO_LOW) / (RATIO_HIGH - RATIO_LOW), 0.0, 1.0);
    float places = occlusion_by_places(along, across, longer, shorter);
    float power = occlusion_by_power(mu, s_xx, s_yy, s_xy, determinant);
    // a sum of products: the power of a very long light is no number
    float share = part < 1.0 ? mix(power, places, part) : places;
    float wide = clamp((shorter - WIDE_LOW) / (WIDE_HIGH - WIDE_LOW), 0.0, 1.0);
    float bell = occlusion_by_bell(mu, s_xx, s_yy, s_xy, determinant);
    share = wide < 1.0 ? mix(share, bell, wide) : bell;
    return is_thin ? 0.0 : share;
}

// Return the share of a sheet's light that comes through a patch.
float occlusion_blocked(OcclusionSheet sheet, OcclusionPatch patch_, int window) {
    vec3 axis_z = cross(sheet.axis_x.xyz, sheet.axis_y.xyz);
    mat3 local = mat3(sheet.axis_x.xyz, sheet.axis_y.xyz, axis_z);
    vec3 centre = patch_.centre * local;
    vec3 half_x = patch_.half_x * local;
    vec3 half_y = patch_.half_y * local;
    float reach = max(length(vec2(half_x.z, half_y.z)), 1e-9);
    float front = clamp(1.0 + centre.z / reach, 0.0, 1.0);
    vec2 variance = vec2(sheet.axis_x.w, sheet.axis_y.w);
    float gaussian = sheet.more.y;
    if (window == WINDOW_NONE && variance.x > BROAD_VARIANCE) {  // the disc that keeps areas
        float away = max(length(centre), 1e-9);
        vec3 unit = centre / away;
        float flat_ = sqrt(2.0 / (1.0 + away));
        float below = max(1.0 + unit.z, 1e-3);
        float scale = sqrt(2.0 / below);
        half_x = flat_ * (half_x * scale - unit * (0.5 * scale / below * half_x.z));
        half_y = flat_ * (half_y * scale - unit * (0.5 * scale / below * half_y.z));
        centre = unit * scale;
        front = 1.0;
    }
    if (window == WINDOW_STEP) {
        gaussian /= max(abs(centre.z), EDGE_Z_MIN);
    }
    float inside = occlusion_probability(centre.xy, half_x.xy, half_y.xy, variance);
    return clamp(inside * front * gaussian, 0.0, 1.0);
}

// Return the share of a sheet's irradiance that a patch leaves.
float occlusion_visible(OcclusionSheet sheet, OcclusionPatch patch_, vec3 normal, int window) {
    float share = occlusion_blocked(sheet, patch_, window);
    float height = dot(patch_.centre, normal) / max(length(patch_.centre), 1e-9);
    float x = dot(patch_.half_x, normal);
    float y = dot(patch_.half_y, normal);
    float spread = 0.25 * (x * x + y * y);
    float both = max(spread + sheet.more.x, 1e-12);
    float middle = (sheet.light.w * spread + height * sheet.more.x) / both;
    vec2 cut = rectified(middle, sqrt(spread * sheet.more.x / both));
    float cosine = cut.x / max(cut.y, SEEN_MIN);
    return clamp(1.0 - share * cosine * sheet.more.z, 0.0, 1.0);
}
