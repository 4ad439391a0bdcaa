# SPDX-License-Identifier: Apache-2.0
"""The lobe function of each form: evaluate, exact integral and moments, rotate.

For a direction d write x = d.axis_x, y = d.axis_y, z = d.axis_z. With sharpness (sx, sy):

    asg       max(z, 0) exp(-sx x^2 - sy y^2)     [Xu et al. 2013]
    bingham   exp(-sx x^2 - sy y^2)               [Clausen et al. 2024, taken literally]
    sg        exp(s (z - 1))
    flat      max(z, 0) (1 - (1 - exp(-sx x^2 - sy y^2))^3), a sum of asg lobes (lobes/flat.py)

Integrals over the sphere. In polar coordinates of the (x, y) disc, rho^2 = x^2 + y^2 and
q(phi) = sx cos^2 phi + sy sin^2 phi, the radial integrals are closed forms of q: for the smooth
hemisphere max(z, 0) because max(z, 0) dw = dx dy, for the sharp hemisphere through Dawson's
function D. What is left is one periodic integral over phi. Derivations: docs/method/asg.md.

Symbols: M0 integral, M1 first moment along z, Mxx, Myy, Mzz second moments, all for amplitude 1.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from asglight.lobes import flat
from asglight.lobes.data import Form, Lobes
from asglight.sphere.dawson import dawson

SHARPNESS_MIN = 1e-3
"""Dimensionless. Below it a lobe is a plain (half) sphere to 0.1 %; 1/sharpness stays finite."""

SHARPNESS_MAX = 1e7
"""Dimensionless. A lobe of 0.03 degrees, twenty times narrower than the sun's disc."""

ANGLE_NODES = 64
"""Nodes of the angular quadrature: relative error below 1e-11 for sharpness 1e-3 to 1e7 and any
ratio (tests/lobes/test_lobes_integral.py)."""

PIECE = 256
"""Lobes whose nodes are computed together: arrays of 0.13 MB stay in the cache of a core. 1,024 at
once take half as long again, 15,000 six times as long."""


class Moments(NamedTuple):
    """Moments of a unit-amplitude lobe in its own frame, in steradians.

    Attributes:
        zeroth: Integral of the lobe.  [...]
        first: Integral of z times the lobe; the x and y components are 0 by symmetry.  [...]
        second: Integrals of x^2, y^2, z^2 times the lobe; mixed ones are 0.  [..., 3]
    """

    zeroth: Tensor
    first: Tensor
    second: Tensor

    def select(self, lobes: Tensor) -> "Moments":
        """Pick lobes by index or mask along N, as `Lobes.select`."""
        return Moments(self.zeroth[..., lobes], self.first[..., lobes], self.second[..., lobes, :])


def per_variance(form: Form) -> float:
    """Return 1 / (s E[x^2]) of narrow lobes of a form; s is the sharpness along x."""
    if form is Form.FLAT:
        return 2.0 / flat.VARIANCE
    return 1.0 if form is Form.SG else 2.0


def evaluate(lobes: Lobes, directions: Tensor) -> Tensor:
    """Return the radiance that all lobes together send from each direction.

    Args:
        lobes: N lobes with any batch shape.  [..., N, .]
        directions: Unit directions, shared by the batch.  [P, 3]

    Returns:
        Linear RGB radiance.  [..., P, 3]
    """
    return torch.einsum("...np,...nc->...pc", unit_lobes(lobes, directions), lobes.amplitude)


def unit_lobes(lobes: Lobes, directions: Tensor) -> Tensor:
    """Return each lobe's value for amplitude 1.

    Args:
        lobes: N lobes.  [..., N, .]
        directions: Unit directions.  [P, 3]

    Returns:
        Values in [0, 1].  [..., N, P]
    """
    if lobes.form is Form.SG:  # depends on axis_z alone; this keeps its precision where z -> 1
        # component by component: a sum over three is slow where they lie side by side
        pairs = zip(directions.unbind(-1), lobes.axis_z.unbind(-1), strict=True)
        x, y, z = ((end - start[..., None]).square() for end, start in pairs)
        return x.add_(y).add_(z).mul_(-0.5 * lobes.sharpness[..., :1]).exp_()
    return local_values(lobes, lobes.axes @ directions.mT)


