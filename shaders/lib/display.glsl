// SPDX-License-Identifier: Apache-2.0
// From linear radiance to what a screen takes: exposure, view transform, sRGB transfer, scales.
//
// The VIEW_TRANSFORM_ and CHANNEL_ numbers come from asglight.viewer.state.display.

// Scale radiance by 2^exposure_ev.
vec3 display_exposed(vec3 radiance, float exposure_ev) {
    return radiance * exp2(exposure_ev);
}

// Return Rec. 709 luminance [ITU-R BT.709].
float display_luminance(vec3 radiance) {
    return dot(radiance, vec3(0.2126, 0.7152, 0.0722));
}

// Return what a channel view shows: one channel as grey, or the colour.
vec3 display_channel(vec3 radiance, int channel) {
    switch (channel) {
    case CHANNEL_RED: return radiance.rrr;
    case CHANNEL_GREEN: return radiance.ggg;
    case CHANNEL_BLUE: return radiance.bbb;
    case CHANNEL_LUMINANCE: return vec3(display_luminance(radiance));
    default: return radiance;
    }
}

// Map exposed radiance to [0, 1] by the curve of Narkowicz 2015, "ACES Filmic Tone Mapping Curve".
// In powers of 1/x above 1, so that an overflow to infinity gives 1.
vec3 display_filmic(vec3 radiance) {
    vec3 x = max(radiance, 0.0);
    vec3 l = min(x, 1.0);
    vec3 low = (l * (2.51 * l + 0.03)) / (l * (2.43 * l + 0.59) + 0.14);
    vec3 i = 1.0 / max(x, 1.0);
    vec3 high = (2.51 + 0.03 * i) / (2.43 + i * (0.59 + 0.14 * i));
    return clamp(mix(high, low, lessThan(x, vec3(1.0))), 0.0, 1.0);
}

// Encode linear [0, 1] with the sRGB transfer function [IEC 61966-2-1].
vec3 display_srgb(vec3 linear) {
    vec3 power = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    return mix(power, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

// Return the place of a radiance on the false-colour scale, in [0, 1]: middle grey at 1/2.
float display_stops_place(float luminance) {
    // 1e-30 stands for black: its place is below the scale all the same.
    return clamp(0.5 + log2(max(luminance, 1e-30) / MIDDLE_GREY) / (2.0 * FALSE_COLOUR_EV), 0.0, 1.0);
}

// Return the place of a fit against its reference on the scale of ratios: equal at 1/2. Two values
// that are both black are equal.
float display_ratio_place(float fit, float reference) {
    float stops = log2(max(fit, 1e-30) / max(reference, 1e-30));
    return clamp(0.5 + stops / (2.0 * RATIO_EV), 0.0, 1.0);
}

// Return the place of a fit minus its reference, both exposed, on the scale of differences, which
// reaches from -1 to 1: equal at 1/2.
float display_difference_place(float fit, float reference) {
    return clamp(0.5 + 0.5 * (fit - reference), 0.0, 1.0);
}
