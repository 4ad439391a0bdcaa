// SPDX-License-Identifier: Apache-2.0
// A GGX layer under lobes, in closed form; the twin of asglight/shading/ggx_lobes.py, where the
// formulas are explained. Camera frame: the view is +Z everywhere.
//
// From Python come BROAD_TERMS (K), the WINDOW_ numbers and the ..._MIN limits. With ISOTROPIC
// defined, all sheets must have the same two disc variances.

#include "lib/ggx.glsl"
#include "lib/rectified.glsl"

struct GgxLobesSurface {
    vec3 normal;
    vec3 tangent;    // towards the view
    vec3 bitangent;  // across the plane of view and normal
    float cos_view;
    float sin_view;
};

// What all sheets see of the layer at one point.
struct GgxLobesKernel {
    vec3 axis;
    vec3 across;
    vec3 along;
    float weight[BROAD_TERMS];
    float shift[BROAD_TERMS];
    float variance_across[BROAD_TERMS];
    float variance_along[BROAD_TERMS];
    // Of the window, as they do not depend on the sheet:
    float shrink[BROAD_TERMS];
    vec3 window_variance[BROAD_TERMS];  // for zx^2, zy^2 and c^2
};

// What the layer needs to know of a sheet, 64 bytes in std140.
struct GgxSheet {
    vec4 axis_x;       // byte 0:  xyz unit axis, w disc variance along it
    vec4 half_vector;  // byte 16: xyz Tilt.half, w disc variance along axis_y
    vec4 slope_x;      // byte 32: xyz Tilt.slope_x, w weight of ggx_lobes_narrow
    vec4 slope_y;      // byte 48: xyz Tilt.slope_y, w weight of ggx_lobes_broad
};

GgxLobesSurface ggx_lobes_surface(vec3 normal) {
    float sin_view = length(normal.xy);
    // Seen along the normal every tangent is as good.
    vec2 outwards = sin_view > SIN_VIEW_MIN ? normal.xy / sin_view : vec2(-1.0, 0.0);
    vec3 tangent = vec3(-normal.z * outwards, sin_view);
    vec3 bitangent = vec3(outwards.y, -outwards.x, 0.0);
    return GgxLobesSurface(normal, tangent, bitangent, max(normal.z, COS_VIEW_MIN), sin_view);
}

// The rows of `fitted` are cubic polynomials of n.v: see Layer.kernel.
GgxLobesKernel ggx_lobes_kernel(GgxLobesSurface seen, float alpha, vec4 fitted[4 * BROAD_TERMS]) {
    const int K = BROAD_TERMS;
    GgxLobesKernel kernel;
    float n_v = seen.cos_view;
    float alpha2 = alpha * alpha;
    vec4 powers = vec4(1.0, n_v, n_v * n_v, n_v * n_v * n_v);
    float spread = exp(dot(fitted[0], powers)) * alpha2 * seen.sin_view;
    vec2 mirror = vec2(spread, n_v + sqrt(spread * seen.sin_view + n_v * n_v));
    float twice = 2.0 * dot(vec2(seen.sin_view, n_v), mirror) / dot(mirror, mirror);
    vec2 axis = twice * mirror - vec2(seen.sin_view, n_v);
    kernel.axis = axis.x * seen.tangent + axis.y * seen.normal;
    kernel.across = seen.bitangent;
    kernel.along = axis.y * seen.tangent - axis.x * seen.normal;
    float flattened = n_v * n_v + 0.5 * alpha2 * seen.sin_view * seen.sin_view;
    float total = 0.0;
    for (int k = 0; k < K; ++k) {
        float weight = k < K - 1 ? exp(dot(fitted[1 + k], powers)) : 1.0;
        float along = 2.0 * alpha2 * exp(dot(fitted[K + k], powers));
        float across = along * flattened * exp((1.0 - n_v) * dot(fitted[2 * K + k], powers));
        kernel.weight[k] = weight;
        total += weight;
        kernel.shift[k] = alpha * seen.sin_view * dot(fitted[3 * K + k], powers);
        kernel.variance_across[k] = across;
        kernel.variance_along[k] = along;
        float shrink = exp(-0.5 * (across + along));
        kernel.shrink[k] = shrink;
        kernel.window_variance[k] = vec3(across / (1.0 + 3.0 * across), along / (1.0 + 3.0 * along),
                                         (1.0 - shrink) * (1.0 - shrink) / 3.0);
    }
    for (int k = 0; k < K; ++k) {
        kernel.weight[k] /= total;
    }
    return kernel;
}

// Return the mean of a round Gaussian over a disc, as numerator and denominator; `variance` is
// multiplied by the DISC_SCALES of the window.
vec2 ggx_lobes_disc_mean(float variance) {
    float v = variance;
    return vec2(v * (v * (v + 0.5 * DISC_A) + 0.25 * DISC_B),
                v * (v * (v + 0.5 * (DISC_A + 0.5)) + 0.25 * DISC_C) + 0.125 * DISC_B);
}

// Blur the window of a sheet; c, zx and zy are axis_z in the kernel's frame.
float ggx_lobes_window(GgxLobesKernel kernel, int k, int window, float c, float zx, float zy) {
    vec3 squares = vec3(zx * zx, zy * zy, c * c);
    float deviation = sqrt(dot(squares, kernel.window_variance[k]));
    vec2 cut = rectified(kernel.shrink[k] * (c + kernel.shift[k] * zy), deviation);
    return window == WINDOW_COSINE ? cut.x : cut.y;
}

