# SPDX-License-Identifier: Apache-2.0
"""Whole commands as ratios, held against a baseline: `python -m benchmarks.command`."""
