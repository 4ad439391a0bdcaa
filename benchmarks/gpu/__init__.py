# SPDX-License-Identifier: Apache-2.0
"""All that is measured on a GPU, `python -m benchmarks.gpu` (docs/results/gpu.md)."""
