# SPDX-License-Identifier: Apache-2.0
"""Key lights: lamps found in maps, cut out of them, and followed over a shot."""
