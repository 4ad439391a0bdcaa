# SPDX-License-Identifier: Apache-2.0
"""Many maps that have nothing to do with each other, fitted side by side: for a GPU."""

from asglight.fitting.stills.fits import fit_stills

__all__ = ["fit_stills"]
