// SPDX-License-Identifier: Apache-2.0
// The functions of an exported environment. asglight/export/environment.py puts the library before
// them and the lobes before that: ASG_SHEETS vectors each of asg_axis_x, asg_axis_y, asg_axis_z,
// asg_variance and asg_light. It keeps of each #ifdef the side that the scene needs.

// What a roughness decides; alpha is its square.
struct AsgLayer {
    float roughness;
    float alpha;
    vec4 kernel[4 * BROAD_TERMS];
    vec4 share;  // centre for the scene's window, log slope, weights of the ratio and of v.h
    vec4 gain;   // log gain and its slope, log of what ggx_lobes_kept loses
};

// Return the value of lobe i for amplitude 1.
float asg_unit(int i, vec3 direction) {
#ifdef SG
    // s (z - 1) = -s/2 |d - axis_z|^2 keeps its digits where z is near 1.
    vec3 chord = direction - asg_axis_z[i].xyz;
    return exp(-0.5 * asg_axis_x[i].w * dot(chord, chord));
#else
    float x = dot(asg_axis_x[i].xyz, direction);
    float y = dot(asg_axis_y[i].xyz, direction);
    float gaussian = exp(-asg_axis_x[i].w * x * x - asg_axis_y[i].w * y * y);
#ifdef BINGHAM
    return gaussian;
#else
    return gaussian * max(dot(asg_axis_z[i].xyz, direction), 0.0);
#endif
#endif
}

