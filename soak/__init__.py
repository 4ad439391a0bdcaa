# SPDX-License-Identifier: Apache-2.0
"""Damaged files, faults at random moments, and scale (docs/results/soak.md)."""
