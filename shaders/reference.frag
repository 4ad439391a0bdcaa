// SPDX-License-Identifier: Apache-2.0
// A ball lit by a latlong map, by the whole integral over the lights: some samples more of a mean.
//
// The map is a rest without great peaks, and suns (asglight/viewer/reference/reference_map.py). The rest is
// looked up for visible half vectors, in a mip level as wide as the share of the sphere that a
// sample stands for [Krivanek and Colbert 2007, "GPU-Based Importance Sampling", GPU Gems 3,
// chapter 20]. The suns are sampled by half vectors, by their flux, and, where a highlight is narrower
// than a pixel, by their flux and the normals that mirror them; the balance heuristic weights the
// three [Veach and Guibas 1995]. The rest's diffuse light is a table.
#version 410 core

#include "lib/ggx.glsl"
#include "lib/latlong.glsl"
#include "lib/sampling.glsl"

uniform usampler2D u_points;       // digits of eight coordinates in two rows; columns are samples
uniform sampler2D u_mean;          // the mean so far
uniform sampler2D u_map;           // radiance of the rest, with mips; suns over rest in level 0
uniform sampler2D u_sun_texels;    // column, row and steradians over probability; a texel for each share
uniform sampler2D u_rest_diffuse;  // irradiance / pi of the rest over normals, latlong
uniform sampler2D u_albedo_table;

uniform mat3 u_world_from_camera;  // columns right, up, view
uniform vec3 u_cell;               // column, row and size in pixels
uniform int u_first;               // samples in the mean so far
uniform int u_samples;             // samples to add
uniform float u_sun_density;       // by which a texel's suns over rest gives their density, 1 / sr

uniform bool u_layered;            // else Lambertian
uniform float u_roughness;
uniform vec3 u_f0;
uniform vec3 u_albedo;

layout(location = 0) out vec4 o_radiance;  // premultiplied by the coverage

// On the very edge V is 0 / 0 and no light is seen.
const float EDGE_COSINE = 1e-4;
// Width of the rest's texels over the root of the solid angle that a sample stands for: a balance of
// blur and noise; 0.5 to 1.5 differ little.
const float FILTER_WIDTH = 0.8;
// Samples that the first ones are taken to be of: fewer would blur the map to one colour.
const int FILTER_SAMPLES_MIN = 16;

struct Pixel {
    vec2 centre;     // camera frame; the ball has radius 1
    float width;
    float coverage;  // share of its area that the ball covers
};

struct Surface {
    mat3 frame;  // camera from surface: columns tangent, bitangent, normal; the view has no bitangent
    vec3 view;   // surface frame
};

struct Suns {
    vec3 radiance;  // of a texel's suns
    float density;  // of a direction in the texel, 1 / sr
};

// Return the axes of a pixel. At the edge it is turned to the ball: what is covered is a rectangle.
mat2 pixel_axes(Pixel pixel) {
    float radius = length(pixel.centre);
    if (radius < 1.0 - 0.75 * pixel.width) return mat2(1.0);
    vec2 outward = radius > 0.0 ? pixel.centre / radius : vec2(1.0, 0.0);
    return mat2(outward, vec2(-outward.y, outward.x));
}

// Return a point evenly distributed over what the ball covers of a pixel.
vec2 covered_point(Pixel pixel, vec2 point) {
    point.x *= pixel.coverage;
    return pixel.centre + pixel_axes(pixel) * ((point - 0.5) * pixel.width);
}

bool is_covered(Pixel pixel, vec2 at) {
    vec2 point = ((at - pixel.centre) * pixel_axes(pixel)) / pixel.width + 0.5;
    return point == clamp(point, vec2(0.0), vec2(pixel.coverage, 1.0));
}

// Return the surface at a point of the ball, or at its edge.
Surface surface_at(vec2 point) {
    float radius = length(point);
    vec2 outward = radius > 0.0 ? point / radius : vec2(1.0, 0.0);
    float sine = min(radius, 1.0);
    float cosine = max(sqrt(1.0 - sine * sine), EDGE_COSINE);
    vec3 normal = vec3(sine * outward, cosine);
    vec3 tangent = vec3(-cosine * outward, sine);
    return Surface(mat3(tangent, cross(normal, tangent), normal), vec3(sine, 0.0, cosine));
}

Suns suns_at(ivec2 texel) {
    vec4 value = texelFetch(u_map, texel, 0);
    return Suns(value.rgb * value.a, value.a * u_sun_density);
}

