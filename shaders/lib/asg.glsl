// SPDX-License-Identifier: Apache-2.0
// The lobe function of each form; the twin of asglight/lobes/asg.py.
//
// For a direction d write x = d.axis_x, y = d.axis_y, z = d.axis_z. With sharpness (sx, sy):
//
//   FORM_ASG      max(z, 0) exp(-sx x^2 - sy y^2)    [Xu et al. 2013]
//   FORM_BINGHAM  exp(-sx x^2 - sy y^2)              [Clausen et al. 2024, taken literally]
//   FORM_SG       exp(s (z - 1))
//   FORM_FLAT     max(z, 0) (1 - (1 - exp(-sx x^2 - sy y^2))^3)    [docs/method/asg.md, 8]
//
// The FORM_ numbers come from asglight.lobes.Form.

// One lobe, 64 bytes in std140. All members are vec4, because drivers disagree about the padding
// of vec3. asglight/viewer/gl/passes.py packs it.
struct Lobe {
    vec4 axis_x;     // byte 0:  xyz unit axis, w sharpness along it (for FORM_SG: s)
    vec4 axis_y;     // byte 16: xyz unit axis, w sharpness along it
    vec4 axis_z;     // byte 32: xyz direction of the light, w unused
    vec4 amplitude;  // byte 48: rgb linear radiance at axis_z, w unused
};

// Return the lobe's value for amplitude 1, in [0, 1].
float asg_unit_lobe(Lobe lobe, int form, vec3 direction) {
    if (form == FORM_SG) {
        // s (z - 1) = -s/2 |d - axis_z|^2 keeps its digits where z is near 1.
        vec3 chord = direction - lobe.axis_z.xyz;
        return exp(-0.5 * lobe.axis_x.w * dot(chord, chord));
    }
    float x = dot(lobe.axis_x.xyz, direction);
    float y = dot(lobe.axis_y.xyz, direction);
    float gaussian = exp(-lobe.axis_x.w * x * x - lobe.axis_y.w * y * y);
    if (form == FORM_FLAT) {
        gaussian *= 3.0 - gaussian * (3.0 - gaussian);
    }
    return form == FORM_BINGHAM ? gaussian : gaussian * max(dot(lobe.axis_z.xyz, direction), 0.0);
}

// Return the linear radiance that one lobe sends from a unit direction.
vec3 asg_evaluate(Lobe lobe, int form, vec3 direction) {
    return lobe.amplitude.rgb * asg_unit_lobe(lobe, form, direction);
}
