# SPDX-License-Identifier: Apache-2.0
"""The sphere itself: latlong grid, solid angles, harmonics, quadrature."""
