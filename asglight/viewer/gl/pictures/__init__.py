# SPDX-License-Identifier: Apache-2.0
"""Finished pictures: brought to the screen, and read back."""
