# SPDX-License-Identifier: Apache-2.0
"""Views of OpenColorIO: which there are, and their shaders. No OpenGL."""
