# SPDX-License-Identifier: GPL-3.0-or-later
"""All that needs no Blender: stages read, colours, images, edits written, the command."""
