# SPDX-License-Identifier: Apache-2.0
"""What shaders are given of lobes, computed without OpenGL."""
