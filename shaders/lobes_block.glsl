// SPDX-License-Identifier: Apache-2.0
// The lobes of one frame as every pass sees them.

#include "lib/asg.glsl"

layout(std140) uniform LobesBlock {
    int u_lobe_count;         // byte 0
    int u_form;               // byte 4: a FORM_ number
    Lobe u_lobes[MAX_LOBES];  // byte 16, 64 bytes each
};

// Return the linear radiance that all lobes together send from a unit direction.
vec3 lobes_radiance(vec3 direction) {
    vec3 radiance = vec3(0.0);
    for (int lobe = 0; lobe < u_lobe_count; ++lobe) {
        radiance += asg_evaluate(u_lobes[lobe], u_form, direction);
    }
    return radiance;
}