def local_values(lobes: Lobes, local: Tensor) -> Tensor:
    """Return each lobe's value for amplitude 1 at directions in its own frame.

    The sg form is computed as exp(-s (x^2 + y^2) / (1 + z)), which keeps its precision where
    z -> 1.

    Args:
        lobes: N lobes.  [..., N, .]
        local: Components x, y, z of unit directions along the lobe's axes.  [..., N, 3, P]

    Returns:
        Values in [0, 1].  [..., N, P]
    """
    x, y, z = local.unbind(-2)
    sx, sy = lobes.sharpness[..., None].unbind(-2)
    if lobes.form is Form.SG:
        beside = (x * x + y * y) / (1 + z.clamp(min=0))
        return torch.exp(-sx * torch.where(z > 0, beside, 1 - z))
    gaussian = torch.exp(-sx * x * x - sy * y * y)
    if lobes.form is Form.FLAT:
        gaussian = flat.values(gaussian)
    return gaussian if lobes.form is Form.BINGHAM else gaussian * z.clamp(min=0)


def integral(lobes: Lobes) -> Tensor:
    """Integrate each unit-amplitude lobe over the sphere, exactly, in steradians.  [..., N].

    Computed in float64 and returned in the dtype of the sharpness; differentiable.
    """
    sharpness = lobes.sharpness.double()
    if lobes.form is Form.FLAT:
        result = flat.summed(integral(flat.terms(lobes.to(torch.float64))), -1)
    elif lobes.form is Form.SG:
        result = _sg_integral(sharpness[..., 0])
    else:
        parts = [_disc_integral(piece, lobes.form) for piece in _pieces(sharpness)]
        result = torch.cat(parts).view(sharpness.shape[:-1])
    return result.to(lobes.sharpness.dtype)


def flux(lobes: Lobes) -> Tensor:
    """Return the flux of each lobe: its radiance integrated over the sphere.  [..., N, 3]."""
    return lobes.amplitude * integral(lobes)[..., None]


def moments(lobes: Lobes) -> Moments:
    """Integrate each unit-amplitude lobe, its z, and its x^2, y^2, z^2 over the sphere.

    Computed in float64 and returned in the dtype of the sharpness; differentiable.
    """
    sharpness = lobes.sharpness.double()
    if lobes.form is Form.FLAT:
        zeroth, first, second = moments(flat.terms(lobes.to(torch.float64)))
        result = Moments(flat.summed(zeroth, -1), flat.summed(first, -1), flat.summed(second, -2))
    elif lobes.form is Form.SG:
        result = sg_moments(sharpness[..., 0])
    else:
        smooth = lobes.form is Form.ASG
        parts = [_disc_moments(piece, smooth=smooth) for piece in _pieces(sharpness)]
        batch = sharpness.shape[:-1]
        zeroth, first, second = (torch.cat(part) for part in zip(*parts, strict=True))
        result = Moments(zeroth.view(batch), first.view(batch), second.view(*batch, 3))
        if lobes.form is Form.BINGHAM:  # two equal hemispheres, whose first moments cancel
            zeroth, first, second = result
            result = Moments(2 * zeroth, torch.zeros_like(first), 2 * second)
    return Moments(*(m.to(lobes.sharpness.dtype) for m in result))


def log_slopes(lobes: Lobes, known: Moments) -> Tensor:
    """Differentiate the logarithm of each lobe's integral by those of its sharpness.

    Along x it is -sx times the share of x^2 in the lobe; of sg, -s times that of 1 - z.

    Args:
        lobes: N lobes.  [..., N, .]
        known: Their moments, float64.  [..., N, .]

    Returns:
        Along sx and sy, float64; of sg, along s and 0.  [..., N, 2]
    """
    lobes = lobes.to(torch.float64)
    if lobes.form is Form.SG:
        along = lobes.sharpness[..., 0] * (known.zeroth - known.first)
        slopes = torch.stack([along, torch.zeros_like(along)], -1)
    elif lobes.form is Form.FLAT:
        terms = flat.terms(lobes)
        slopes = flat.summed(terms.sharpness * moments(terms).second[..., :2], -2)
    else:
        slopes = lobes.sharpness * known.second[..., :2]
    return -slopes / known.zeroth[..., None]


