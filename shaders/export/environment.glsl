// SPDX-License-Identifier: Apache-2.0
// The functions of an exported environment. asglight/export/environment.py puts the library before
// them, and the lobes of one frame as constants ASG_...

// Return the linear radiance from a unit direction.
vec3 asg_environment(vec3 direction) {
    vec3 radiance = vec3(0.0);
    for (int i = 0; i < ASG_LOBES; ++i) {
        Lobe lobe = Lobe(ASG_AXIS_X[i], ASG_AXIS_Y[i], ASG_AXIS_Z[i], ASG_AMPLITUDE[i]);
        radiance += asg_evaluate(lobe, ASG_FORM, direction);
    }
    return radiance;
}

// Return mean and standard deviation of the cosine between a normal and a sheet's light.
vec2 asg_cosine(int i, vec3 normal) {
    vec3 local = vec3(dot(normal, ASG_AXIS_X[i].xyz), dot(normal, ASG_AXIS_Y[i].xyz),
                      dot(normal, ASG_AXIS_Z[i].xyz));
    return vec2(local.z * ASG_AXIS_Z[i].w, sqrt(dot(local * local, ASG_VARIANCE[i].xyz)));
}

// Return irradiance over pi: the linear radiance of a white matte surface with a unit normal.
vec3 asg_irradiance_over_pi(vec3 normal) {
    vec3 sum = vec3(0.0);
    for (int i = 0; i < ASG_SHEETS; ++i) {
        vec2 c = asg_cosine(i, normal);
        sum += ASG_AMPLITUDE[i].rgb * (ASG_AMPLITUDE[i].w * rectified_irradiance_over_pi(c.x, c.y));
    }
    return sum;
}

// Return a polynomial of two variables in [0, 1].
float asg_polynomial(float coefficients[ASG_ALBEDO_TERMS * ASG_ALBEDO_TERMS], float x, float y) {
    float sum = 0.0;
    for (int i = ASG_ALBEDO_TERMS - 1; i >= 0; --i) {
        float row = 0.0;
        for (int j = ASG_ALBEDO_TERMS - 1; j >= 0; --j) {
            row = row * (2.0 * y - 1.0) + coefficients[i * ASG_ALBEDO_TERMS + j];
        }
        sum = sum * (2.0 * x - 1.0) + row;
    }
    return sum;
}

// Return the layer's directional albedo, what it reflects in a white furnace: the polynomials of
// asglight/export/albedo.py.
vec3 asg_albedo(float cos_view, float roughness, vec3 f0) {
    float n_v = clamp(cos_view, ASG_ALBEDO_COS_VIEW_MIN, 1.0);
    float r = clamp(roughness, ROUGHNESS_MIN, ROUGHNESS_MAX);
    float alpha = r * r;
    float white = asg_polynomial(ASG_ALBEDO_WHITE, n_v * (1.0 + alpha) / (n_v + alpha), alpha);
    float grazing = white * asg_polynomial(ASG_ALBEDO_GRAZING, sqrt(n_v), sqrt(r));
    return clamp(f0 * (white - grazing) + grazing, 0.0, 1.0);
}

// Return the linear radiance that a GGX layer over a surface shows a camera: unit normal, unit view
// towards the camera, perceptual roughness from 0.05 to 1, reflectance f0 along the normal.
vec3 asg_shade(vec3 normal, vec3 view, float roughness, vec3 f0) {
    float r = clamp(roughness, ROUGHNESS_MIN, ROUGHNESS_MAX);
    float alpha = r * r;
    // Chebyshev polynomials of log(roughness): what a roughness decides.
    float u = 2.0 * log(r / ROUGHNESS_MIN) / log(ROUGHNESS_MAX / ROUGHNESS_MIN) - 1.0;
    float basis[ASG_DEGREES];
    vec4 fitted[4 * BROAD_TERMS];
    vec4 fitted_share = ASG_SHARE[0];
    basis[0] = 1.0;
    for (int k = 0; k < 4 * BROAD_TERMS; ++k) {
        fitted[k] = ASG_KERNEL[k];
    }
    for (int d = 1; d < ASG_DEGREES; ++d) {
        basis[d] = d == 1 ? u : 2.0 * u * basis[d - 1] - basis[d - 2];
        fitted_share += basis[d] * ASG_SHARE[d];
        for (int k = 0; k < 4 * BROAD_TERMS; ++k) {
            fitted[k] += basis[d] * ASG_KERNEL[d * 4 * BROAD_TERMS + k];
        }
    }
    GgxLobesSurface seen = ggx_lobes_surface_seen_from(view, normal);
    GgxLobesKernel kernel = ggx_lobes_kernel(seen, alpha, fitted);
    vec3 mirrored = vec3(0.0);
    vec3 blurred = vec3(0.0);
    for (int i = 0; i < ASG_SHEETS; ++i) {
        vec3 axis_z = ASG_AXIS_Z[i].xyz;
        vec2 disc_variance = ASG_DISC_VARIANCE / vec2(ASG_AXIS_X[i].w, ASG_AXIS_Y[i].w);
        float part = ggx_lobes_share(disc_variance, alpha, fitted_share, ASG_SHARE_MOVE);
        vec2 deviation = sqrt(ASG_VARIANCE[i].xy);
        GgxLobesTilt tilt = ggx_lobes_tilt(ASG_AXIS_X[i].xyz * deviation.x,
                                           ASG_AXIS_Y[i].xyz * deviation.y, axis_z, view,
                                           fitted_share.w);
        GgxSheet sheet = GgxSheet(vec4(ASG_AXIS_X[i].xyz, disc_variance.x),
                                  vec4(tilt.half_vector, disc_variance.y), vec4(tilt.slope_x, 0.0),
                                  vec4(tilt.slope_y, 0.0));
        if (part > 0.0) {
            float value = ggx_lobes_narrow(sheet, seen, alpha, asg_cosine(i, normal));
            vec3 fresnel = ggx_fresnel(f0, tilt.cos_half);
            mirrored += ASG_AMPLITUDE[i].rgb * (PI * ASG_AMPLITUDE[i].w * part * value) * fresnel;
        }
        if (part < 1.0) {
            float value = ggx_lobes_broad(sheet, axis_z, kernel, ASG_WINDOW, ASG_DISC);
            blurred += ASG_AMPLITUDE[i].rgb * (ASG_VARIANCE[i].w * (1.0 - part) * value);
        }
    }
    return mirrored + asg_albedo(seen.cos_view, r, f0) * blurred;
}
