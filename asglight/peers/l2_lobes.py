# SPDX-License-Identifier: Apache-2.0
"""Lobes of least squared error over the sphere: scattered SRBF, and SG or ASG as Xu et al. fit.

    scattered_srbf   [Tsai and Shih 2006, "All-frequency precomputed radiance transfer using
                     spherical radial basis functions and clustered tensor approximation", ACM
                     Transactions on Graphics 25(3), SIGGRAPH]: Gaussian radial functions of free
                     centre and bandwidth, coefficients of either sign
    least_squares    [Xu, Sun, Dong, Zhao, Wu and Hu 2013, "Anisotropic spherical Gaussians", ACM
                     Transactions on Graphics 32(6), SIGGRAPH Asia]: SG or ASG, amplitudes >= 0

The papers differ from this file where they say how they minimise; what is minimised, the integral
of the squared error, is theirs. Centres, frames and sharpnesses start from a matching pursuit
(`pursuit.py`) and move by L-BFGS-B [Byrd, Lu, Nocedal and Zhu 1995]. Amplitudes are no unknowns:
they are solved at every step, and as they are then the best, the error's derivative by the others
is the same as if they stood still [variable projection; Golub and Pereyra 1973]. First on 64 rows,
then on all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around, axes_from_quaternion, quaternion_from_axes
from asglight.peers import amplitudes, pursuit
from asglight.peers.approximation import LOBE_FLOATS, LobeSum, free_lobes
from asglight.sphere import latlong

COARSE_ROWS = 64
ITERATIONS = (400, 100)
"""Of L-BFGS-B on the coarse grid and on all texels, at most. With 150 the squared error of `venice`
(ASG, 64 rows) is 1.25 times as large."""

SIGMA_MIN_TEXELS = 1 / math.sqrt(2 * math.pi)
"""Narrowest lobe: its integral is that of one texel at the equator, so a lamp of one texel is met
in radiance and in flux. A narrower one would meet it at the texel's centre with less light."""

SHARPNESS_FLOOR = 0.05
"""Lowest sharpness: nearly a whole sphere (or, of an ASG, a cosine over a half)."""


@dataclass(frozen=True)
class Target:
    """A map as the error needs it, in units of its own norm.

    Attributes:
        radiance: Over the root of the integral of its square.  [P, 3]
        directions: Texel centres.  [P, 3]
        solid_angle: Steradians.  [P]
        rows: H.
    """

    radiance: Tensor
    directions: Tensor
    solid_angle: Tensor
    rows: int


