// SPDX-License-Identifier: Apache-2.0
// The one triangle that covers the target; drawn with three vertices and no vertex buffer.
#version 410 core

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}