vec3 rest_at(vec2 uv, float solid_angle) {
    float rows = float(textureSize(u_map, 0).y);
    return textureLod(u_map, uv, log2(max(sqrt(solid_angle) * FILTER_WIDTH * rows / PI, 1.0))).rgb;
}

// Return 4 n.v / G1: D over it is the density of lights by visible half vectors.
float masked_view(float cos_view, float alpha) {
    float alpha2 = alpha * alpha;
    return 2.0 * (cos_view + sqrt(alpha2 + (1.0 - alpha2) * cos_view * cos_view));
}

// Return whether highlights may be narrower than a pixel: half of the suns then draw the normal.
bool is_sharp(Pixel pixel, float alpha) {
    return ggx_distribution(0.0, alpha) * pixel.width * pixel.width > 4.0;  // tried: 1 is worse
}

// Return the density of lights from suns, summed over the ways to draw point and light, 1 / sr.
float sun_density(Suns suns, Pixel pixel, Surface surface, vec3 half_vector, float alpha) {
    if (!is_sharp(pixel, alpha)) return suns.density;
    float distribution = ggx_distribution(dot(half_vector.xy, half_vector.xy), alpha);
    float area = pixel.width * pixel.width * pixel.coverage;
    float by_normal = distribution * half_vector.z * area / surface.view.z;  // dx dy = n.v dn
    return 0.5 * suns.density * (1.0 + by_normal);
}

// Return what a visible half vector shows.
vec3 by_half_vector(Pixel pixel, Surface surface, vec2 point, float others, float alpha) {
    vec3 half_vector = sampling_visible_half(surface.view, alpha, point);
    float cos_half = dot(surface.view, half_vector);
    vec3 light = 2.0 * cos_half * half_vector - surface.view;
    if (light.z <= 0.0) return vec3(0.0);
    float masked = masked_view(surface.view.z, alpha);
    float density = ggx_distribution(dot(half_vector.xy, half_vector.xy), alpha) / masked;
    vec2 uv = latlong_uv(u_world_from_camera * (surface.frame * light));
    float mirrored = 4.0 * pixel.width * pixel.width;  // dw = 4 dx dy on a mirror ball
    vec3 radiance = rest_at(uv, (mirrored + 1.0 / density) / others);
    if (u_sun_density > 0.0) {
        ivec2 size = textureSize(u_map, 0);
        Suns suns = suns_at(min(ivec2(uv * vec2(size)), size - 1));
        float by_sun = sun_density(suns, pixel, surface, half_vector, alpha);
        radiance += suns.radiance * (density / (density + by_sun));
    }
    float weight = ggx_visibility(surface.view.z, light.z, alpha) * light.z * masked;
    return ggx_fresnel(u_f0, cos_half) * weight * radiance;
}

// Return what the layer shows of a sun.
vec3 layer_by_sun(Suns suns, Pixel pixel, Surface surface, vec3 light, float alpha) {
    light = light * surface.frame;
    if (light.z <= 0.0) return vec3(0.0);
    vec3 sum = surface.view + light;
    vec3 half_vector = sum / max(length(sum), 1e-6);  // a light right behind the ball has none
    float distribution = ggx_distribution(dot(half_vector.xy, half_vector.xy), alpha);
    float density = distribution / masked_view(surface.view.z, alpha)
        + sun_density(suns, pixel, surface, half_vector, alpha);
    float weight = distribution * ggx_visibility(surface.view.z, light.z, alpha) * light.z;
    return ggx_fresnel(u_f0, dot(surface.view, half_vector)) * suns.radiance * (weight / density);
}

// Return a point of the ball whose normal is distributed as D around the half vector of a light.
vec2 highlight_point(vec3 light, vec2 point, float alpha) {
    vec3 sum = light + vec3(0.0, 0.0, 1.0);
    Surface middle = surface_at(sum.xy / max(length(sum), 1e-6));
    float alpha2 = alpha * alpha;
    float sin2 = alpha2 * point.x / (1.0 - (1.0 - alpha2) * point.x);
    float turn = 2.0 * PI * point.y;
    vec3 normal = vec3(sqrt(sin2) * vec2(cos(turn), sin(turn)), sqrt(1.0 - sin2));
    vec3 facing = middle.frame * normal;
    return facing.z > 0.0 ? facing.xy : vec2(2.0);  // off the ball
}