def scattered_srbf(
    reference: Tensor, floats: int, *, iterations: Sequence[int] = ITERATIONS
) -> LobeSum:
    """Fit as many radial functions as the budget holds, with amplitudes of either sign.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        floats: Budget, 6 or more.
        iterations: On the coarse grid and on all texels.
    """
    return _fit(reference, floats // LOBE_FLOATS[Form.SG], Form.SG, True, iterations)


def least_squares(
    reference: Tensor, floats: int, form: Form, *, iterations: Sequence[int] = ITERATIONS
) -> LobeSum:
    """Fit as many lobes as the budget holds, with amplitudes >= 0; arguments as above."""
    return _fit(reference, floats // LOBE_FLOATS[form], form, False, iterations)


def _fit(
    reference: Tensor, count: int, form: Form, signed: bool, iterations: Sequence[int]
) -> LobeSum:
    coarse, fine = iterations
    lobes = _on_coarse_grid(reference, count, form, signed, coarse)
    wanted = target(reference)
    lobes = _minimised(wanted, lobes, signed, fine)
    amplitude = _projected(wanted, lobes, signed)[0]
    scale = float(target_norm(reference))
    result = replace(lobes, amplitude=amplitude * scale).to(torch.float32)
    return free_lobes(result)


def _on_coarse_grid(reference: Tensor, count: int, form: Form, signed: bool, steps: int) -> Lobes:
    """Return where a pursuit and steps come to.

    With amplitudes of either sign it is the better of two: beside a lamp a signed pursuit piles up
    lobes that cancel each other, and ends on `day` at sixty times the squared error that amplitudes
    >= 0 come to; so it also goes on from these.
    """
    rows = min(COARSE_ROWS, reference.shape[0])
    wanted = target(latlong.reduce(reference, rows, 2 * rows))

    def followed(sign: bool) -> Lobes:
        lobes = pursuit.start(reference, count, signed=sign).to(torch.float64)
        if form is not Form.SG:  # exp(s (z - 1)) is about exp(-s / 2 (x^2 + y^2))
            lobes = replace(lobes, sharpness=lobes.sharpness / 2, form=form)
        return _minimised(wanted, lobes, sign, steps)

    lobes = followed(False)
    if not signed:
        return lobes
    either = (followed(True), _minimised(wanted, lobes, True, steps))
    return min(either, key=lambda each: float(_projected(wanted, each, True)[1]))


def target_norm(reference: Tensor) -> Tensor:
    """Return the root of the integral of the squared radiance over the sphere."""
    solid_angle = latlong.texel_solid_angles(*reference.shape[:2], dtype=torch.float64)
    return (solid_angle[..., None] * reference.double().square()).sum().sqrt()


def target(reference: Tensor) -> Target:
    """Prepare the error of a map.  reference: [H, W, 3]."""
    height, width, _ = reference.shape
    return Target(
        (reference.double() / target_norm(reference)).reshape(-1, 3),
        latlong.directions(height, width, dtype=torch.float64).reshape(-1, 3),
        latlong.texel_solid_angles(height, width, dtype=torch.float64).reshape(-1),
        height,
    )


def _projected(wanted: Target, lobes: Lobes, signed: bool) -> tuple[Tensor, Tensor]:
    """Return the best amplitudes and the squared error with them; only it has a derivative."""
    values = asg.unit_lobes(lobes, wanted.directions)  # [N, P]
    with torch.no_grad():
        weighted = values * wanted.solid_angle
        amplitude = amplitudes.solve(values, weighted, wanted.radiance, signed=signed)
    residual = values.mT @ amplitude - wanted.radiance
    return amplitude, (wanted.solid_angle @ residual.square()).sum()


def _minimised(wanted: Target, lobes: Lobes, signed: bool, steps: int) -> Lobes:
    """Move frames and sharpnesses to where the error with the best amplitudes is least."""
    narrowest = SIGMA_MIN_TEXELS * math.pi / wanted.rows
    largest = 1 / narrowest**2 if lobes.form is Form.SG else 0.5 / narrowest**2
    bounds = (math.log(SHARPNESS_FLOOR), math.log(largest))
    vector, directional = _packed(lobes, bounds)

    def error(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        point = torch.from_numpy(x).clone().requires_grad_(True)
        _, value = _projected(wanted, _unpacked(point, lobes), signed)
        (slope,) = torch.autograd.grad(value, point)
        return float(value.detach()), slope.numpy()

    limits = [(None, None)] * directional + [bounds] * (len(vector) - directional)
    found = scipy.optimize.minimize(
        error, vector, jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": steps}
    )
    best = _unpacked(torch.from_numpy(found.x), lobes)
    return replace(best, axes=best.axes.detach(), sharpness=best.sharpness.detach())


def _packed(lobes: Lobes, bounds: tuple[float, float]) -> tuple[NDArray[np.float64], int]:
    """Return axes or quaternions, then log sharpnesses, and how many numbers the former are."""
    isotropic = lobes.form is Form.SG
    turned = lobes.axis_z if isotropic else quaternion_from_axes(lobes.axes)
    sharpness = lobes.sharpness[:, :1] if isotropic else lobes.sharpness
    logarithm = sharpness.log().clamp(*bounds)
    return torch.cat([turned.flatten(), logarithm.flatten()]).numpy(), turned.numel()


def _unpacked(vector: Tensor, like: Lobes) -> Lobes:
    """Return lobes of amplitude 1 of `_packed` numbers."""
    if like.form is Form.SG:
        axis_z, logarithm = vector[: 3 * like.count], vector[3 * like.count :]
        axes = axes_around(torch.nn.functional.normalize(axis_z.view(-1, 3), dim=-1))
        sharpness = logarithm.exp()[:, None].expand(-1, 2)
    else:
        quaternion, logarithm = vector[: 4 * like.count], vector[4 * like.count :]
        axes = axes_from_quaternion(quaternion.view(-1, 4))
        sharpness = logarithm.exp().view(-1, 2)
    return Lobes(axes, sharpness, torch.ones_like(axes[:, 0]), like.form)
