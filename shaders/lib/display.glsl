// SPDX-License-Identifier: Apache-2.0
// From linear radiance to what a screen takes: exposure, tone curve, sRGB transfer.
//
// The TONE_CURVE_ numbers come from asglight.viewer.state.ToneCurve.

// Scale radiance by 2^exposure_ev.
vec3 display_exposed(vec3 radiance, float exposure_ev) {
    return radiance * exp2(exposure_ev);
}

// Map exposed radiance to [0, 1], still linear.
vec3 display_tone_mapped(vec3 radiance, int tone_curve) {
    vec3 positive = max(radiance, 0.0);
    if (tone_curve == TONE_CURVE_REINHARD) {
        // L / (1 + L) per channel [Reinhard et al. 2002]. In this form an overflow to infinity
        // gives 1; the digits lost at small L are far below a step of an 8-bit image.
        return 1.0 - 1.0 / (1.0 + positive);
    }
    return min(positive, 1.0);
}

// Encode linear [0, 1] with the sRGB transfer function [IEC 61966-2-1].
vec3 display_srgb(vec3 linear) {
    vec3 power = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    return mix(power, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}
