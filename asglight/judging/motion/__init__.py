# SPDX-License-Identifier: Apache-2.0
"""How right lobes are between frames, and whether a track follows its lamp."""