// Blur one sheet; leaves out the factor sqrt(disc_mean disc_mean) of its own disc variances.
float ggx_lobes_broad(GgxSheet sheet, vec3 axis_z, GgxLobesKernel kernel, int window,
                      float disc) {
    float c = dot(kernel.axis, axis_z);
    float zx = dot(kernel.across, axis_z);
    float zy = dot(kernel.along, axis_z);
    vec3 sum = kernel.axis + axis_z;  // its length squared is 2 (1 + c)
    float inverse = 2.0 / max(dot(sum, sum), OPPOSITE_MIN);
    vec2 z_disc = vec2(zx, zy);
    if (window == WINDOW_NONE) {  // opposite directions lie on the rim of the disc of radius 2
        z_disc *= sqrt(2.0 * inverse);
        z_disc.x = dot(sum, sum) > OPPOSITE_MIN ? z_disc.x : 2.0;
    }
    float vx = sheet.axis_x.w;
    float vy = sheet.half_vector.w;
#ifdef ISOTROPIC
    float v11 = vx, v22 = vx, v12 = 0.0;
#else
    float xc = dot(sheet.axis_x.xyz, kernel.axis) * inverse;
    float x1 = dot(sheet.axis_x.xyz, kernel.across) - zx * xc;  // axis_x, transported
    float x2 = dot(sheet.axis_x.xyz, kernel.along) - zy * xc;
    // Divided by the length of the transported axis, which rounding may have changed.
    float turn = 1.0 / max(x1 * x1 + x2 * x2, OPPOSITE_MIN);
    float v11 = (vx * x1 * x1 + vy * x2 * x2) * turn;
    float v22 = (vx * x2 * x2 + vy * x1 * x1) * turn;
    float v12 = (vx - vy) * x1 * x2 * turn;
#endif
    float total = 0.0;
    for (int k = 0; k < BROAD_TERMS; ++k) {
        float across = kernel.variance_across[k];
        float along = kernel.variance_along[k];
        float s11 = v11 + across;
        float s22 = v22 + along;
        float d1 = z_disc.x;
        float d2 = z_disc.y - kernel.shift[k];
#ifdef ISOTROPIC
        float large = s11;
        float small = s22;
        float exponent = 0.5 * (d1 * d1 / s11 + d2 * d2 / s22);
#else
        float determinant = vx * vy + v11 * along + v22 * across + across * along;
        float difference = 0.5 * (s11 - s22);
        float large = 0.5 * (s11 + s22) + sqrt(difference * difference + v12 * v12);
        float small = determinant / large;
        float exponent = 0.5 * (s22 * d1 * d1 - 2.0 * v12 * d1 * d2 + s11 * d2 * d2) / determinant;
#endif
        vec2 after = ggx_lobes_disc_mean(disc * large) * ggx_lobes_disc_mean(disc * small);
        float blurred = kernel.weight[k] * sqrt(after.y / after.x) * exp(-exponent);
        if (window != WINDOW_NONE) {
            blurred *= ggx_lobes_window(kernel, k, window, c, zx, zy);
        }
        total += blurred;
    }
    return total;
}

// Return the mean of V n.l over the part of a light above the horizon, at two nodes.
float ggx_lobes_visible(vec2 cosine, float cos_view, float alpha) {
    vec2 cut = rectified(cosine.x, rectified_widened(cosine.y));
    float lit = max(cut.y, PROBABILITY_MIN);
    float n_l = clamp(cut.x / lit, COS_LIGHT_MIN, 1.0);
    float variance = cosine.y * cosine.y - n_l * (n_l - cosine.x);
    float apart = min(sqrt(max(variance, 0.0)), min(n_l, 1.0 - n_l));
    float low = n_l - apart;
    float high = n_l + apart;
    return lit * 0.5 * (ggx_visibility(cos_view, low, alpha) * low
                        + ggx_visibility(cos_view, high, alpha) * high);
}

// Return what the layer shows of one sheet, per unit of its integral, at Fresnel reflectance 1.
// `cosine` holds mean and deviation of n.w over the sheet.
float ggx_lobes_narrow(GgxSheet sheet, GgxLobesSurface seen, float alpha, vec2 cosine) {
    float alpha2 = alpha * alpha;
    float p0 = alpha2 / max(1.0 - alpha2, UNSHARP_MIN);
    float x1 = dot(seen.tangent, sheet.slope_x.xyz);
    float x2 = dot(seen.bitangent, sheet.slope_x.xyz);
    float y1 = dot(seen.tangent, sheet.slope_y.xyz);
    float y2 = dot(seen.bitangent, sheet.slope_y.xyz);
    float p11 = x1 * x1 + y1 * y1;
    float p22 = x2 * x2 + y2 * y2;
    float p12 = x1 * x2 + y1 * y2;
    float turn = x1 * y2 - x2 * y1;
    float determinant = p0 * p0 + p0 * (p11 + p22) + turn * turn;
    float below = 1.0 / (1.0 + 2.0 * p0 + p11 + p22 + determinant);
    float a11 = p0 + p11 + determinant;
    float a22 = p0 + p22 + determinant;
    float h1 = dot(seen.tangent, sheet.half_vector.xyz);
    float h2 = dot(seen.bitangent, sheet.half_vector.xyz);
    float h3 = dot(seen.normal, sheet.half_vector.xyz);
    float shape = (a22 * h1 * h1 - 2.0 * p12 * h1 * h2 + a11 * h2 * h2) / determinant + h3 * h3;
    float distribution = 1.0 / (PI * sqrt(determinant * below) * shape * shape);
    return distribution * ggx_lobes_visible(cosine, seen.cos_view, alpha);
}
