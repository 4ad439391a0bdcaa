# SPDX-License-Identifier: Apache-2.0
"""A frame from nothing: seeds, starts, splits and merges, the balance of materials."""
