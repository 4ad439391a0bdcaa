// SPDX-License-Identifier: Apache-2.0
// Constants that GLSL does not have.

const float PI = 3.14159265358979;
