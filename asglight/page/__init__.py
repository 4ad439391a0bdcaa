# SPDX-License-Identifier: Apache-2.0
"""A shot as one HTML file that needs nothing else, made of the viewer's shaders."""
