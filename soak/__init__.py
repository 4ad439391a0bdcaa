# SPDX-License-Identifier: Apache-2.0
"""Damaged files by the hundred thousand, faults at random moments, and scale (docs/soak.md)."""
