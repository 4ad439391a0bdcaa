# SPDX-License-Identifier: Apache-2.0
"""All that is measured on a GPU, by one command: `python -m benchmarks.gpu` (docs/gpu.md)."""