def facing_irradiance(lobes: Lobes, known: Moments | None = None) -> Tensor:
    """Return the irradiance on a patch that faces each lobe: the integral of z over z > 0.

    asg: the first moment. bingham: one side's, which is the integral of the asg of the same
    sharpness. sg: 2 pi (s - 1 + exp(-s)) / s^2, by parts.

    Args:
        lobes: N lobes.  [..., N, .]
        known: Their moments, float64, where they are there.  [..., N, .]

    Returns:
        Linear RGB, not divided by pi, float64.  [..., N, 3]
    """
    lobes = lobes.to(torch.float64)
    if lobes.form is Form.SG:
        unit = _sg_facing(lobes.sharpness[..., 0])
    elif lobes.form is Form.BINGHAM:
        unit = integral(Lobes(lobes.axes, lobes.sharpness, lobes.amplitude, Form.ASG))
    else:
        unit = (known or moments(lobes)).first
    return lobes.amplitude * unit[..., None]


def rotate(lobes: Lobes, rotation: Tensor) -> Lobes:
    """Rotate lobes: the result at R d equals the argument at d.

    Args:
        lobes: N lobes.  [..., N, .]
        rotation: Rotation matrices that multiply column vectors.  [..., 3, 3]
    """
    return replace(lobes, axes=lobes.axes @ rotation[..., None, :, :].mT)


class _Around(NamedTuple):
    """Nodes of the integral over phi.

    Attributes:
        x_is_large: Whether x has the larger sharpness.  [..., 1]
        weight: Weights of the nodes, the four quadrants together.  [..., K]
        along_large: Squared cosine to the axis of the larger sharpness.  [..., K]
        q: sx cos^2 phi + sy sin^2 phi.  [..., K]
    """

    x_is_large: Tensor
    weight: Tensor
    along_large: Tensor
    q: Tensor


def _around(sharpness: Tensor) -> _Around:
    """Place the nodes of the integral over phi.

    The integrand has a feature of angular width sqrt(max(small, 1) / large) around the direction of
    the smaller sharpness. tan(theta) = delta tan(psi) spreads it evenly over psi, after which the
    periodic midpoint rule converges geometrically.
    """
    x_is_large = sharpness[..., :1] >= sharpness[..., 1:]
    large = torch.where(x_is_large, sharpness[..., :1], sharpness[..., 1:])  # [..., 1]
    small = torch.where(x_is_large, sharpness[..., 1:], sharpness[..., :1])
    cosine, sine = _squared_waves(str(sharpness.device))
    square = (small.clamp(min=1) / large.clamp(min=1)).detach()  # delta^2  [..., 1]
    stretched = cosine + square * sine
    weight = 4 * (math.pi / 2 / ANGLE_NODES) * square.sqrt() / stretched  # four equal quadrants
    along_large = square * sine / stretched  # cos^2 phi
    along_small = cosine / stretched  # sin^2 phi
    return _Around(x_is_large, weight, along_large, small * along_small + large * along_large)


@lru_cache(maxsize=8)
@torch.inference_mode(False)
def _squared_waves(device: str) -> tuple[Tensor, Tensor]:
    """Return cos^2 psi and sin^2 psi at the nodes.  Two [K]."""
    psi = (torch.arange(ANGLE_NODES, dtype=torch.float64) + 0.5) * (math.pi / 2 / ANGLE_NODES)
    return torch.cos(psi).square().to(device), torch.sin(psi).square().to(device)


def _pieces(sharpness: Tensor) -> tuple[Tensor, ...]:
    """Return the lobes of a batch, on the processor a few at a time.  [..., 2] -> [L, 2] each."""
    flattened = sharpness.reshape(-1, 2)
    return flattened.split(PIECE) if sharpness.device.type == "cpu" else (flattened,)


def _disc_integral(sharpness: Tensor, form: Form) -> Tensor:
    """Integrate lobes of the form asg or bingham.  [L, 2] -> [L]."""
    around = _around(sharpness)
    radial = _smooth_integral(around.q) if form is Form.ASG else _Dawson.apply(around.q)
    result = (around.weight * radial).sum(-1)
    return 2 * result if form is Form.BINGHAM else result  # two equal hemispheres


