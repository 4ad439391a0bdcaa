# SPDX-License-Identifier: Apache-2.0
"""What the viewer shows, as plain data, and what may be done to it. No OpenGL, no window."""
