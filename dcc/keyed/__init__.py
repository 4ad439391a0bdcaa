# SPDX-License-Identifier: Apache-2.0
"""Keys and rest in Blender, held against the images that they were cut from."""