// Return mean and standard deviation of the cosine between a direction and a sheet's light.
vec2 asg_cosine(int i, vec3 direction) {
    vec3 local = vec3(dot(direction, asg_axis_x[i].xyz), dot(direction, asg_axis_y[i].xyz),
                      dot(direction, asg_axis_z[i].xyz));
    return vec2(local.z * asg_axis_z[i].w, sqrt(dot(local * local, asg_variance[i].xyz)));
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

// Sum the Chebyshev polynomials of log(roughness).
AsgLayer asg_layer(float roughness) {
    float r = clamp(roughness, ROUGHNESS_MIN, ROUGHNESS_MAX);
    AsgLayer layer;
    layer.roughness = r;
    layer.alpha = r * r;
    layer.share = ASG_SHARE[0];
    layer.gain = ASG_GAIN[0];
    for (int k = 0; k < 4 * BROAD_TERMS; ++k) {
        layer.kernel[k] = ASG_KERNEL[k];
    }
    float u = 2.0 * log(r / ROUGHNESS_MIN) / log(ROUGHNESS_MAX / ROUGHNESS_MIN) - 1.0;
    float before = 1.0;
    float basis = u;
    for (int d = 1; d < ASG_DEGREES; ++d) {
        layer.share += basis * ASG_SHARE[d];
        layer.gain += basis * ASG_GAIN[d];
        for (int k = 0; k < 4 * BROAD_TERMS; ++k) {
            layer.kernel[k] += basis * ASG_KERNEL[d * 4 * BROAD_TERMS + k];
        }
        float next = 2.0 * u * basis - before;
        before = basis;
        basis = next;
    }
    return layer;
}

// Return what the layer shows; `albedo` is its directional albedo.
vec3 asg_layer_radiance(vec3 normal, vec3 view, AsgLayer layer, vec3 f0, vec3 albedo) {
    GgxLobesSurface seen = ggx_lobes_surface_seen_from(view, normal);
    GgxLobesKernel kernel = ggx_lobes_kernel(seen, layer.alpha, layer.kernel);
    vec3 mirrored = vec3(0.0);
    vec3 blurred = vec3(0.0);
    for (int i = 0; i < ASG_SHEETS; ++i) {
        vec3 axis_z = asg_axis_z[i].xyz;
        vec2 disc_variance = ASG_DISC_VARIANCE / vec2(asg_axis_x[i].w, asg_axis_y[i].w);
        vec2 seen_cosine = asg_cosine(i, view);
        float cos_half2 = ggx_lobes_cos_half2(seen_cosine.x);
        float narrowness =
            ggx_lobes_narrowness(disc_variance, cos_half2, layer.alpha, layer.share);
        float part = ggx_lobes_share(narrowness, layer.share.y);
        GgxSheet sheet = GgxSheet(vec4(asg_axis_x[i].xyz, disc_variance.x),
                                  vec4(0.0, 0.0, 0.0, disc_variance.y), vec4(0.0), vec4(0.0));
        if (part > 0.0) {
            vec2 deviation = sqrt(asg_variance[i].xy);
            float log_gain =
                layer.gain.x + layer.gain.y * clamp(narrowness, -GAIN_REACH, GAIN_REACH);
            GgxLobesTilt tilt = ggx_lobes_tilt(asg_axis_x[i].xyz * deviation.x,
                                               asg_axis_y[i].xyz * deviation.y, axis_z, view,
                                               log_gain);
            sheet.half_vector.xyz = tilt.half_vector;
            sheet.slope_x.xyz = tilt.slope_x;
            sheet.slope_y.xyz = tilt.slope_y;
            float value = ggx_lobes_narrow(sheet, seen, layer.alpha, asg_cosine(i, normal));
            float grazing = ggx_lobes_grazing(seen_cosine, layer.alpha);
            mirrored += asg_light[i].rgb * (PI * asg_light[i].w * part * value)
                * (f0 + (1.0 - f0) * grazing);
        }
        if (part < 1.0) {
            float value = ggx_lobes_broad(sheet, axis_z, kernel, ASG_WINDOW, ASG_DISC)
                * ggx_lobes_kept(cos_half2, layer.alpha, layer.gain.z);
            blurred += asg_light[i].rgb * (asg_variance[i].w * (1.0 - part) * value);
        }
    }
    return mirrored + albedo * blurred;
}

// Return the albedo by the polynomials of asglight/export/albedo.py; roughness is within its range.
vec3 asg_layer_albedo(float cos_view, float roughness, vec3 f0) {
    float n_v = clamp(cos_view, ASG_ALBEDO_COS_VIEW_MIN, 1.0);
    float alpha = roughness * roughness;
    float white = asg_polynomial(ASG_ALBEDO_WHITE, n_v * (1.0 + alpha) / (n_v + alpha), alpha);
    float grazing = asg_polynomial(ASG_ALBEDO_GRAZING, sqrt(n_v), roughness);
    return clamp(white * (f0 * (1.0 - grazing) + grazing), 0.0, 1.0);
}

// Return the linear radiance from a unit direction.
vec3 asglight_evaluate(vec3 direction) {
    vec3 radiance = vec3(0.0);
    for (int i = 0; i < ASG_LOBES; ++i) {
        radiance += asg_light[i].rgb * asg_unit(i, direction);
    }
    return max(radiance, vec3(0.0));  // terms of flat lobes have both signs
}

// Return the irradiance of a surface with a unit normal. Matte, it shows albedo / pi times that.
vec3 asglight_irradiance(vec3 normal) {
    vec3 over_pi = vec3(0.0);
    for (int i = 0; i < ASG_SHEETS; ++i) {
        vec2 c = asg_cosine(i, normal);
        over_pi += asg_light[i].rgb * (asg_light[i].w * rectified_irradiance_over_pi(c.x, c.y));
    }
    return PI * max(over_pi, vec3(0.0));
}

// Return what a GGX layer reflects of light that is the same from everywhere: its directional
// albedo. cos_view is n.v.
vec3 asglight_albedo(float cos_view, float roughness, vec3 f0) {
    return asg_layer_albedo(cos_view, clamp(roughness, ROUGHNESS_MIN, ROUGHNESS_MAX), f0);
}

// Return what a GGX layer with nothing under it shows: the linear radiance towards the camera.
vec3 asglight_reflection(vec3 normal, vec3 view, float roughness, vec3 f0) {
    AsgLayer layer = asg_layer(roughness);
    vec3 albedo = asg_layer_albedo(dot(normal, view), layer.roughness, f0);
    return max(asg_layer_radiance(normal, view, layer, f0, albedo), vec3(0.0));
}

// Return what a surface shows, a GGX layer over a matte base: the linear radiance towards the
// camera. normal and view are unit, view towards the camera; roughness is perceptual, from 0.05
// to 1; f0 is the reflectance along the normal; base is the diffuse reflectance, black for metals.
vec3 asglight_shade(vec3 normal, vec3 view, float roughness, vec3 f0, vec3 base) {
    AsgLayer layer = asg_layer(roughness);
    vec3 albedo = asg_layer_albedo(dot(normal, view), layer.roughness, f0);
    vec3 radiance = max(asg_layer_radiance(normal, view, layer, f0, albedo), vec3(0.0));
    if (any(greaterThan(base, vec3(0.0)))) {
        radiance += (1.0 - albedo) * base * (asglight_irradiance(normal) / PI);
    }
    return radiance;
}