// Return what the base sends through the layer, of light that it would send as a white one.
vec3 base_through(Surface surface, vec3 white) {
    if (!u_layered) return u_albedo * white;
    vec2 parts = ggx_albedo_parts(u_albedo_table, surface.view.z, u_roughness);
    return u_albedo * (1.0 - (u_f0 * parts.x + parts.y)) * white;
}

// Return what a sun, drawn by flux, shows: in the layer and on the base.
vec3 by_sun(Pixel pixel, vec2 point, vec4 sun_point, float alpha) {
    ivec2 shares = textureSize(u_sun_texels, 0);
    int share = int(sun_point.x * float(shares.x * shares.y));
    vec3 texel = texelFetch(u_sun_texels, ivec2(share % shares.x, share / shares.x), 0).xyz;
    vec2 size = vec2(textureSize(u_map, 0));
    vec3 light = sampling_texel_direction(texel.xy, size, sun_point.yz) * u_world_from_camera;
    Suns suns = suns_at(ivec2(texel.xy));
    Surface surface = surface_at(covered_point(pixel, point));
    vec3 white = suns.radiance * (texel.z * max(dot(light, surface.frame[2]), 0.0) / PI);
    vec3 shown = base_through(surface, white);
    suns.radiance *= texel.z * suns.density;  // what rounding to whole shares changes
    int by_normal = int(is_sharp(pixel, alpha) && sun_point.w < 0.5);
    for (int k = 0; k < by_normal; ++k) {  // a condition: see main
        vec2 at = highlight_point(light, point, alpha);
        if (!is_covered(pixel, at)) suns.radiance = vec3(0.0);
        surface = surface_at(at);
    }
    return u_layered ? shown + layer_by_sun(suns, pixel, surface, light, alpha) : shown;
}

// Return what the rest shows on the base.
vec3 base_by_rest(Surface surface) {
    vec3 normal = u_world_from_camera * surface.frame[2];
    return base_through(surface, textureLod(u_rest_diffuse, latlong_uv(normal), 0.0).rgb);
}

void main() {
    vec2 at = 2.0 * (gl_FragCoord.xy - u_cell.xy) / u_cell.z - 1.0;
    Pixel pixel = Pixel(vec2(at.x, -at.y), 2.0 / u_cell.z, 0.0);  // rows go down, y goes up
    pixel.coverage = clamp((1.0 - length(at)) / pixel.width + 0.5, 0.0, 1.0);
    o_radiance = vec4(0.0);
    if (pixel.coverage <= 0.0) return;
    float alpha = u_roughness * u_roughness;
    uvec4 seed = uvec4(uvec2(gl_FragCoord.xy - u_cell.xy), 0u, 0u);
    uvec4 scramble = sampling_hash(seed);
    uvec4 sun_scramble = sampling_hash(seed + uvec4(0u, 0u, 1u, 0u));
    // Loops that may be empty, not conditions: drivers without a GPU run both sides of those.
    int end = u_first + u_samples;
    int layer_end = u_layered ? end : u_first;
    int suns_end = u_sun_density > 0.0 ? end : u_first;
    int base_end = u_albedo == vec3(0.0) ? u_first : end;
    vec3 sum = vec3(0.0);
    for (int i = u_first; i < layer_end; ++i) {
        vec4 point = sampling_scrambled(texelFetch(u_points, ivec2(i, 0), 0), scramble);
        Surface surface = surface_at(covered_point(pixel, point.xy));
        float others = float(max(i, FILTER_SAMPLES_MIN));
        sum += by_half_vector(pixel, surface, point.zw, others, alpha);
    }
    for (int i = u_first; i < suns_end; ++i) {
        vec4 point = sampling_scrambled(texelFetch(u_points, ivec2(i, 0), 0), scramble);
        vec4 sun_point = sampling_scrambled(texelFetch(u_points, ivec2(i, 1), 0), sun_scramble);
        sum += by_sun(pixel, point.xy, sun_point, alpha);
    }
    for (int i = u_first; i < base_end; ++i) {
        vec4 point = sampling_scrambled(texelFetch(u_points, ivec2(i, 0), 0), scramble);
        sum += base_by_rest(surface_at(covered_point(pixel, point.xy)));
    }
    vec4 added = vec4(sum / float(u_samples), 1.0) * pixel.coverage;
    vec4 before = texelFetch(u_mean, ivec2(gl_FragCoord.xy), 0);
    o_radiance = mix(before, added, float(u_samples) / float(u_first + u_samples));
}
