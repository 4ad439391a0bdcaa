# SPDX-License-Identifier: Apache-2.0
"""HDR environment sequences as a few anisotropic spherical Gaussian lights, in time-sampled USD."""

__version__ = "0.1.0"
