// SPDX-License-Identifier: Apache-2.0
// Linear radiance of one picture, or of two that are compared -> sRGB. The only pass that knows
// exposure, view transform and sRGB.
//
// Special programs: COMPARES where two pictures are sampled, BACKGROUND where something is behind
// them, EXACT where a texel is a pixel, TRANSFORM the one VIEW_TRANSFORM_ number that it has
// (drivers without a GPU run both sides of an `if`, texture fetches included). Of OpenColorIO's views
// the function ocio_display stands before this text.
#version 410 core

#include "lib/display.glsl"

#ifndef TRANSFORM
#define TRANSFORM VIEW_TRANSFORM_SRGB
#endif

// A picture is two layers: what is in front, its radiance multiplied by its coverage in alpha, and
// the background behind it.
uniform sampler2D u_fit;
uniform sampler2D u_fit_background;
#ifdef COMPARES
uniform sampler2D u_reference;
uniform sampler2D u_reference_background;
uniform int u_comparison;  // a COMPARISON_ number
uniform float u_wipe;  // share of the columns that show the fit
#endif

uniform vec4 u_area;  // x, y, columns and rows of the target that the picture fills
uniform float u_exposure_ev;
uniform int u_channel;  // a CHANNEL_ number
uniform bool u_zebra;
uniform sampler2D u_scale;  // colours of false colour or of differences, one row
uniform vec3 u_surround;  // sRGB where there is neither ball nor background

layout(location = 0) out vec4 o_color;

vec4 sampled(sampler2D image, vec2 uv) {
#ifdef EXACT
    return texelFetch(image, ivec2(gl_FragCoord.xy - u_area.xy), 0);
#else
    return texture(image, uv);
#endif
}

// Return radiance (not multiplied) and coverage.
vec4 picture(sampler2D front, sampler2D background, vec2 uv) {
    vec4 texel = sampled(front, uv);
#ifdef BACKGROUND
    texel += vec4(sampled(background, uv).rgb, 1.0) * (1.0 - texel.a);
#endif
    return vec4(texel.rgb / max(texel.a, 1e-6), texel.a);  // 1e-6: no coverage, any colour
}

vec3 scale_colour(float place) {
    float samples = float(textureSize(u_scale, 0).x);
    return texture(u_scale, vec2((place * (samples - 1.0) + 0.5) / samples, 0.5)).rgb;
}

// Return the sRGB colour of exposed radiance.
vec3 shown(vec3 radiance) {
#if TRANSFORM == VIEW_TRANSFORM_FALSE_COLOUR
    return scale_colour(display_stops_place(display_luminance(radiance)));
#else
    vec3 channel = display_channel(radiance, u_channel);
#if TRANSFORM == VIEW_TRANSFORM_OPENCOLORIO
    channel = ocio_display(vec4(channel, 1.0)).rgb;
    bool clips = max(max(channel.r, channel.g), channel.b) >= 1.0;
#else
    bool clips = max(max(channel.r, channel.g), channel.b) > 1.0;
#endif
    if (u_zebra && clips) {
        return vec3(mod(gl_FragCoord.x + gl_FragCoord.y, 8.0) < 4.0 ? 1.0 : 0.0);
    }
#if TRANSFORM == VIEW_TRANSFORM_OPENCOLORIO
    return clamp(channel, 0.0, 1.0);
#elif TRANSFORM == VIEW_TRANSFORM_FILMIC
    return display_srgb(display_filmic(channel));
#else
    return display_srgb(clamp(channel, 0.0, 1.0));
#endif
#endif
}

#ifdef COMPARES
// Return the value that differences are taken of: a channel, or the luminance.
float compared(vec3 radiance) {
    return u_channel == CHANNEL_RGB
        ? display_luminance(radiance) : display_channel(radiance, u_channel).r;
}

// Return the colour of two pictures compared, and its coverage.
vec4 compared_colour(vec4 fit, vec4 reference, vec2 uv) {
    vec3 fit_exposed = display_exposed(fit.rgb, u_exposure_ev);
    vec3 reference_exposed = display_exposed(reference.rgb, u_exposure_ev);
    if (u_comparison == COMPARISON_WIPE) {
        return uv.x < u_wipe ? vec4(shown(fit_exposed), fit.a)
                             : vec4(shown(reference_exposed), reference.a);
    }
    float of_fit = compared(fit_exposed);
    float of_reference = compared(reference_exposed);
    float place = u_comparison == COMPARISON_RATIO
        ? display_ratio_place(of_fit, of_reference)
        : display_difference_place(of_fit, of_reference);
    return vec4(scale_colour(place), max(fit.a, reference.a));
}
#endif

void main() {
    vec2 uv = (gl_FragCoord.xy - u_area.xy) / u_area.zw;
    vec4 fit = picture(u_fit, u_fit_background, uv);
#ifdef COMPARES
    vec4 reference = picture(u_reference, u_reference_background, uv);
    vec4 color = compared_colour(fit, reference, uv);
#else
    vec4 color = vec4(shown(display_exposed(fit.rgb, u_exposure_ev)), fit.a);
#endif
    o_color = vec4(mix(u_surround, color.rgb, color.a), 1.0);
}
