# SPDX-License-Identifier: Apache-2.0
"""What a GGX layer shows of lobes, in closed form: two approximations and the share of each.

`narrow`: the light is narrower than the reflection. The GGX distribution is widened by the sheet's
spread of half vectors (its covariance through the Jacobian of the half vector; normal-distribution
filtering, Kaplanyan et al. 2016, Tokuyoshi and Kaplanyan 2021) and taken at the half vector of the
sheet's axis, with visibility and cosine at the mean cosine of the part above the horizon.

`broad`: the reflection is narrower than the light. The layer is its directional albedo times a few
Gaussians around a direction between mirror and normal, and each blurs the sheet: covariances add
in a common tangent plane (the convolution of Xu et al. 2013), the light under the sheet is kept.
What the Gaussians are, for every roughness and n.v, is fitted (`ggx_lobes_constants.py`).

`ggx_layer.share` says how much of each, by sheet and ball alone. docs/method/shading.md has
derivations and measured errors. The twin is shaders/lib/ggx_lobes.glsl.

All but `radiance` and `reflected` take sheets with a dimension of points (`Sheets.over_points`) and
broadcast. Symbols: M sheets, P points, K Gaussians of the kernel.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.lobes import Lobes
from asglight.shading import ggx
from asglight.shading.ggx_layer import Layer, Tilt, kept, layer, share, slopes, tilt
from asglight.shading.ggx_lobes_constants import DISC, KERNEL
from asglight.shading.rectified import cosine, rectified, widened
from asglight.shading.sheets import Sheets, Window, amplitudes, sheets

TERMS = len(KERNEL[0]) // 4
"""K, Gaussians of the broad kernel."""

COS_VIEW_MIN = 1e-4
"""Stands for n.v = 0 at the edge of a ball, where visibility is 0/0."""

SIN_VIEW_MIN = 1e-5
"""Below it every tangent is as good: the layer looks the same from all sides."""

OPPOSITE_MIN = 1e-12
"""Least |a + b|^2 of a sheet's axis and the kernel's: opposite ones have no common frame."""

PROBABILITY_MIN, COS_LIGHT_MIN = 1e-6, 1e-5
"""Least share of a light above the horizon, and least mean cosine of that share."""

DISC_A, DISC_B, DISC_C = 0.26962589, 0.07860289, 0.28103058
"""Of `disc_mean`: in q it is `(1 + A q + B q^2) / (1 + (A + 1/2) q + C q^2 + B q^3)`, with the
least largest relative error."""

DISC_SCALES = {Window.COSINE: DISC[0], Window.STEP: DISC[1], Window.NONE: 0.25}
"""What the variance is multiplied by in `disc_mean`. Without a window the disc has radius 2."""


class Surface(NamedTuple):
    """Points of a surface and how they are seen.

    Attributes:
        normal: Unit.  [..., P, 3]
        tangent: Unit, towards the view.  [..., P, 3]
        bitangent: Unit, across the plane of view and normal.  [..., P, 3]
        cos_view: n.v.  [..., P]
        sin_view: Its sine.  [..., P]
    """

    normal: Tensor
    tangent: Tensor
    bitangent: Tensor
    cos_view: Tensor
    sin_view: Tensor


class Kernel(NamedTuple):
    """The K Gaussians that stand for the layer, in the tangent plane of one direction.

    Attributes:
        axis: Where the tangent plane touches the sphere.  [..., P, 3]
        across: Unit tangent across the plane of view and normal.  [..., P, 3]
        along: Unit tangent in it.  [..., P, 3]
        weight: Of the Gaussians; they sum to 1.  [..., P, K]
        shift: Of their means along `along`.  [..., P, K]
        variance_across: [..., P, K]
        variance_along: [..., P, K]
    """

    axis: Tensor
    across: Tensor
    along: Tensor
    weight: Tensor
    shift: Tensor
    variance_across: Tensor
    variance_along: Tensor


def radiance(lobes: Lobes, normals: Tensor, view: Tensor, roughness: float, f0: Tensor) -> Tensor:
    """Return what a GGX layer shows of all lobes together.

    Args:
        lobes: N lobes.  [N, .]
        normals: Unit.  [P, 3]
        view: Unit, towards the camera.  [3] or [P, 3]
        roughness: Perceptual; beyond ROUGHNESS_MIN and ROUGHNESS_MAX of `ggx_layer` the nearer.
        f0: Reflectance along the normal.  [3]

    Returns:
        Linear RGB radiance.  [P, 3]
    """
    made = layer(torch.as_tensor(roughness, dtype=normals.dtype, device=normals.device))
    cos_view = (normals * view).sum(-1).clamp(min=COS_VIEW_MIN)
    albedo = ggx.albedo_parts(cos_view, float(made.alpha))
    unit = reflected(sheets(lobes), normals, view, made, f0, albedo)
    return torch.einsum("mpc,mc->pc", unit, amplitudes(lobes))


def reflected(
    made: Sheets, normals: Tensor, view: Tensor, layer: Layer, f0: Tensor, albedo: Tensor
) -> Tensor:
    """Return what a GGX layer shows of each sheet of amplitude 1.

    Args:
        made: M sheets.  [M, .]
        normals: Unit.  [P, 3]
        view: Unit.  [3] or [P, 3]
        layer: From `layer`.
        f0: Reflectance along the normal.  [3]
        albedo: `ggx.albedo_parts` at n.v.  [P, 2]

    Returns:
        Linear RGB.  [M, P, 3]
    """
    spread = made.over_points()
    seen = surface(normals, view)
    tilted = tilt(spread, view, layer)
    part = share(spread, view, layer)[..., None]
    fresnel = f0 + (1 - f0) * tilted.grazing[..., None]
    mirrored = narrow(spread, tilted, seen, layer)[..., None] * fresnel
    blurred = broad(spread, kernel(seen, layer), DISC_SCALES[made.window])[..., None]
    left = (1 - part) * kept(spread, view, layer)[..., None]
    return part * mirrored + left * blurred * (albedo[:, :1] * f0 + albedo[:, 1:])


def surface(normals: Tensor, view: Tensor) -> Surface:
    """Place frames of tangent, bitangent and normal."""
    cos_view = _dot(normals, view)
    tangential = view - cos_view[..., None] * normals
    sin_view = tangential.norm(dim=-1)
    helper = torch.nn.functional.one_hot(normals.abs().argmin(-1), 3).to(normals)
    any_tangent = torch.nn.functional.normalize(torch.linalg.cross(helper, normals), dim=-1)
    scaled = tangential / sin_view.clamp(min=SIN_VIEW_MIN)[..., None]
    tangent = torch.where((sin_view > SIN_VIEW_MIN)[..., None], scaled, any_tangent)
    bitangent = torch.linalg.cross(normals, tangent)
    return Surface(normals, tangent, bitangent, cos_view.clamp(min=COS_VIEW_MIN), sin_view)


def kernel(seen: Surface, layer: Layer) -> Kernel:
    """Return the Gaussians that stand for the layer at each point.

    The direction is the mirror image of the view in the mean visible normal of a distribution
    stretched by the first polynomial. Seen along the normal the Gaussians are round.
    """
    n_v, sin = seen.cos_view, seen.sin_view
    powers = torch.stack([torch.ones_like(n_v), n_v, n_v * n_v, n_v * n_v * n_v], dim=-1)
    fitted = (layer.kernel * powers[..., None, :]).sum(-1)  # [..., P, 4 K]
    stretch, logits, along, ratio, shift = fitted.split([1, TERMS - 1, TERMS, TERMS, TERMS], -1)
    alpha2 = layer.alpha * layer.alpha
    spread = torch.exp(stretch[..., 0]) * alpha2 * sin
    mirror_t, mirror_n = spread, n_v + (spread * sin + n_v * n_v).sqrt()
    length2 = mirror_t * mirror_t + mirror_n * mirror_n
    twice = 2 * (sin * mirror_t + n_v * mirror_n) / length2
    axis_t, axis_n = twice * mirror_t - sin, twice * mirror_n - n_v
    logits = torch.cat([logits, torch.zeros_like(logits[..., :1])], dim=-1)
    variance_along = 2 * alpha2[..., None] * torch.exp(along)
    flattened = (n_v * n_v + 0.5 * alpha2 * sin * sin)[..., None]
    return Kernel(
        axis=axis_t[..., None] * seen.tangent + axis_n[..., None] * seen.normal,
        across=seen.bitangent,
        along=axis_n[..., None] * seen.tangent - axis_t[..., None] * seen.normal,
        weight=torch.softmax(logits, dim=-1),
        shift=(layer.alpha * sin)[..., None] * shift,
        variance_across=variance_along * flattened * torch.exp((1 - n_v)[..., None] * ratio),
        variance_along=variance_along,
    )


def broad(spread: Sheets, kernel: Kernel, disc: float | Tensor) -> Tensor:
    """Blur each sheet of amplitude 1 with the kernel, whose weights sum to 1.

    Parallel transport takes the sheet to the kernel's tangent plane: axis_z lies at (zx, zy).

    Args:
        spread: M sheets with a dimension of points.
        kernel: At P points.
        disc: `DISC_SCALES` of the sheets' window.

    Returns:
        [..., M, P]
    """
    axis_x, _, axis_z = spread.axes.unbind(-2)
    c, zx, zy = (_dot(axis, axis_z) for axis in (kernel.axis, kernel.across, kernel.along))
    # 1 + c = |a + b|^2 / 2 keeps its digits where the two are nearly opposite.
    sum2 = (kernel.axis + axis_z).square().sum(-1)
    inverse = 2 / sum2.clamp(min=OPPOSITE_MIN)
    xc = _dot(axis_x, kernel.axis) * inverse
    x1, x2 = _dot(axis_x, kernel.across) - zx * xc, _dot(axis_x, kernel.along) - zy * xc
    zx_disc, zy_disc = zx, zy
    if spread.window is Window.NONE:  # opposite directions lie on the rim of the disc of radius 2
        far = (2 * inverse).sqrt()
        zx_disc, zy_disc = torch.where(sum2 > OPPOSITE_MIN, zx * far, 2.0), zy * far
    vx, vy = spread.disc_variance.unbind(-1)
    before = disc_mean(vx, disc) * disc_mean(vy, disc)
    # Divided by the length of the transported axis (x1, x2), which rounding may have changed.
    turn = 1 / (x1 * x1 + x2 * x2).clamp(min=OPPOSITE_MIN)
    v11 = (vx * x1 * x1 + vy * x2 * x2) * turn
    v22, v12 = (vx * x2 * x2 + vy * x1 * x1) * turn, (vx - vy) * x1 * x2 * turn
    total = torch.zeros_like(c)
    for k in range(TERMS):
        across, along = kernel.variance_across[..., k], kernel.variance_along[..., k]
        s11, s22 = v11 + across, v22 + along
        determinant = vx * vy + v11 * along + v22 * across + across * along
        half = 0.5 * (s11 - s22)
        large = 0.5 * (s11 + s22) + (half * half + v12 * v12).sqrt()
        after = disc_mean(large, disc) * disc_mean(determinant / large, disc)
        d1, d2 = zx_disc, zy_disc - kernel.shift[..., k]
        exponent = 0.5 * (s22 * d1 * d1 - 2 * v12 * d1 * d2 + s11 * d2 * d2) / determinant
        blurred = (before / after).sqrt() * torch.exp(-exponent)
        window = _window(spread.window, c, zx, zy, kernel, k)
        total = total + kernel.weight[..., k] * blurred * window
    return total


def disc_mean(variance: Tensor, disc: float | Tensor) -> Tensor:
    """Return the mean of a round Gaussian over a disc.

    With `q = 1 / (2 disc variance)` it stands for `(1 - e^-q) / q`, the mean over the unit disc for
    disc = 1, to 0.2 %: a rational function with the right values and slopes at both ends, which
    needs no exponential and loses no digits. The sheet keeps its light when its Gaussian is blurred
    if its amplitude goes down by what this mean goes up.

    Args:
        variance: [...]
        disc: What the variance is multiplied by.
    """
    v = variance * disc
    above = v * (v * (v + 0.5 * DISC_A) + 0.25 * DISC_B)
    below = v * (v * (v + 0.5 * (DISC_A + 0.5)) + 0.25 * DISC_C) + 0.125 * DISC_B
    return above / below


def _window(
    window: Window, c: Tensor, zx: Tensor, zy: Tensor, kernel: Kernel, k: int
) -> Tensor | float:
    """Blur the window of a sheet with one Gaussian, z being normal with moments to match."""
    if window is Window.NONE:
        return 1.0
    across, along = kernel.variance_across[..., k], kernel.variance_along[..., k]
    shrink = torch.exp(-0.5 * (across + along))
    # 1 + 3 v keeps the variance of a wide Gaussian below that of an even sphere, 1/3.
    variance = zx * zx * (across / (1 + 3 * across)) + zy * zy * (along / (1 + 3 * along))
    variance = variance + c * c * ((1 - shrink).square() / 3)
    cut = rectified(shrink * (c + kernel.shift[..., k] * zy), variance.sqrt())
    return cut.mean if window is Window.COSINE else cut.probability


def narrow(spread: Sheets, tilt: Tilt, seen: Surface, layer: Layer) -> Tensor:
    """Return what the layer shows of each sheet of amplitude 1 at Fresnel reflectance 1.

    The 2 x 2 matrices: P of slopes, alpha^2 / (1 - alpha^2) plus twice the covariance of the half
    vector; A = P (1 + P)^-1 the squared roughness of the widened distribution, whose determinant
    det P / det(1 + P) is a sum of positive terms.

    Returns:
        [..., M, P]
    """
    p0 = slopes(layer.alpha)
    x1, x2 = _dot(seen.tangent, tilt.slope_x), _dot(seen.bitangent, tilt.slope_x)
    y1, y2 = _dot(seen.tangent, tilt.slope_y), _dot(seen.bitangent, tilt.slope_y)
    p11, p22, p12 = x1 * x1 + y1 * y1, x2 * x2 + y2 * y2, x1 * x2 + y1 * y2
    determinant = p0 * p0 + p0 * (p11 + p22) + (x1 * y2 - x2 * y1).square()
    below = 1 / (1 + 2 * p0 + p11 + p22 + determinant)
    a11, a22, a12 = p0 + p11 + determinant, p0 + p22 + determinant, p12
    # D is even in h: what is behind the horizon is cut off by the light itself, not by its axis.
    h1, h2, h3 = (_dot(a, tilt.half) for a in (seen.tangent, seen.bitangent, seen.normal))
    shape = (a22 * h1 * h1 - 2 * a12 * h1 * h2 + a11 * h2 * h2) / determinant + h3 * h3
    distribution = 1 / (math.pi * (determinant * below).sqrt() * shape * shape)
    reflected = distribution * _visible(*cosine(spread, seen.normal), seen.cos_view, layer.alpha)
    return spread.integral * reflected


def _visible(mean: Tensor, deviation: Tensor, cos_view: Tensor, alpha: Tensor) -> Tensor:
    """Return the mean of V n.l over the part of a light above the horizon.

    Two nodes with the mean and variance of n.l over that part. Of a normal variable cut off at 0
    the second moment is `m E + s^2` for E its mean (by parts); E itself is of the widened variable.
    """
    cut = rectified(mean, widened(deviation))
    lit = cut.probability.clamp(min=PROBABILITY_MIN)
    n_l = (cut.mean / lit).clamp(COS_LIGHT_MIN, 1)
    variance = deviation * deviation - n_l * (n_l - mean)
    apart = torch.minimum(variance.clamp(min=0).sqrt(), torch.minimum(n_l, 1 - n_l))
    low, high = n_l - apart, n_l + apart
    return (
        lit
        * 0.5
        * (
            ggx.visibility(cos_view, low, alpha) * low
            + ggx.visibility(cos_view, high, alpha) * high
        )
    )


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(-1)
