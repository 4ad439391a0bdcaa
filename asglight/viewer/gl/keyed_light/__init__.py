# SPDX-License-Identifier: Apache-2.0
"""Layers of a keyed stage: its balls and its map."""
