# SPDX-License-Identifier: Apache-2.0
"""Shots in Blender through the extension, at any time, held against the lobes."""
