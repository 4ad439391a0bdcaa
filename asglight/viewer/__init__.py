# SPDX-License-Identifier: Apache-2.0
"""The viewer: lobe tracks drawn with OpenGL, in a window or into a file.

Nothing is imported here, because each part needs packages of its own: `app` none, `screenshot` an
OpenGL, `window` also Dear ImGui.
"""
