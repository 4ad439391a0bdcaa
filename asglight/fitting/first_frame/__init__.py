# SPDX-License-Identifier: Apache-2.0
"""A frame from nothing: seeds, initial guesses, splits and merges, the weights of materials."""