def _disc_moments(sharpness: Tensor, *, smooth: bool) -> Moments:
    """Return the moments over the hemisphere z > 0, with (`smooth`) or without the factor z."""
    x_is_large, weight, along_large, q = _around(sharpness)
    radial_0, radial_1, radial_2 = _smooth_radial(q) if smooth else _sharp_radial(q)
    zeroth = (weight * radial_0).sum(-1)
    second_large = (weight * along_large * radial_2).sum(-1)
    second_small = (weight * (1 - along_large) * radial_2).sum(-1)
    xx = torch.where(x_is_large[..., 0], second_large, second_small)
    yy = torch.where(x_is_large[..., 0], second_small, second_large)
    second = torch.stack([xx, yy, zeroth - xx - yy], dim=-1)
    return Moments(zeroth, (weight * radial_1).sum(-1), second)


def _smooth_integral(q: Tensor) -> Tensor:
    """Integrate rho times exp(-q rho^2) over rho in [0, 1]."""
    return -torch.expm1(-q) / (2 * q)


def _smooth_radial(q: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Integrate rho, rho z and rho^3 times exp(-q rho^2) over rho in [0, 1]."""
    dawson = _Dawson.apply(q)
    near_zero = q < 1e-2  # below it the closed form of the third loses four digits
    safe = torch.where(near_zero, 1.0, q)
    closed = (1 - (1 + safe) * torch.exp(-safe)) / (2 * safe * safe)
    series = 1 / 4 - q * (1 / 6 - q * (1 / 16 - q * (1 / 60 - q * (1 / 288 - q / 1680))))
    return (
        _smooth_integral(q),
        (1 - dawson) / (2 * q),
        torch.where(near_zero, series, closed),
    )


def _sharp_radial(q: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Integrate 1, z and rho^2 times exp(-q rho^2) rho / z over rho in [0, 1]."""
    dawson = _Dawson.apply(q)
    closed = dawson - (1 - dawson) / (2 * q)
    # above 1e3 the closed form loses digits as q; the asymptotic series is exact to 1e-13 there
    r = 1 / q
    series = (1 + r * (1 + r * (9 / 4 + r * (15 / 2 + r * 525 / 16)))) * r * r / 2
    return dawson, -torch.expm1(-q) / (2 * q), torch.where(q > 1e3, series, closed)


class _Dawson(torch.autograd.Function):
    """D(sqrt q) / sqrt q; derivative from D' = 1 - 2 x D."""

    @staticmethod
    def forward(ctx: Any, q: Tensor) -> Tensor:
        """Return D(sqrt q) / sqrt q."""
        root = q.detach().to(torch.float64).sqrt()
        value = (dawson(root) / root).to(q)
        ctx.save_for_backward(q, value)
        return value

    @staticmethod
    def backward(ctx: Any, *grad: Tensor) -> Tensor:
        """Return the slope along q."""
        q, value = ctx.saved_tensors
        derivative = (1 - value) / (2 * q) - value  # d/dq of D(sqrt q)/sqrt q
        return grad[0] * derivative


def _sg_integral(s: Tensor) -> Tensor:
    """Return the integral of exp(s (z - 1)) over the sphere."""
    return -2 * math.pi * torch.expm1(-2 * s) / s


def sg_moments(s: Tensor) -> Moments:
    """Return the moments of exp(s (z - 1)): von Mises-Fisher statistics without normalisation.

    Args:
        s: Sharpness, float64.  [...]
    """
    zeroth = _sg_integral(s)
    small = s < 0.05  # there coth(s) - 1/s cancels; the series is exact to 2e-11
    safe = torch.where(small, 1.0, s)
    langevin = 1 / torch.tanh(safe) - 1 / safe
    series = s * (1 / 3 - s * s * (1 / 45 - s * s * (2 / 945 - s * s / 4725)))
    mean_z = torch.where(small, series, langevin)
    ratio = torch.where(small, 1 / 3 - s * s * (1 / 45 - s * s * 2 / 945), langevin / safe)
    first = zeroth * mean_z
    lateral = zeroth * ratio  # E[x^2] = E[z] / s
    return Moments(zeroth, first, torch.stack([lateral, lateral, zeroth - 2 * lateral], dim=-1))


def _sg_facing(s: Tensor) -> Tensor:
    small = s < 0.05  # there s - 1 + exp(-s) cancels; the series is exact to 1e-10
    safe = torch.where(small, 1.0, s)
    closed = (safe + torch.expm1(-safe)) / safe.square()
    series = 1 / 2 - s * (1 / 6 - s * (1 / 24 - s * (1 / 120 - s * (1 / 720 - s / 5040))))
    return 2 * torch.pi * torch.where(small, series, closed)
