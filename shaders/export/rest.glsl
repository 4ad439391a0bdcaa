// SPDX-License-Identifier: Apache-2.0
// What an exported environment of keys has beside environment.glsl: its rest. The nine coefficients
// asg_rest are those of asglight/export/keyed.py.

// Return the irradiance of the rest on a surface with a unit normal.
vec3 asglight_rest_irradiance(vec3 normal) {
    float x = normal.x;
    float y = normal.y;
    float z = normal.z;
    vec3 even = asg_rest[0].rgb + asg_rest[4].rgb * (x * y) + asg_rest[5].rgb * (y * z)
        + asg_rest[6].rgb * (3.0 * z * z - 1.0) + asg_rest[7].rgb * (x * z)
        + asg_rest[8].rgb * (x * x - y * y);
    return max(even + asg_rest[1].rgb * y + asg_rest[2].rgb * z + asg_rest[3].rgb * x, vec3(0.0));
}

// Return the irradiance of keys and rest.
vec3 asglight_keyed_irradiance(vec3 normal) {
    return asglight_irradiance(normal) + asglight_rest_irradiance(normal);
}

// Return what a surface shows under keys and rest, a GGX layer over a matte base. rest is the rest
// in the mirrored direction, prefiltered for the roughness as engines do; all else is as of
// asglight_shade of an environment without keys.
vec3 asglight_keyed_shade(vec3 normal, vec3 view, float roughness, vec3 f0, vec3 base, vec3 rest) {
    AsgLayer layer = asg_layer(roughness);
    vec3 albedo = asg_layer_albedo(dot(normal, view), layer.roughness, f0);
    vec3 radiance = max(asg_layer_radiance(normal, view, layer, f0, albedo), vec3(0.0));
    return radiance + albedo * rest
        + (1.0 - albedo) * base * (asglight_keyed_irradiance(normal) / PI);
}
