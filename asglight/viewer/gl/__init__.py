# SPDX-License-Identifier: Apache-2.0
"""What is drawn with OpenGL: passes, layers, the renderer; and where things lie in its pictures."""
