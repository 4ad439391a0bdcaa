// SPDX-License-Identifier: Apache-2.0
// The GGX microfacet reflectance; the twin of asglight/shading/ggx.py, alpha = roughness^2.

#include "lib/math.glsl"

// Return the distribution D of half vectors, per steradian, at sin^2 of the angle to the normal.
float ggx_distribution(float sin2_half, float alpha) {
    float alpha2 = alpha * alpha;
    float shape = alpha2 + (1.0 - alpha2) * sin2_half;
    return alpha2 / (PI * shape * shape);
}

// Return V = G2 / (4 n.v n.l), Smith height-correlated [Heitz 2014]; n.v > 0, n.l >= 0.
float ggx_visibility(float cos_view, float cos_light, float alpha) {
    float alpha2 = alpha * alpha;
    float view_root = sqrt(alpha2 + (1.0 - alpha2) * cos_view * cos_view);
    float light_root = sqrt(alpha2 + (1.0 - alpha2) * cos_light * cos_light);
    return 0.5 / (cos_light * view_root + cos_view * light_root);
}

// Return Schlick's reflectance [Schlick 1994].
vec3 ggx_fresnel(vec3 f0, float cos_half) {
    float grazing = clamp(1.0 - cos_half, 0.0, 1.0);
    float grazing2 = grazing * grazing;
    return f0 + (1.0 - f0) * (grazing2 * grazing2 * grazing);
}

// Return A and B of the directional albedo f0 A + B from the table of
// asglight/viewer/uniforms/albedo_values.py: even in the roots of n.v and roughness; texel centres of
// the outermost texels hold the ends of the range.
vec2 ggx_albedo_parts(sampler2D table, float cos_view, float roughness) {
    vec2 texels = vec2(textureSize(table, 0));
    vec2 place = sqrt(max(vec2(cos_view, roughness), 0.0));
    vec2 uv = (place * (texels - 1.0) + 0.5) / texels;
    return texture(table, uv).rg;
}
