# SPDX-License-Identifier: Apache-2.0
"""Lobes as closed-form shading takes them: one hill of light each, with its moments.

A sheet is a Gaussian on a flat disc laid over the sphere, under a window that depends on z alone:

    form      sheets of a lobe            disc                            window
    asg       1                           x, y                            max(z, 0)
    bingham   2, one along -axis_z        x, y                            z > 0
    sg        1                           x, y times sqrt(2 / (1 + z))    none
    flat      3, its terms (lobes/flat)   x, y                            max(z, 0)

The disc of the sg form keeps areas and covers the sphere: its radius squared is 2 (1 - z), so that
an sg of sharpness s is `exp(-s/2 radius^2)` on it. The sharpness of a sheet is that on its disc.
"""

from enum import StrEnum
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg, flat


class Window(StrEnum):
    """What the Gaussian of a sheet is multiplied by."""

    COSINE = "cosine"
    """`max(z, 0)`."""
    STEP = "step"
    """1 where z > 0."""
    NONE = "none"
    """1."""


WINDOWS = {
    Form.ASG: Window.COSINE,
    Form.BINGHAM: Window.STEP,
    Form.SG: Window.NONE,
    Form.FLAT: Window.COSINE,
}


class Sheets(NamedTuple):
    """M sheets of one window.

    Attributes:
        axes: Rows axis_x, axis_y, axis_z, orthonormal.  [..., M, 3, 3]
        disc_variance: Of the Gaussian on the disc, along axis_x and axis_y.  [..., M, 2]
        integral: Of a sheet of amplitude 1, steradians.  [..., M]
        mean: Of z over the normalised sheet.  [..., M]
        variance: Of x, y and z over the normalised sheet.  [..., M, 3]
        window: The same for all sheets.
    """

    axes: Tensor
    disc_variance: Tensor
    integral: Tensor
    mean: Tensor
    variance: Tensor
    window: Window

    def over_points(self) -> "Sheets":
        """Add a dimension of points behind that of the sheets.  [..., M, 1, .]."""
        return Sheets(
            self.axes[..., None, :, :],
            self.disc_variance[..., None, :],
            self.integral[..., None],
            self.mean[..., None],
            self.variance[..., None, :],
            self.window,
        )


def sheets(lobes: Lobes) -> Sheets:
    """Take lobes of amplitude 1 apart into sheets, with exact moments.

    Args:
        lobes: N lobes.  [..., N, .]

    Returns:
        M = N sheets; of the bingham form 2 N, the twin of a lobe N later; of the flat form 3 N, in
        the order of `flat.terms`.
    """
    if lobes.form is Form.FLAT:
        return sheets(flat.terms(lobes))
    moments = asg.moments(lobes)
    disc_variance = 0.5 / lobes.sharpness
    integral, first = moments.zeroth, moments.first
    if lobes.form is Form.SG:
        disc_variance = 1 / lobes.sharpness
    if lobes.form is Form.BINGHAM:
        integral = 0.5 * integral
        # The integral of z over the half z > 0 is what the window of the asg form integrates.
        first = asg.integral(Lobes(lobes.axes, lobes.sharpness, lobes.amplitude, Form.ASG))
    mean = first / integral
    second = moments.second / moments.zeroth[..., None]
    # For sharp lobes the difference is rounding; the variance itself is then sharpness^-2.
    along = (second[..., 2] - mean * mean).clamp(min=0)
    variance = torch.stack([second[..., 0], second[..., 1], along], dim=-1)
    result = Sheets(lobes.axes, disc_variance, integral, mean, variance, WINDOWS[lobes.form])
    return _with_twins(result) if lobes.form is Form.BINGHAM else result


def amplitudes(lobes: Lobes) -> Tensor:
    """Return the linear RGB radiance of each sheet at its axis_z.  [..., M, 3].

    That of a flat lobe's second term is negative.
    """
    if lobes.form is Form.FLAT:
        return flat.terms(lobes).amplitude
    twice = (lobes.amplitude, lobes.amplitude)
    return torch.cat(twice, dim=-2) if lobes.form is Form.BINGHAM else lobes.amplitude


def _with_twins(half: Sheets) -> Sheets:
    """Append every sheet turned by 180 degrees about its axis_x."""
    turned = half.axes * torch.tensor([[1.0], [-1.0], [-1.0]]).to(half.axes)
    return Sheets(
        torch.cat([half.axes, turned], dim=-3),
        torch.cat([half.disc_variance, half.disc_variance], dim=-2),
        torch.cat([half.integral, half.integral], dim=-1),
        torch.cat([half.mean, half.mean], dim=-1),
        torch.cat([half.variance, half.variance], dim=-2),
        half.window,
    )
